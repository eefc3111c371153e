"""Balls that spin in place: their face changes from picture to picture, while they rest and nothing else moves."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.tracks.follow import Path
from sysid.vision.tracks.moves import Scene
from sysid.vision.tracks.strikes import Shot

FACE = 0.7  # part of the radius that is surely the ball
ALIVE = 1.25  # change of a face, in that of one that rests, from which on it turns
SMOOTH = 7  # sightings over which that is judged
LEAST = 0.3  # of a spin that is told [s]
SETTLED = 0.1  # a ball that was hidden, as fingers that spin it hide it, is left alone for so long [s]
BESIDE = 2  # frames between a motion and a spin

Picture = NDArray[np.uint8]


def change(before: Picture, picture: Picture, xy: Array, radius: float, noise: float) -> float:
    """How much of a ball's face (xy (2,), radius [pixels]) is another than in the picture before; 1 if that is noise.

    Light that changes for all of it alike is no change. NaN where the face is not in the picture.
    """
    r = FACE * radius
    x0, y0 = (int(np.ceil(v - r)) for v in xy)
    x1, y1 = (int(np.floor(v + r)) + 1 for v in xy)
    h, w = picture.shape[:2]
    if x0 < 0 or y0 < 0 or x1 > w or y1 > h or x1 - x0 < 3:
        return float("nan")
    off = cv2.subtract(picture[y0:y1, x0:x1], before[y0:y1, x0:x1], dtype=cv2.CV_32F)
    y, x = np.ogrid[y0:y1, x0:x1]
    face = off[(x - xy[0]) ** 2 + (y - xy[1]) ** 2 < r**2]
    return float(np.sqrt(0.5 * np.mean(face.var(axis=0)))) / max(noise, 1.0)


def spins(scene: Scene, shots: Sequence[Shot]) -> list[Shot]:
    """Spins in place, as shots without speed, beside those shots that have one."""
    busy = np.zeros(len(scene.frames), bool)
    for first, last in [(s.first, s.last) for s in shots] + [(m.before, m.ended) for m in scene.moves]:
        busy[slice(*np.searchsorted(scene.frames, (first - BESIDE, last + BESIDE + 1)).tolist())] = True
    found = []
    for path in scene.paths:
        free = ~busy[np.searchsorted(scene.frames, path.frame)]
        for begin, end in scene.resting[path.name]:
            rows = np.arange(begin, end + 1)
            alive = free[rows] & _alive(path.change[rows])
            hidden = np.diff(path.time[rows], prepend=-np.inf) > 2.5 * scene.period
            for since in path.time[rows][hidden][1:]:
                alive &= (path.time[rows] < since) | (path.time[rows] > since + SETTLED)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], alive, [False]]).astype(int)))
            for low, high in zip(edges[::2], edges[1::2] - 1, strict=True):
                first, last = int(rows[low]), int(rows[high])
                if path.time[last] - path.time[first] >= LEAST:
                    found.append(_spin(scene, path, first, last))
    return found


def _alive(values: Array) -> NDArray[np.bool_]:
    """Where a face changes, by the middle of its neighbours' changes (n,)."""
    known = np.where(np.isfinite(values), values, 1.0)
    padded = np.pad(known, SMOOTH // 2, mode="edge")
    return np.asarray(np.median(np.lib.stride_tricks.sliding_window_view(padded, SMOOTH), axis=1) > ALIVE)


def _spin(scene: Scene, path: Path, first: int, last: int) -> Shot:
    """A spin, with the balls that rest meanwhile."""
    begin, end = int(path.frame[first]), int(path.frame[last])
    others = [
        other.name
        for other in scene.paths
        if other.name != path.name
        and any(other.frame[a] <= begin and other.frame[b] >= end for a, b in scene.resting[other.name])
    ]
    return Shot(path.name, float(path.time[first]), begin, end, (path.name, *others), 0.0, {}, spun=True)
