"""From tracks to rests and moves: where each ball is at rest, when it moves, and whether it drops into a pocket.

In: the tracks of a footage. Out: `TrackedScene`, with the phases, rests and moves of all balls. A move is what a
ball does from one rest to the next.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.shot import Table
from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.phases import Phase, phases

MIN_REST_DETECTIONS = 3  # two parabolas that meet make a rest of two
MAX_UNSEEN_S = 0.1  # a ball hidden for longer was set in motion unseen
MAX_BRIDGED_S = 0.5  # a ball hidden for longer may have been moved by hand
SURE_SD = 4.0  # standard deviations by which a path may miss a place that it comes from
MAX_DROP_S = 0.1  # after its last detection, within which a ball drops into a pocket


@dataclass(frozen=True)
class TrackedScene:
    """All tracks of a footage, and the table they are on."""

    tracks: Sequence[BallTrack]
    frames: NDArray[np.int64]  # (m,) indices of the frames that were read
    times: Array  # (m,) [s]
    table: Table
    radius: float  # of the balls [m]
    sigma: float  # standard deviation of a detection, per axis [m]

    def time_of(self, frame: int) -> float:
        """Time of a frame [s]."""
        return float(self.times[np.searchsorted(self.frames, frame)])

    @cached_property
    def period(self) -> float:
        """Between two frames [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 1.0

    def read(self, track: BallTrack) -> tuple[tuple[Phase, ...], NDArray[np.bool_]]:
        """The phases of a track, and which of its detections (n,) are none of the ball."""
        return phases(track, self.sigma, self.radius, math.sqrt(self.table.length * self.table.width))

    @cached_property
    def phases(self) -> dict[str, tuple[Phase, ...]]:
        """Phases of every ball."""
        return {track.name: self.read(track)[0] for track in self.tracks}

    @cached_property
    def resting(self) -> dict[str, list[tuple[int, int]]]:
        """First and last detection of every rest of every ball."""
        return {track.name: _rests(self, track) for track in self.tracks}

    @cached_property
    def moves(self) -> list[Move]:
        """Moves of all balls."""
        return [move for track in self.tracks for move in _moves(self, track)]

    def at_rest(self, track: BallTrack) -> NDArray[np.bool_]:
        """Which detections of a ball are at rest: (n,)."""
        found = np.zeros(len(track.time), bool)
        for first, last in self.resting[track.name]:
            found[first : last + 1] = True
        return found


@dataclass(frozen=True)
class Move:
    """Motion of a ball from one rest to the next."""

    track: BallTrack
    phases: tuple[Phase, ...]  # of it
    first: int  # its first detection away from its rest
    stop: int  # detection that begins the next rest; the number of detections if there is none
    place: Array | None  # of its rest (2,) [m]; None if that was not seen
    before: int  # frame in which it was last seen at rest
    hidden: float = 0.0  # for how long it was not seen before its first detection [s], if that is more than usual

    @property
    def name(self) -> str:
        """The ball."""
        return self.track.name

    @property
    def began(self) -> int:
        """The first frame in which it had moved."""
        return int(self.track.frame[self.first])

    @property
    def lost(self) -> bool:
        """Whether it was not seen again."""
        return self.stop == len(self.track.frame)

    @property
    def ended(self) -> int:
        """The last frame in which it moved."""
        return int(self.track.frame[self.stop - 1])

    @property
    def _begins(self) -> Phase | None:
        """The phase with which it begins; None where that is seen in one detection only, or has ended unseen."""
        one = self.phases[0]
        if one.rest or one.stop - max(one.first, self.first) < 2:
            return None
        if self.place is None:
            return one
        left = _left(one, self.place, self._may_begin)
        miss = float(np.linalg.norm(one.place(left) - self.place))
        return one if miss < max(SURE_SD * one.place_sd(left), float(np.linalg.norm(self._way)) / 2) else None

    @property
    def _may_begin(self) -> tuple[float, float]:
        """Between which times it begins [s]: the detections beside may show half of a beginning."""
        first, last = max(self.first - 2, 0), min(self.first + 1, self.stop - 1)
        return float(self.track.time[first]), float(self.track.time[last])

    @property
    def _way(self) -> Array:
        """From its rest to its first detection (2,) [m]."""
        return np.asarray(self.track.xy[self.first] - (self.track.xy[0] if self.place is None else self.place))

    @property
    def velocity(self) -> Array:
        """Velocity with which it begins (2,) [m/s], that of the faster step beside its first detection if need be."""
        track = self.track
        if (one := self._begins) is not None:
            return one.velocity(float(track.time[max(one.first, self.first)]))
        rows = range(max(self.first - (self.place is not None), 0), min(self.first + 2, len(track.time)))
        steps = [(track.xy[k + 1] - track.xy[k]) / (track.time[k + 1] - track.time[k]) for k in rows if k + 1 in rows]
        return np.asarray(max(steps, key=lambda step: float(np.linalg.norm(step)))) if steps else np.zeros(2)

    @property
    def onset(self) -> float:
        """Time at which it began to move, extrapolated from its first phase, or after which, unseen [s]."""
        track, first = self.track, self.first
        if self.place is None:
            return float(track.time[max(first - 1, 0)])
        if (one := self._begins) is not None:
            return float(_left(one, self.place, self._may_begin))
        speed = float(np.linalg.norm(self.velocity))
        return max(float(track.time[first]) - float(np.linalg.norm(self._way)) / max(speed, 1e-9), self._may_begin[0])


def _left(one: Phase, place: Array, between: tuple[float, float]) -> float:
    """When the path of a phase, also before it is seen, was nearest to a place (2,), between two times [s]."""
    offset, velocity, half = one.state[0] - place, one.state[1], one.state[2]
    # The derivative of the square of the distance is a cubic.
    cubic = [2 * half @ half, 3 * half @ velocity, velocity @ velocity + 2 * half @ offset, velocity @ offset]
    roots = [one.start + r.real for r in np.roots(cubic) if abs(r.imag) < 1e-9]
    times = [*between, *(time for time in roots if between[0] < time < between[1])]
    return min(times, key=lambda time: float(np.linalg.norm(one.place(time) - place)))


def _rests(scene: TrackedScene, track: BallTrack) -> list[tuple[int, int]]:
    """First and last detection of every rest: of phases at rest, between which the ball goes nowhere."""
    found: list[tuple[int, int]] = []
    for one in scene.phases[track.name]:
        if not one.still:
            continue
        first, last = one.first, one.stop - 1
        if one.stop - first < MIN_REST_DETECTIONS:
            continue
        if found:
            previous = rest_place(track, *found[-1])
            between = np.linalg.norm(track.xy[found[-1][1] : first] - previous, axis=1)
            returned = np.linalg.norm(rest_place(track, first, last) - previous) < scene.radius / 2
            if returned and (between > scene.radius / 2).sum() < 2:  # a shadow, the cue or a hand beside it
                found[-1] = (found[-1][0], last)
                continue
        found.append((first, last))
    ends = [*(first for first, _ in found[1:]), len(track.time)][: len(found)]
    return [(first, _returned(scene, track, first, last, end)) for (first, last), end in zip(found, ends, strict=True)]


def _returned(scene: TrackedScene, track: BallTrack, first: int, last: int, end: int) -> int:
    """The last detection of a rest, with those after it from which the ball comes back by half of the way or more.

    A hand or a cue beside a ball draws it to and fro before it is struck.
    """
    away = np.linalg.norm(track.xy[last + 1 : end] - rest_place(track, first, last), axis=1)
    away = away[: int(np.argmax(away > scene.radius / 2))] if (away > scene.radius / 2).any() else away
    back = np.flatnonzero(away < np.maximum.accumulate(away) / 2)
    return last + 1 + int(back[-1]) if back.size else last


def rest_place(track: BallTrack, first: int, last: int) -> Array:
    return np.asarray(np.median(track.xy[first : last + 1], axis=0))


def _moves(scene: TrackedScene, track: BallTrack) -> list[Move]:
    """Moves of a ball between its rests, by half a radius or more."""
    n, found = len(track.frame), []
    resting = scene.resting[track.name]
    for k, rest in enumerate([None, *resting]):
        first, stop = 0 if rest is None else rest[1] + 1, resting[k][0] if k < len(resting) else n
        if stop == first:
            continue
        of = tuple(one for one in scene.phases[track.name] if one.stop > first and one.first < stop)
        if rest is None:
            end = rest_place(track, *resting[0]) if resting else track.xy[stop - 1]
            if stop > 1 and (np.linalg.norm(track.xy[:stop] - end, axis=1) > scene.radius / 2).any():
                found.append(Move(track, of, 0, stop, None, -1))
            continue
        # The place just before: light and shadows that move shift a ball that rests for long.
        place = rest_place(track, max(rest[0], rest[1] - 30), rest[1])
        far = np.linalg.norm(track.xy[first : min(stop + 1, n)] - place, axis=1) > scene.radius / 2
        if not far.any():
            continue
        gap = float(track.time[first] - track.time[first - 1])
        hidden = gap if gap > max(MAX_UNSEEN_S, 3.5 * scene.period) else 0.0
        bridged = not hidden or _leads_back(scene, track, of[0], gap, place)
        found.append(Move(track, of, first, stop, place if bridged else None, int(track.frame[first - 1]), hidden))
    return found


def _leads_back(scene: TrackedScene, track: BallTrack, one: Phase, gap: float, place: Array) -> bool:
    """Whether the path of a ball that is seen after a gap [s] leads back to its rest within the gap."""
    if gap > MAX_BRIDGED_S or one.stop - one.first < MIN_REST_DETECTIONS:
        return False
    left = _left(one, place, (one.start - gap - scene.period, one.start))
    miss = float(np.linalg.norm(one.place(left) - place))
    return miss < SURE_SD * math.hypot(one.place_sd(left), scene.sigma)


def phase_at(scene: TrackedScene, track: BallTrack, row: int) -> Phase:
    """The phase of a detection of a ball."""
    return next(one for one in scene.phases[track.name] if row < one.stop)


def pocketed(scene: TrackedScene, track: BallTrack, rows: NDArray[np.int64]) -> int | None:
    """The last frame before a ball drops into a pocket, among these detections of it; None if it does not."""
    if not scene.table.pockets or rows.size < 2:
        return None
    # A ball that drops is not seen again, or later and elsewhere.
    breaks = [*np.flatnonzero(np.diff(track.time[rows]) > max(MAX_DROP_S, 3.5 * scene.period)).tolist(), rows.size - 1]
    for k in breaks:
        last = int(rows[k])
        if last + 1 < len(track.time) and track.time[last + 1] - track.time[last] < MAX_DROP_S:
            continue
        delays = np.linspace(0, max(MAX_DROP_S, 3 * scene.period), 40)
        if scene.times[-1] - track.time[last] < delays[-1] / 2:
            delays = delays[:1]
        one = phase_at(scene, track, last)
        if one.stop - one.first < 2 and last:
            step = (track.xy[last] - track.xy[last - 1]) / (track.time[last] - track.time[last - 1])
        else:
            step = one.velocity(float(track.time[last]))
        onwards = track.xy[last] + delays[:, None] * step
        if _in_pocket_mouth(scene, onwards, scene.radius / 2).any():
            outside = rows[: k + 1][~_in_pocket_mouth(scene, track.xy[rows[: k + 1]], 0.0)]
            return int(track.frame[outside[-1]]) if outside.size else None
    return None


def _in_pocket_mouth(scene: TrackedScene, xy: Array, margin: float) -> NDArray[np.bool_]:
    """Whether places (n, 2) lie beyond the nose lines, less a margin [m], at a pocket."""
    corner, middle, capture = scene.table.mouths()
    over = np.abs(xy) - np.array([scene.table.length, scene.table.width]) / 2
    end, side = over[:, 0] > -margin, over[:, 1] > -margin
    across = (over[:, 0] > -corner) | (np.abs(xy[:, 0]) < middle)
    return np.asarray((end & (over[:, 1] > -corner)) | (side & across) | (np.hypot(*over.T) < capture))
