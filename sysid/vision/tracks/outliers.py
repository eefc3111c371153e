"""Detections of a ball that are not used: inaccurate ones, and ones beside its path.

In: a track. Out: the track without them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sysid.clips import Observation
from sysid.clips.outliers import find_outliers
from sysid.vision.camera.projection import Array
from sysid.vision.tracks.follow import BallTrack

MAX_SD_RADII = 0.15  # of a detection; ones less accurate than this and than most of the ball's are not used
MAX_ASIDE_SD = 4.0  # of a place from the line between its neighbours, on which it may be early or late,
MAX_ASIDE_M = 1e-3  # or this far


def without_outliers(track: BallTrack, sigma: float, radius: float, notes: list[str]) -> BallTrack:
    """A track of a ball of a radius [m] without inaccurate detections and outliers; appends to the notes."""
    inaccurate = track.sd > np.maximum(MAX_SD_RADII * track.radius, np.median(track.sd))
    track = track.without(inaccurate) if inaccurate.any() else track
    outlying = find_outliers(Observation(track.time, track.xy, np.full(len(track.time), np.nan)), sigma)
    sd = np.hypot(sigma, radius * track.sd / np.maximum(track.radius, 1.0))  # a ball that is swept far is blurred
    outlying &= ~_on_the_way(track.xy, np.maximum(MAX_ASIDE_SD * sd, MAX_ASIDE_M))
    if count := int(inaccurate.sum() + outlying.sum()):
        notes.append(f"{track.name}: {count} detection{'s' * (count > 1)} too inaccurate or outlying: not used")
    return track.without(outlying)


def _on_the_way(xy: Array, room: Array) -> NDArray[np.bool_]:
    """Which places (n, 2) lie between their neighbours, near the line that joins them: early or late, but of the ball.

    `room` (n,) is how near [m].
    """
    found = np.zeros(len(xy), bool)
    if len(xy) < 3:
        return found
    chord, offset = xy[2:] - xy[:-2], xy[1:-1] - xy[:-2]
    length = np.maximum(np.linalg.norm(chord, axis=1), 1e-9)
    along = np.sum(offset * chord, axis=1) / length
    aside = np.abs(offset[:, 0] * chord[:, 1] - offset[:, 1] * chord[:, 0]) / length
    found[1:-1] = (along > 0) & (along < length) & (aside < room[1:-1])
    return found
