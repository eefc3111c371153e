"""What pictures tell of a shot beside where its balls are: how they turn, and what the cue did.

The footage is read a second time, when the strikes are known.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue import CueSeen, watch_cue
from sysid.vision.frames import Footage
from sysid.vision.rotation.spin import turning
from sysid.vision.rotation.spots import Spots, find_spots
from sysid.vision.rotation.turned import Turning
from sysid.vision.tracks.track import Tracked, without

Picture = NDArray[np.uint8]
BEFORE = 0.35  # of a cue's coming that is looked at [s]
AFTER = 0.01  # and past the strike [s]
TURNED, FEWEST = 1.0, 20  # turn of a ball that spins in place [rad], and the frames that tell it, at least
PLAIN = 12  # sightings without a mark after which a ball has none


@dataclass(frozen=True)
class Details:
    """Of one shot."""

    turned: dict[str, Turning]  # balls that carry marks
    cue: CueSeen | None

    @property
    def tip(self) -> str:
        """The cue in words; nothing where it was not seen."""
        c = self.cue
        if c is None or not (math.isfinite(c.speed) and math.isfinite(c.azimuth)):
            return ""
        return (
            f"cue tip {c.speed:.3f} +- {c.speed_sd:.3f} m/s at {math.degrees(c.azimuth):.2f} +- "
            f"{math.degrees(c.azimuth_sd):.2f} deg, {1e3 * c.side:+.1f} +- {1e3 * c.side_sd:.1f} mm to the right"
        )


@dataclass
class _Marked:
    """One ball of one shot while its marks are collected."""

    name: str
    seen: list[Spots] = field(default_factory=list)
    plain: bool = False  # it carries no marks

    def take(self, picture: Picture, time: float, xy: Array, camera: Camera) -> None:
        if self.plain:
            return
        self.seen.append(find_spots(picture, time, xy, camera, self.seen[-1] if self.seen else None))
        if len(self.seen) == PLAIN and not any(len(s.place) for s in self.seen):
            self.plain = True


def details(
    result: Tracked, footage: Footage, camera: Camera, progress: Callable[[str], None] = lambda line: None
) -> tuple[Tracked, tuple[Details, ...]]:
    """Marks and cue of every shot; spins in place that no marks tell of are no shots."""
    marked = [{name: _Marked(name) for name in found} for found in result.found]
    where: dict[int, list[tuple[int, str, int]]] = {}
    for number, found in enumerate(result.found):
        for name, (path, rows) in found.items():
            for row in rows:
                where.setdefault(int(path.frame[row]), []).append((number, name, int(row)))
    cues: list[CueSeen | None] = [None] * len(result.shots)
    recent: deque[tuple[float, Picture]] = deque()
    waiting = sorted(range(len(result.shots)), key=lambda k: result.shots[k].time)
    last = max((s.last for s in result.shots), default=-1)
    for frame in footage:
        recent.append((frame.time, frame.picture))
        while waiting and frame.time > result.shots[waiting[0]].time + AFTER:
            k = waiting.pop(0)
            cues[k] = _cue(result, k, [(t, p) for t, p in recent if t <= result.shots[k].time + AFTER], camera)
            progress(f"shot {k + 1} of {len(result.shots)}: cue and marks")
        while recent and (not waiting or recent[0][0] < result.shots[waiting[0]].time - BEFORE):
            recent.popleft()
        for number, name, row in where.get(frame.index, ()):
            path = result.found[number][name][0]
            marked[number][name].take(frame.picture, float(path.time[row]), path.xy[row], camera)
        if frame.index >= last:
            break
    out = []
    for collected, cue in zip(marked, cues, strict=True):
        turned = {m.name: turning(m.seen, camera.radius) for m in collected.values() if not m.plain and len(m.seen) > 2}
        out.append(Details({n: t for n, t in turned.items() if np.isfinite(t.theta).any()}, cue))
    bad = [shot.spun and not _turns(one.turned.get(shot.struck)) for shot, one in zip(result.shots, out, strict=True)]
    return without(result, bad), tuple(one for one, off in zip(out, bad, strict=True) if not off)


def _turns(turned: Turning | None) -> bool:
    """Whether marks show that a ball turns, and for long."""
    known = np.zeros(0) if turned is None else turned.theta[np.isfinite(turned.theta)]
    return len(known) >= FEWEST and abs(known[-1] - known[0]) > TURNED


def _cue(result: Tracked, k: int, frames: list[tuple[float, Picture]], camera: Camera) -> CueSeen | None:
    """The cue before the strike of a shot."""
    shot = result.shots[k]
    if shot.spun:
        return None
    path, _ = result.found[k][shot.struck]
    before = np.flatnonzero(path.time < shot.time)
    if len(frames) < 3 or before.size == 0:
        return None
    return watch_cue(frames, camera, np.median(path.xy[before[-5:]], axis=0))
