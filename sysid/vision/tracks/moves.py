"""From paths to moves: where each ball rests, when it goes, and where it drops.

A ball rests where its sightings keep to one place; a move is its way from one rest to the next.
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
from sysid.vision.tracks.follow import Path

REST = 0.15  # in which a ball that rests keeps its place [s]
FEWEST = 4  # sightings of a rest
UNSEEN = 0.1  # a ball that was hidden for so long was set in motion unseen [s]
POTTED = 0.1  # after its last sighting within which a ball drops [s]


@dataclass(frozen=True)
class Scene:
    """All that was seen, and on what."""

    paths: Sequence[Path]
    frames: NDArray[np.int64]  # (m,) indices of the frames that were read
    times: Array  # (m,) [s]
    table: Table
    radius: float  # of the balls [m]
    sigma: float  # of a sighting, one standard deviation per axis [m]

    def when(self, frame: int) -> float:
        """Time of a frame [s]."""
        return float(self.times[np.searchsorted(self.frames, frame)])

    @cached_property
    def period(self) -> float:
        """Between two frames [s]."""
        return float(np.median(np.diff(self.times))) if len(self.times) > 1 else 1.0

    @cached_property
    def resting(self) -> dict[str, list[tuple[int, int]]]:
        """First and last sighting of every rest of every ball."""
        return {path.name: rests(self, path) for path in self.paths}

    @cached_property
    def moves(self) -> list[Move]:
        """What all balls do between their rests."""
        return [move for path in self.paths for move in moves_of(self, path, self.resting[path.name])]

    def lies(self, path: Path) -> NDArray[np.bool_]:
        """Which sightings of a ball are of it at rest: (n,)."""
        found = np.zeros(len(path.time), bool)
        for first, last in self.resting[path.name]:
            found[first : last + 1] = True
        return found


@dataclass(frozen=True)
class Move:
    """A ball's way from one rest to the next."""

    path: Path
    first: int  # its first sighting away from where it rested
    stop: int  # sighting that begins the next rest; that after the last one, if there is none
    place: Array | None  # where it rested (2,) [m]; None if that was not seen
    before: int  # frame in which it was last seen at rest

    @property
    def name(self) -> str:
        """The ball."""
        return self.path.name

    @property
    def began(self) -> int:
        """The first frame in which it had moved."""
        return int(self.path.frame[self.first])

    @property
    def onset(self) -> float:
        """When it began to move, by its first sightings on the way [s]; those before may have been too near to tell."""
        path, first = self.path, self.first
        if self.place is None:
            return float(path.time[first])
        speed = float(np.linalg.norm(speed_of(path, first, self.stop)))
        way = float(np.linalg.norm(path.xy[first] - self.place))
        return max(float(path.time[first]) - way / max(speed, 1e-6), float(path.time[max(first - 3, 0)]))

    @property
    def lost(self) -> bool:
        """Whether it was seen no more."""
        return self.stop == len(self.path.frame)

    @property
    def ended(self) -> int:
        """The last frame in which it moved."""
        return int(self.path.frame[self.stop - 1])


def rests(scene: Scene, path: Path) -> list[tuple[int, int]]:
    """First and last sighting of every rest."""
    count = max(FEWEST, math.ceil(REST / scene.period) + 1)
    if len(path.frame) < count:
        return []
    room = 2 * max(4 * scene.sigma, 0.025 * scene.radius)
    windows = np.lib.stride_tricks.sliding_window_view(path.xy, count, axis=0)
    still = (np.ptp(windows, axis=2) < room).all(axis=1)
    joined = np.zeros(len(path.frame) - 1, bool)  # a sighting and the next one, at rest in one place
    for k in range(count - 1):
        joined[k : k + len(still)] |= still
    edges = np.flatnonzero(np.diff(np.concatenate([[False], joined, [False]]).astype(int)))
    found: list[tuple[int, int]] = []
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if found:
            old = place_of(path, *found[-1])
            back = np.linalg.norm(place_of(path, first, last) - old) < max(6 * scene.sigma, 0.1 * scene.radius)
            between = np.linalg.norm(path.xy[found[-1][1] : first] - old, axis=1)
            if back and (between > scene.radius / 2).sum() < 3:  # the cue or a hand was over it
                found[-1] = (found[-1][0], last)
                continue
        found.append((first, last))
    return found


def place_of(path: Path, first: int, last: int) -> Array:
    return np.asarray(np.median(path.xy[first : last + 1], axis=0))


def moves_of(scene: Scene, path: Path, resting: Sequence[tuple[int, int]]) -> list[Move]:
    """What a ball does between its rests, but for less than half a radius, or where it was put elsewhere unseen."""
    n = len(path.frame)
    found = []
    bounds = [None, *resting]
    for k, rest in enumerate(bounds):
        stop = resting[k][0] if k < len(resting) else n
        if rest is None:
            if stop > FEWEST:
                found.append(Move(path, 0, stop, None, -1))
            continue
        count = max(FEWEST, math.ceil(REST / scene.period) + 1)
        place = place_of(path, max(rest[0], rest[1] - 30 - count), max(rest[1] - count, rest[0] + 1))
        away = np.linalg.norm(path.xy - place, axis=1) > max(5 * scene.sigma, 0.02 * scene.radius)
        first = max(rest[0] + 1, rest[1] - count)
        while first < stop and not away[first : first + 3].all():
            first += 1
        far = np.linalg.norm(path.xy[first:stop] - place, axis=1) > scene.radius / 2
        if far.sum() < 2:  # a shadow or the cue beside it moves what is seen of a ball, too
            continue
        hidden = path.time[first] - path.time[first - 1] > max(UNSEEN, 3.5 * scene.period)
        found.append(Move(path, first, stop, None if hidden else place, int(path.frame[first - 1])))
    return found


def speed_of(path: Path, first: int, stop: int, most: int = 4) -> Array:
    """Mean velocity over the first few sightings (2,) [m/s]."""
    last = min(first + most, stop, len(path.frame)) - 1
    if last <= first:
        first, last = max(first - 1, 0), max(last, 1)
    return np.asarray((path.xy[last] - path.xy[first]) / (path.time[last] - path.time[first]))


def pocketed(scene: Scene, path: Path, part: NDArray[np.int64]) -> int | None:
    """The last frame before a ball is in a pocket, of these sightings of it; None if it does not drop."""
    if not scene.table.pockets or part.size < 2:
        return None
    # A ball that drops is seen no more, or elsewhere and later.
    breaks = [*np.flatnonzero(np.diff(path.time[part]) > max(POTTED, 3.5 * scene.period)).tolist(), part.size - 1]
    for k in breaks:
        last = int(part[k])
        if last + 1 < len(path.time) and path.time[last + 1] - path.time[last] < POTTED:
            continue
        ways = np.linspace(0, max(POTTED, 3 * scene.period), 40)
        if scene.times[-1] - path.time[last] < ways[-1] / 2:
            ways = ways[:1]
        onwards = path.xy[last] + ways[:, None] * speed_of(path, max(last - 2, 0), last + 1)
        if _in_mouth(scene, onwards, scene.radius / 2).any():
            kept = part[: k + 1][~_in_mouth(scene, path.xy[part[: k + 1]], 0.0)]
            return int(path.frame[kept[-1]]) if kept.size else None
    return None


def _in_mouth(scene: Scene, xy: Array, room: float) -> NDArray[np.bool_]:
    """Whether places (n, 2) lie beyond the noses' lines, less some room [m], where there is a pocket."""
    corner, middle, capture = scene.table.mouths()
    over = np.abs(xy) - np.array([scene.table.length, scene.table.width]) / 2
    end, side = over[:, 0] > -room, over[:, 1] > -room
    across = (over[:, 0] > -corner) | (np.abs(xy[:, 0]) < middle)
    return np.asarray((end & (over[:, 1] > -corner)) | (side & across) | (np.hypot(*over.T) < capture))
