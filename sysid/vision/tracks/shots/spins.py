"""Balls that spin in place: their face changes from picture to picture while they are at rest and nothing else moves.

In: pictures, for the change of a face; then the tracked scene and its shots. Out: spins as shots without speed. Fingers
spin one ball: where several faces change at once, the pictures do, as those made of fields do from row to row.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene
from sysid.vision.tracks.shots.strikes import TrackedShot

FACE_RADII = 0.7  # radius of the disc that certainly shows the ball
MIN_FACE_CHANGE = 1.25  # relative to that of a ball at rest, from which on a ball spins
MEDIAN_DETECTIONS = 7  # width of the running median of the change
MIN_SPIN_S = 0.3  # duration
HIDDEN_MARGIN_S = 0.1  # before and after a ball was hidden, as by the fingers that spin it, in which it is not judged
MARGIN_FRAMES = 2  # between a motion and a spin

Picture = NDArray[np.uint8]


def face_change(before: Picture, picture: Picture, xy: Array, radius: float, noise: float) -> float:
    """Change of the face of a ball at xy (2,) [pixels] since the previous picture, in units of the noise.

    A uniform change of the light does not count. NaN where the face is not wholly in the picture.
    """
    r = FACE_RADII * radius
    x0, y0 = (int(np.ceil(v - r)) for v in xy)
    x1, y1 = (int(np.floor(v + r)) + 1 for v in xy)
    h, w = picture.shape[:2]
    if x0 < 0 or y0 < 0 or x1 > w or y1 > h or x1 - x0 < 3:
        return float("nan")
    difference = cv2.subtract(picture[y0:y1, x0:x1], before[y0:y1, x0:x1], dtype=cv2.CV_32F)
    y, x = np.ogrid[y0:y1, x0:x1]
    face = difference[(x - xy[0]) ** 2 + (y - xy[1]) ** 2 < r**2]
    return float(np.sqrt(0.5 * np.mean(face.var(axis=0)))) / max(noise, 1.0)


def spins(scene: TrackedScene, shots: Sequence[TrackedShot]) -> list[TrackedShot]:
    """Spins in place, as shots without speed, that do not overlap in time with the other shots or any move."""
    busy = np.zeros(len(scene.frames), bool)
    for first, last in [(s.first, s.last) for s in shots] + [(m.before, m.ended) for m in scene.moves]:
        busy[slice(*np.searchsorted(scene.frames, (first - MARGIN_FRAMES, last + MARGIN_FRAMES + 1)).tolist())] = True
    changing = np.zeros(len(scene.frames), int)  # balls
    for track in scene.tracks:
        changing[np.searchsorted(scene.frames, track.frame)[_is_changing(track.face_change)]] += 1
    busy |= changing > 1
    found = []
    for track in scene.tracks:
        free = ~busy[np.searchsorted(scene.frames, track.frame)]
        for begin, end in scene.resting[track.name]:
            rows = np.arange(begin, end + 1)
            spinning = free[rows] & _is_changing(track.face_change[rows])
            hidden = np.diff(track.time[rows], prepend=-np.inf) > 2.5 * scene.period
            for since in track.time[rows][hidden][1:]:
                spinning &= (track.time[rows] < since) | (track.time[rows] > since + HIDDEN_MARGIN_S)
            edges = np.flatnonzero(np.diff(np.concatenate([[False], spinning, [False]]).astype(int)))
            for low, high in zip(edges[::2], edges[1::2] - 1, strict=True):
                first, last = int(rows[low]), int(rows[high])
                if track.time[last] - track.time[first] >= MIN_SPIN_S:
                    found.append(_spin(scene, track, first, last))
    return found


def _is_changing(values: Array) -> NDArray[np.bool_]:
    """Where a face changes, by the running median of its change (n,)."""
    known = np.where(np.isfinite(values), values, 1.0)
    padded = np.pad(known, MEDIAN_DETECTIONS // 2, mode="edge")
    return np.asarray(
        np.median(np.lib.stride_tricks.sliding_window_view(padded, MEDIAN_DETECTIONS), axis=1) > MIN_FACE_CHANGE
    )


def _spin(scene: TrackedScene, track: BallTrack, first: int, last: int) -> TrackedShot:
    """A spin as a shot, with the balls that are at rest during it."""
    begin, end = int(track.frame[first]), int(track.frame[last])
    others = [
        other.name
        for other in scene.tracks
        if other.name != track.name
        and any(other.frame[a] <= begin and other.frame[b] >= end for a, b in scene.resting[other.name])
    ]
    return TrackedShot(track.name, float(track.time[first]), begin, end, (track.name, *others), 0.0, {}, spun=True)
