"""The rotation of the balls and the motion of the cue in every shot of tracked footage.

In: the result of tracking and the footage, which is read a second time now that the strikes are known. Out: `Details`
of each shot, and the result without the candidates for spins in place that no marks confirm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.motion import CueMotion, against_ball, watch_cue
from sysid.vision.frames import Footage
from sysid.vision.rotation.spin import turning
from sysid.vision.rotation.spots import Spots, find_spots
from sysid.vision.rotation.turned import Turning
from sysid.vision.tracks.track import Tracked, without_shots

Picture = NDArray[np.uint8]
CUE_LEAD_S = 0.35  # pictures before a strike in which the cue is measured
CUE_TAIL_S = 0.01  # and after it
MIN_TURN_RAD = 1.0  # a ball that spins in place turns by at least this angle
MIN_TURN_FRAMES = 20  # and its angle is known in this many frames
MARKLESS_FRAMES = 12  # detections without a mark after which a ball is taken to carry none


@dataclass(frozen=True)
class Details:
    """Rotation and cue of one shot."""

    turned: dict[str, Turning]  # balls that carry marks
    cue: CueMotion | None

    @property
    def tip(self) -> str:
        """The cue in words; empty where it was not seen."""
        c = self.cue
        if c is None or not (math.isfinite(c.speed) and math.isfinite(c.azimuth)):
            return ""
        return (
            f"cue tip {c.speed:.3f} +- {c.speed_sd:.3f} m/s at {math.degrees(c.azimuth):.2f} +- "
            f"{math.degrees(c.azimuth_sd):.2f} deg, side offset {1e3 * c.side:+.1f} +- {1e3 * c.side_sd:.1f} mm"
        )


@dataclass
class _Marked:
    """The spots of one ball of one shot, collected frame by frame."""

    name: str
    spots: list[Spots] = field(default_factory=list)
    plain: bool = False  # whether it carries no marks

    def take(self, picture: Picture, time: float, xy: Array, camera: Camera) -> None:
        if self.plain:
            return
        self.spots.append(find_spots(picture, time, xy, camera, self.spots[-1] if self.spots else None))
        if len(self.spots) == MARKLESS_FRAMES and not any(len(s.place) for s in self.spots):
            self.plain = True


def details(
    result: Tracked, footage: Footage, camera: Camera, progress: Callable[[str], None] = lambda line: None,
    marks: bool = True,
) -> tuple[Tracked, tuple[Details, ...]]:  # fmt: skip
    """Rotation and cue of every shot; a spin in place that no marks confirm is dropped from the result.

    Without `marks`, where pictures are too rough to show them, only the cue is measured.
    """
    marked = [{name: _Marked(name, plain=not marks) for name in found} for found in result.found]
    by_frame: dict[int, list[tuple[int, str, int]]] = {}
    for number, found in enumerate(result.found):
        for name, (track, rows) in found.items():
            for row in rows:
                by_frame.setdefault(int(track.frame[row]), []).append((number, name, int(row)))
    cues: list[CueMotion | None] = [None] * len(result.shots)
    recent: deque[tuple[float, Picture]] = deque()
    waiting = sorted(range(len(result.shots)), key=lambda k: result.shots[k].time)
    last = max((s.last for s in result.shots), default=-1)
    for frame in footage:
        recent.append((frame.time, frame.picture))
        while waiting and frame.time > result.shots[waiting[0]].time + CUE_TAIL_S:
            k = waiting.pop(0)
            cues[k] = _cue_of(result, k, [(t, p) for t, p in recent if t <= result.shots[k].time + CUE_TAIL_S], camera)
            progress(f"shot {k + 1} of {len(result.shots)}: measuring cue and marks")
        while recent and (not waiting or recent[0][0] < result.shots[waiting[0]].time - CUE_LEAD_S):
            recent.popleft()
        for number, name, row in by_frame.get(frame.index, ()):
            track = result.found[number][name][0]
            marked[number][name].take(frame.picture, float(track.time[row]), track.xy[row], camera)
        if frame.index >= last:
            break
    out = []
    for collected, cue in zip(marked, cues, strict=True):
        turned = {
            m.name: turning(m.spots, camera.radius) for m in collected.values() if not m.plain and len(m.spots) > 2
        }
        out.append(Details({n: t for n, t in turned.items() if np.isfinite(t.theta).any()}, cue))
    bad = [
        shot.spun and not _is_turning(one.turned.get(shot.struck)) for shot, one in zip(result.shots, out, strict=True)
    ]
    return without_shots(result, bad), tuple(one for one, off in zip(out, bad, strict=True) if not off)


def _is_turning(turned: Turning | None) -> bool:
    """Whether marks show that a ball turns, for long enough."""
    known = np.zeros(0) if turned is None else turned.theta[np.isfinite(turned.theta)]
    return len(known) >= MIN_TURN_FRAMES and abs(known[-1] - known[0]) > MIN_TURN_RAD


def _cue_of(result: Tracked, k: int, frames: list[tuple[float, Picture]], camera: Camera) -> CueMotion | None:
    """The cue before the strike of a shot."""
    shot = result.shots[k]
    if shot.spun or shot.running:
        return None
    track, _ = result.found[k][shot.struck]
    before = np.flatnonzero(track.time < shot.time)
    if len(frames) < 3 or before.size == 0:
        return None
    cue = watch_cue(frames, camera, np.median(track.xy[before[-5:]], axis=0))
    return None if cue is None else against_ball(cue, shot.speed, camera.radius)
