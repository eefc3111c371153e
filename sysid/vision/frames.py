"""Footage: pictures and when they were taken, from a video or from a folder of pictures.

Times come from the container's stamps. Those that keep to the container's rate, but for the rounding of some formats to
a millisecond, are put on that rate exactly; others are taken as they are. Missing frames leave a gap in time.
"""

from __future__ import annotations

import contextlib
import glob
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # it is read once, when a video is first opened or written

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]

KINDS = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")  # of pictures
STAMPS = ("times.csv", "timestamps.txt")  # beside the pictures
PROBE = 60  # frames that show how a container keeps time
ROUNDED = 0.6e-3  # off the even rate by the millisecond that some containers round to [s]
UNEVEN = 0.05  # of a period: more than this off the even rate is a variable one
AGREE = 0.003  # by which a rate may differ from the one it was given without a word
GAP = 1.75  # periods from one frame to the next from which on frames are missing
SEEK = 1500  # frames from which on a sample jumps rather than reads through
SLOWEST = 1.0  # frame rate below which the times of pictures cannot be seconds [1/s]


@dataclass(frozen=True)
class Frame:
    """One picture (height, width, 3), blue, green, red, and when it was taken [s], from the first."""

    index: int
    time: float
    picture: Picture


@dataclass(frozen=True)
class Clock:
    """How stamps become times: on an even rate, or as they are, stretched."""

    period: float  # between frames, by the stamps [s]
    even: bool  # whether frames keep to that period
    stretch: float  # seconds of the scene in a second of the stamps
    told: tuple[str, ...]

    def steps(self, before: float, now: float) -> int:
        """Periods between two stamps [s], at least one."""
        way = (now - before) / self.period
        return max(1, round(way)) if self.even or way >= GAP else 1


class Footage:
    """Frames in order, as often as wanted; never more than one is held."""

    def __init__(self, source: Video | Pictures, fps: float | None) -> None:
        """Look at the first frames; `fps` is the rate at which they were taken, if the container cannot know [1/s]."""
        self._source = source
        self._clock = source.clock(fps)
        self._broken = self._missing = 0
        self._whole = False
        self.count = source.count
        first = next((picture for _, picture in source.read() if picture is not None), None)
        if first is None:
            raise BadInput(f"{source.name}: holds no picture that can be read; record it anew or convert it")
        self.size: tuple[int, int] = (first.shape[1], first.shape[0])

    @property
    def fps(self) -> float:
        """Rate at which the frames were taken [1/s]; of a variable one the middle."""
        return 1.0 / (self._clock.period * self._clock.stretch)

    @property
    def assumed(self) -> tuple[str, ...]:
        """What was assumed, in plain words; what is missing is known for as much as has been read."""
        far = "" if self._whole else " so far"
        lines = [*self._clock.told]
        if self._missing:
            lines.append(f"{self._missing} frame{'s' * (self._missing > 1)} missing{far}: left as gaps in time")
        if self._broken:
            lines.append(f"{self._broken} frame{'s' * (self._broken > 1)} unreadable{far}: left out")
        return tuple(lines)

    def __iter__(self) -> Iterator[Frame]:
        """All frames that can be read."""
        return self._frames(None)

    def sample(self, n: int) -> list[Frame]:
        """Up to n frames, spread over the whole."""
        if n < 1:
            return []
        count = self.count
        if isinstance(self._source, Video) and (count is None or count > SEEK):
            if count is not None and len(found := self._jump(n, count)) > n / 2:
                return found
            total = sum(1 for _ in self._frames(set()))
            self.count = count = total
        wanted = set(np.linspace(0, max((count or 1) - 1, 0), n).round().astype(int).tolist())
        found = list(self._frames(wanted))
        if self._whole and self.count is not None and self.count < (count or 0):  # the container promised more
            return self.sample(n) if len(found) < min(n, self.count) else found
        return found

    def _jump(self, n: int, count: int) -> list[Frame]:
        found: dict[float, Frame] = {}
        first = math.nan
        for stamp, picture in self._source.read(np.linspace(0, count - 1, n).round().astype(int).tolist()):
            first = stamp if math.isnan(first) else first
            if picture is not None and (picture.shape[1], picture.shape[0]) == self.size:
                place = round((stamp - first) / self._clock.period)
                time = place * self._clock.period if self._clock.even else stamp - first
                found[stamp] = Frame(place, time * self._clock.stretch, picture)
        return [found[stamp] for stamp in sorted(found)]

    def _frames(self, wanted: set[int] | None) -> Iterator[Frame]:
        """Read through, and hand out those of these numbers, or all."""
        clock, steps, before = self._clock, 0, math.nan
        missing = broken = read = 0
        first = math.nan
        for index, (stamp, picture) in enumerate(self._source.read(wanted=wanted)):
            read = index + 1
            if not math.isnan(before):
                step = clock.steps(before, stamp)
                steps, missing = steps + step, missing + step - 1
            else:
                first = stamp
            before = stamp
            if picture is not None and (picture.shape[1], picture.shape[0]) != self.size:
                picture = None
            unread = picture is None and (wanted is None or index in wanted)
            broken += unread
            self._missing, self._broken = max(self._missing, missing), max(self._broken, broken)
            if picture is not None:
                time = steps * clock.period if clock.even else stamp - first
                yield Frame(index, time * clock.stretch, picture)
        self._whole, self.count = True, read


class Video:
    """A file that OpenCV reads."""

    def __init__(self, path: Path) -> None:
        """Open it once to see that it can be read."""
        self.path, self.name = path, str(path)
        with quiet():
            capture = cv2.VideoCapture(self.name)
            self.rate = float(capture.get(cv2.CAP_PROP_FPS)) if capture.isOpened() else 0.0
            counted = float(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0.0
            opened = capture.isOpened()
            capture.release()
        if not opened:
            raise BadInput(f"{self.name}: is no video that can be read; convert it to MP4 (H.264) or to pictures")
        self.count = int(counted) if 0 < counted < 1e9 else None

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Stamps [s] and pictures: of all frames (those not `wanted` undeveloped), or of those to jump to."""
        with quiet():
            capture = cv2.VideoCapture(self.name)
        try:
            for index in jumps if jumps is not None else range(most if most is not None else 10**9):
                if jumps is not None:
                    capture.set(cv2.CAP_PROP_POS_FRAMES, index)
                if not capture.grab():
                    if jumps is None:
                        return
                    continue
                stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
                picture = None
                if wanted is None or index in wanted:
                    done, found = capture.retrieve()
                    picture = _colour(found) if done else None
                yield stamp, picture
        finally:
            capture.release()

    def clock(self, fps: float | None) -> Clock:
        """How it keeps time, by its first frames."""
        stamps = np.array([stamp for stamp, _ in self.read(wanted=set(), most=PROBE)])
        rate = self.rate if 0.1 < self.rate < 1e6 else math.nan
        steps = np.diff(stamps)
        if len(steps) == 0 or not (steps > 0).all():
            if len(steps) and not (math.isfinite(rate) or fps):
                raise BadInput(f"{self.name}: has no frame times and no rate; give the rate it was taken at: --fps")
            # Every frame is then taken to follow the one before: `steps` counts at least one.
            period = 1.0 / (rate if math.isfinite(rate) else fps or 1.0)
            return _stretched(Clock(period, True, 1.0, (f"frame times from the rate {1 / period:.6g}/s",)), fps)
        if math.isfinite(rate):
            # Stamps may be rounded to the millisecond: the rate that the container tells is tried as it is.
            period, since = 1.0 / rate, stamps - stamps[0]
            off = since - period * np.round(since / period)
            each = np.median(steps) / period  # some containers tell the finest rate that they can hold
            if np.abs(off).max() < max(ROUNDED, UNEVEN * period) and 0.5 < each < GAP:
                return _stretched(Clock(period, True, 1.0, (f"frame times from the container, {rate:.6g}/s",)), fps)
        told = f"frame times from the container, a variable rate of about {1 / np.median(steps):.4g}/s"
        return _stretched(Clock(float(np.median(steps)), False, 1.0, (told,)), fps)


class Pictures:
    """Pictures in order, with times beside them or none."""

    def __init__(self, name: str, paths: Sequence[Path]) -> None:
        """`name` is what the user gave."""
        self.name, self.paths, self.count = name, list(paths), len(paths)
        self._stamps = np.arange(len(paths), dtype=float)
        self._timed = False

    def clock(self, fps: float | None) -> Clock:
        """Times from the file beside them, from the numbers in their names, or evenly."""
        beside = next((p for n in STAMPS if (p := self.paths[0].parent / n).is_file()), None)
        if beside is not None:
            self._stamps = _stamps(beside, len(self.paths))
            if len(self._stamps) > 1:
                period = float(np.median(np.diff(self._stamps)))
                return _stretched(
                    Clock(period, False, 1.0, (f"frame times from {beside.name}, {1 / period:.6g}/s",)), fps
                )
        if fps is None and len(self.paths) > 1:
            raise BadInput(
                f"{self.name}: pictures carry no times; give their rate (--fps) or put times.csv beside them"
            )
        numbers = [int(found[-1]) if (found := re.findall(r"\d+", p.stem)) else -1 for p in self.paths]
        steps = np.diff(numbers)
        told = f"pictures taken at an even {fps or 1.0:.6g}/s"
        if len(steps) and (steps > 0).all():
            step = float(np.median(steps))
            if (steps % step == 0).all():
                self._stamps = (np.array(numbers) - numbers[0]) / step
                told += ", numbers missing from their names counted as frames missing" if (steps > step).any() else ""
        return Clock(1.0, True, 1.0 / (fps or 1.0), (told,))

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Times and pictures; None for those not wanted or unreadable."""
        for index in jumps if jumps is not None else range(len(self.paths) if most is None else most):
            picture = None
            if wanted is None or index in wanted:
                with quiet():
                    picture = _colour(cv2.imread(str(self.paths[index]), cv2.IMREAD_COLOR))
            yield float(self._stamps[index]), picture


def open_footage(path: Path | str, fps: float | None = None) -> Footage:
    """Footage of a video, a picture, a folder of pictures, or a pattern of their names (`%04d` or `*`).

    Args:
        path: what to read.
        fps: rate at which the frames were taken, where the container does not know it or is re-timed [1/s].

    Raises:
        BadInput: nothing there can be read, in one line.
    """
    name = str(path)
    if fps is not None and not 0 < fps < math.inf:
        raise BadInput(f"--fps {fps:g}: must be the number of frames taken in a second, above 0")
    place = Path(path)
    if place.is_dir():
        found = [p for p in place.iterdir() if p.suffix.lower() in KINDS and not p.name.startswith(".")]
        if not found:
            raise BadInput(
                f"{name}: holds no pictures ({', '.join(k[1:] for k in KINDS)}); name a video or such a folder"
            )
    elif place.is_file():
        if place.stat().st_size == 0:
            raise BadInput(f"{name}: is empty; record or copy it anew")
        if place.suffix.lower() not in KINDS:
            return Footage(Video(place), fps)
        found = [place]
    elif re.search(r"%0?\d*d", place.name):
        shape = re.compile(re.sub(r"%0?\d*d", r"\\d+", re.escape(place.name)))
        found = [p for p in place.parent.iterdir() if shape.fullmatch(p.name)] if place.parent.is_dir() else []
    else:
        found = [Path(p) for p in glob.glob(name)] if glob.has_magic(name) else []
    if not found:
        raise BadInput(f"{name}: is not there; name a video, a folder of pictures or a pattern of their names")
    return Footage(Pictures(name, sorted(found, key=_natural)), fps)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Order in which 2 comes before 10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]


def _colour(picture: NDArray[np.uint8] | None) -> Picture | None:
    if picture is None or picture.size == 0:
        return None
    if picture.ndim == 2 or picture.shape[2] == 1:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    return picture[..., :3]


def _stretched(clock: Clock, fps: float | None) -> Clock:
    """The clock of frames that were really taken at another rate than their stamps say."""
    if fps is None:
        return clock
    by = 1.0 / (fps * clock.period)
    shown = f"{1 / by:.6g} times slower" if by < 1 else f"{by:.6g} times faster"
    told = f"taken at {fps:.6g}/s as given: the container, with {1 / clock.period:.6g}/s, shows it {shown}"
    return Clock(clock.period, clock.even, by, (*clock.told, told) if abs(by - 1) > AGREE else clock.told)


def _stamps(path: Path, count: int) -> Array:
    """Times of pictures [s] from a text file: one on a line, the column headed time or t, else the last."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        raise BadInput(f"{path}: cannot be read as text; write one time in seconds on a line") from None
    lines = [re.split(r"[,;\s]+", line.strip().rstrip(",;")) for line in text.splitlines()]
    rows = [row for row in lines if row != [""] and not row[0].startswith("#")]
    column = -1
    if rows and not _number(rows[0][-1]):
        heads = [head.lower() for head in rows.pop(0)]
        column = next((k for k, head in enumerate(heads) if head in ("t", "time", "timestamp", "time_s")), -1)
    for number, row in enumerate(rows, 1):
        if column >= len(row) or not _number(row[column]):
            raise BadInput(f"{path}: time {number} is {' '.join(row)!r}; write one time in seconds on a line")
    times = np.array([float(row[column]) for row in rows])
    if len(times) != count:
        raise BadInput(f"{path}: holds {len(times)} times for {count} pictures; write one for each")
    steps = np.diff(times)
    if not np.isfinite(times).all() or (len(steps) and steps.min() <= 0):
        raise BadInput(f"{path}: times must increase; put them in the order of the pictures' names")
    if len(steps) and np.median(steps) > 1 / SLOWEST:
        raise BadInput(f"{path}: pictures {np.median(steps):g} apart; times must be in seconds")
    return times


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Keep OpenCV and FFmpeg from writing what is about to be told in one line."""
    logging = cv2.utils.logging
    before = logging.getLogLevel()
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        logging.setLogLevel(before)
