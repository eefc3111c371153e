"""Frames that stamps do not show: the same picture twice, and pictures that were never stored.

In: frames, and the tracks. Out: which frames are doubled, to be left out; where frames are missing, and how many, to
set the later stamps right. A doubled picture differs by far less than its neighbours, or shows every ball that was and
will be on its way at rest; no ball can. Where pictures are missing, every ball that rolls freely takes a step that is a
multiple of those before and after it; no free ball can.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.frames import Frame
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.following.follow import BallTrack

PROBE_PX = 4  # every so many pixels are compared; or means of cells of this size
LIGHT_STEP = 4  # of these cells, every so many are used to estimate how the light changes
MIN_LIGHT_VARIANCE = 1.0  # of their values, for that estimate
CHANGED_VALUES = 24  # of cells, three a cell, that change at least where a ball moves
NEIGHBOURING_PICTURES = 5  # on either side, with whose changes that of a picture is compared
USUAL_QUANTILE = 0.75  # of theirs, that is usual
DOUBLED_FRACTION = 0.25  # of the usual change, below which a picture is the one before
MAX_STILL_FRACTION = 0.5  # of what moves on both sides of it: by more, something moves in it, in whatever light
MAX_COPIES = 2  # in a row, of a picture that was compressed anew; a longer standstill may be a real one
MAX_NOISE_FRACTION = 0.6  # of the usual mean change, up to which such a copy differs by noise
MIN_STEP_SD = 12.0  # of a ball that moves clearly, between frames
MIN_STEP_M = 2.5e-3
MAX_STILL_SHARE = 0.1  # of the steps before and after it, of a ball in a doubled picture
MAX_STEP_CHANGE = 0.2  # between the two steps before, relative, of a ball that rolls freely
MAX_LATER_CHANGE = 0.5  # and to the one after
MAX_TURN_SINE = 0.15  # between these steps
MULTIPLE_TOLERANCE = 0.2  # of a step, relative to the usual one, from a whole multiple
MAX_MULTIPLE = 12


@dataclass(frozen=True)
class PictureChange:
    """Differences of a picture from the one before in the same light [grey levels]."""

    mean: float  # of all pixels
    most: float  # of the cells that have changed most: of what moves, as noise is little in their means


@dataclass(frozen=True)
class _Probes:
    """What of a picture is compared with others."""

    pixels: NDArray[np.float32]  # (rows, columns, 3) every so many
    cells: Picture  # (rows, columns, 3) means of as many around them

    def change(self, before: _Probes) -> PictureChange:
        """How the picture differs from the one before, apart from a lamp that flickers or an exposure that adapts."""
        gain, offset = self._light_change(before)
        off = cv2.absdiff(cv2.convertScaleAbs(before.cells, alpha=gain, beta=offset), self.cells).ravel()
        last = len(off) - min(CHANGED_VALUES, len(off))
        mean = float(np.abs(gain * before.pixels + offset - self.pixels).mean())
        return PictureChange(mean, float(np.partition(off, last)[last]))

    def _light_change(self, before: _Probes) -> tuple[float, float]:
        """Gain and offset of grey levels since the picture before, by least squares."""
        earlier, now = (probes.cells[::LIGHT_STEP, ::LIGHT_STEP].ravel() for probes in (before, self))
        spread = float(earlier.var())
        if spread < MIN_LIGHT_VARIANCE:
            return 1.0, 0.0
        gain = float(np.mean((earlier - earlier.mean()) * now)) / spread
        return gain, float(now.mean() - gain * earlier.mean())


def _probes(picture: Picture) -> _Probes:
    height, width = picture.shape[:2]
    size = max(1, width // PROBE_PX), max(1, height // PROBE_PX)
    cells = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    return _Probes(picture[::PROBE_PX, ::PROBE_PX].astype(np.float32), cells)


def is_doubled(changes: Sequence[PictureChange], k: int) -> bool:
    """Whether picture k is the one before, stored once more, by the changes of pictures; the first has none.

    Its pixels are nearly those of the one before, or, where it was compressed anew, nothing moves in it and little
    changes, while something moves just before and after.
    """
    if k == 0:
        return False
    now = changes[k]
    sides = changes[max(1, k - MAX_COPIES) : k], changes[k + 1 : k + 1 + MAX_COPIES]
    moving = min(max((one.most for one in side), default=np.inf) for side in sides)
    around = [*changes[max(1, k - NEIGHBOURING_PICTURES) : k], *changes[k + 1 : k + 1 + NEIGHBOURING_PICTURES]]
    if len(around) > 2:
        usual = float(np.quantile([one.mean for one in around], USUAL_QUANTILE))
        if now.mean < DOUBLED_FRACTION * usual and now.most < MAX_STILL_FRACTION * moving:
            return True
    if not all(sides):
        return False
    changing = min(max(one.mean for one in side) for side in sides)
    return now.most < DOUBLED_FRACTION * moving and now.mean < MAX_NOISE_FRACTION * changing


def marked(footage: Iterable[Frame]) -> Iterator[tuple[Frame, bool]]:
    """The frames of a footage, and whether each shows the same picture as the one before."""
    changes: list[PictureChange] = []
    waiting: deque[Frame] = deque()  # for those after them, by whose changes they are judged
    before: _Probes | None = None
    for frame in footage:
        now = _probes(frame.picture)
        changes.append(now.change(before or now))
        waiting.append(frame)
        before = now
        if len(waiting) > NEIGHBOURING_PICTURES:
            yield waiting.popleft(), is_doubled(changes, len(changes) - 1 - NEIGHBOURING_PICTURES)
    while waiting:
        k = len(changes) - len(waiting)
        yield waiting.popleft(), is_doubled(changes, k)


def doubled(tracks: Sequence[BallTrack], frames: NDArray[np.int64], sigma: float) -> NDArray[np.bool_]:
    """Which frames (m,) show the picture before once more, by balls that stand still on their way."""
    still, moving = np.zeros(len(frames), int), np.zeros(len(frames), int)
    for track in tracks:
        at = np.searchsorted(frames, track.frame)
        length = np.linalg.norm(np.diff(track.xy, axis=0), axis=1)
        one_frame = np.diff(at) == 1
        usual = np.minimum(length[:-2], length[2:])
        clear = one_frame[:-2] & one_frame[1:-1] & one_frame[2:] & (usual > max(MIN_STEP_SD * sigma, MIN_STEP_M))
        moving[at[2:-1][clear]] += 1
        still[at[2:-1][clear & (length[1:-1] < MAX_STILL_SHARE * usual)]] += 1
    return (moving > 0) & (still == moving)


def missing(tracks: Sequence[BallTrack], frames: NDArray[np.int64], period: float, sigma: float) -> dict[int, int]:
    """Frames before which pictures are missing that their stamps do not show, and how many, by the balls' steps."""
    steps: dict[int, list[tuple[float, int]]] = {}  # by frame: multiple of the usual step, and periods by the stamps
    place = {int(frame): k for k, frame in enumerate(frames)}
    for track in tracks:
        at = np.array([place[int(f)] for f in track.frame])
        step = np.diff(track.xy, axis=0)
        length = np.linalg.norm(step, axis=1)
        count = np.maximum(np.rint(np.diff(track.time) / period), 1).astype(int)
        for k in range(2, len(step) - 1):
            near = [k - 2, k - 1, k + 1]
            around = length[near] / count[near]
            usual = float(around[:2].mean())
            if usual < max(MIN_STEP_SD * sigma, MIN_STEP_M):
                continue
            even = abs(around[0] - around[1]) < MAX_STEP_CHANGE * usual
            even &= abs(around[2] - usual) < MAX_LATER_CHANGE * usual
            turn = abs(float(step[k, 0] * step[k - 1, 1] - step[k, 1] * step[k - 1, 0]))
            straight = turn < MAX_TURN_SINE * length[k] * length[k - 1] and float(step[k] @ step[k - 1]) > 0
            ratio = length[k] / usual if even and straight else float(count[k])
            steps.setdefault(int(frames[at[k] + 1]), []).append((ratio, int(count[k])))
    found = {}
    for frame, ratios in sorted(steps.items()):
        multiple, stamped = round(float(np.median([r for r, _ in ratios]))), min(c for _, c in ratios)
        close = all(abs(r - multiple) < MULTIPLE_TOLERANCE * multiple for r, _ in ratios)
        if stamped < multiple <= MAX_MULTIPLE and close:
            found[frame] = multiple - stamped
    return found


def delays(frames: NDArray[np.int64], gaps: Mapping[int, int], period: float) -> Array:
    """What is to be added to the stamps of frames (n,) [s]."""
    total = np.zeros(len(frames))
    for frame, count in gaps.items():
        total[frames >= frame] += count * period
    return total
