"""From tracks to rests and moves: where each ball is at rest, when it moves, and whether it drops into a pocket.

In: the tracks of a footage. Out: `TrackedScene`, with the rests and the moves of all balls. A ball is at rest while its
detections stay in one place; a move is what it does from one rest to the next.
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
from sysid.vision.tracks.follow import BallTrack

MIN_REST_S = 0.15  # in which a ball at rest stays in its place
MIN_REST_DETECTIONS = 3  # of a rest
MAX_SWING_RADII = 0.1  # between two places of one ball at rest, between which its fits jump
SWING_QUANTILE = 0.95  # of its distances from its place at rest, beyond which a ball has left it
MAX_UNSEEN_S = 0.1  # a ball hidden for longer was set in motion unseen
MAX_BRIDGED_S = 0.5  # a ball hidden for longer may have been moved by hand
BRIDGE_DETECTIONS = 12  # from which the way back over a gap is extrapolated
MAX_ASIDE_RADII = 0.3  # of its path from where it rested
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
    rest_sigma: float = math.nan  # the same of balls of which many rest, where it is smaller [m]

    def time_of(self, frame: int) -> float:
        """Time of a frame [s]."""
        return float(self.times[np.searchsorted(self.frames, frame)])

    @cached_property
    def period(self) -> float:
        """Between two frames [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 1.0

    @cached_property
    def resting(self) -> dict[str, list[tuple[int, int]]]:
        """First and last detection of every rest of every ball."""
        return {track.name: rests(self, track) for track in self.tracks}

    @cached_property
    def moves(self) -> list[Move]:
        """Moves of all balls."""
        return [move for track in self.tracks for move in moves_of(self, track, self.resting[track.name])]

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
    def onset(self) -> float:
        """Time at which it began to move, extrapolated from its first detections in motion [s]."""
        track, first = self.track, self.first
        if self.place is None:
            return float(track.time[first])
        speed = float(np.linalg.norm(mean_velocity(track, first, self.stop)))
        distance = float(np.linalg.norm(track.xy[first] - self.place))
        if self.hidden:
            return float(track.time[first]) - min(self._way_back(self.place, distance, speed), self.hidden)
        return max(float(track.time[first]) - distance / max(speed, 1e-6), float(track.time[max(first - 3, 0)]))

    def _way_back(self, place: Array, distance: float, speed: float) -> float:
        """Time since the ball left its rest at this distance [m], slowing as it does in its first detections [s]."""
        part = slice(self.first, min(self.first + BRIDGE_DETECTIONS, self.stop))
        time = self.track.time[part] - self.track.time[self.first]
        along = (self.track.xy[part] - place) @ (self.track.xy[self.first] - place) / max(distance, 1e-9)
        half_slowing, start_speed, start = np.polyfit(time, along, 2) if len(time) > 3 else (0.0, speed, distance)
        inside = start_speed**2 - 4 * half_slowing * start
        if half_slowing >= 0 or inside < 0:
            return distance / max(speed, 1e-6)
        return float((start_speed - math.sqrt(inside)) / (2 * half_slowing))

    @property
    def lost(self) -> bool:
        """Whether it was not seen again."""
        return self.stop == len(self.track.frame)

    @property
    def ended(self) -> int:
        """The last frame in which it moved."""
        return int(self.track.frame[self.stop - 1])


def rests(scene: TrackedScene, track: BallTrack) -> list[tuple[int, int]]:
    """First and last detection of every rest."""
    count = max(MIN_REST_DETECTIONS, int(MIN_REST_S / scene.period) + 1)
    if len(track.frame) < count:
        return []
    room = 2 * max(4 * float(np.fmin(scene.sigma, scene.rest_sigma)), 0.025 * scene.radius)
    windows = np.lib.stride_tricks.sliding_window_view(track.xy, count, axis=0)
    # A fit may jump between two places near each other: then a ball at rest comes back, one that rolls does not.
    half = count // 2
    drift = np.median(windows[:, :, -half:], axis=2) - np.median(windows[:, :, :half], axis=2)
    swing = max(room, MAX_SWING_RADII * scene.radius)
    still = ((np.ptp(windows, axis=2) < swing) & (np.abs(drift) < room / 2)).all(axis=1)
    joined = np.zeros(len(track.frame) - 1, bool)  # whether a detection and the next are of one rest
    for k in range(count - 1):
        joined[k : k + len(still)] |= still
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(int)))
    found: list[tuple[int, int]] = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found:
            previous = rest_place(track, *found[-1])
            moved = np.linalg.norm(rest_place(track, first, last) - previous)
            returned = moved < max(6 * scene.sigma, 0.1 * scene.radius)
            between = np.linalg.norm(track.xy[found[-1][1] : first] - previous, axis=1)
            if returned and (between > scene.radius / 2).sum() < 3:  # the cue or a hand covered it
                found[-1] = (found[-1][0], last)
                continue
        found.append((first, last))
    return found


def rest_place(track: BallTrack, first: int, last: int) -> Array:
    return np.asarray(np.median(track.xy[first : last + 1], axis=0))


def moves_of(scene: TrackedScene, track: BallTrack, resting: Sequence[tuple[int, int]]) -> list[Move]:
    """Moves of a ball between its rests, by half a radius or more."""
    n = len(track.frame)
    found = []
    bounds = [None, *resting]
    for k, rest in enumerate(bounds):
        stop = resting[k][0] if k < len(resting) else n
        if rest is None:
            end = rest_place(track, *resting[0]) if resting else track.xy[stop - 1]
            far = np.linalg.norm(track.xy[:stop] - end, axis=1) > scene.radius / 2
            if stop > MIN_REST_DETECTIONS and far.sum() > 1:
                found.append(Move(track, 0, stop, None, -1))
            continue
        count = max(MIN_REST_DETECTIONS, int(MIN_REST_S / scene.period) + 1)
        place = rest_place(track, max(rest[0], rest[1] - 30 - count), max(rest[1] - count, rest[0] + 1))
        distance = np.linalg.norm(track.xy - place, axis=1)
        resting_part = distance[rest[0] : max(rest[1] - count, rest[0] + 1)]
        swing = min(1.2 * float(np.quantile(resting_part, SWING_QUANTILE)), MAX_SWING_RADII * scene.radius)
        away = distance > max(5 * scene.sigma, 0.02 * scene.radius, swing)
        first = max(rest[0] + 1, rest[1] - count)
        while first < stop and not away[first : first + 3].all():
            first += 1
        far = np.linalg.norm(track.xy[first:stop] - place, axis=1) > scene.radius / 2
        if far.sum() < 2:  # a shadow or the cue beside a ball shifts its detections, too
            continue
        gap = float(track.time[first] - track.time[first - 1])
        hidden = gap if gap > max(MAX_UNSEEN_S, 3.5 * scene.period) else 0.0
        bridged = not hidden or _leads_back(scene, track, first, stop, place)
        found.append(Move(track, first, stop, place if bridged else None, int(track.frame[first - 1]), hidden))
    return found


def _leads_back(scene: TrackedScene, track: BallTrack, first: int, stop: int, place: Array) -> bool:
    """Whether the path of a ball seen after a gap leads straight back to its rest, in less time than it was hidden."""
    gap = float(track.time[first] - track.time[first - 1])
    if gap > MAX_BRIDGED_S or stop - first < MIN_REST_DETECTIONS:
        return False
    velocity, offset = mean_velocity(track, first, stop), track.xy[first] - place
    speed, distance = float(np.linalg.norm(velocity)), float(np.linalg.norm(offset))
    aside = abs(float(velocity[0] * offset[1] - velocity[1] * offset[0])) / max(speed, 1e-9)
    straight = aside < max(MAX_ASIDE_RADII * scene.radius, 5 * scene.sigma) and float(velocity @ offset) > 0
    return straight and distance < speed * (gap + scene.period)


def mean_velocity(track: BallTrack, first: int, stop: int, most: int = 4) -> Array:
    """Mean velocity over the first few detections (2,) [m/s]."""
    last = min(first + most, stop, len(track.frame)) - 1
    if last <= first:
        first, last = max(first - 1, 0), max(last, 1)
    return np.asarray((track.xy[last] - track.xy[first]) / (track.time[last] - track.time[first]))


def fastest_step(track: BallTrack, first: int, stop: int, most: int = 4) -> float:
    """Greatest speed between two of the first few detections, before an impact slows the ball [m/s]."""
    last = min(first + most, stop, len(track.frame))
    steps = np.linalg.norm(np.diff(track.xy[first:last], axis=0), axis=1) / np.diff(track.time[first:last])
    return float(steps.max(initial=0.0))


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
        onwards = track.xy[last] + delays[:, None] * mean_velocity(track, max(last - 2, 0), last + 1)
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
