"""Detections of a ball that are not used: inaccurate ones, and ones beside its path.

In: the scene and a track. Out: the track without them.
"""

from __future__ import annotations

import numpy as np

from models.messages import counted
from sysid.vision.tracks.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene

MAX_SD_RADII = 0.15  # of a detection; ones less accurate than this and than most of the ball's are not used


def without_strays(scene: TrackedScene, track: BallTrack, notes: list[str]) -> BallTrack:
    """A track without inaccurate detections and those that are none of the ball; appends to the notes."""
    inaccurate = track.sd > np.maximum(MAX_SD_RADII * track.radius, np.median(track.sd))
    track = track.without(inaccurate) if inaccurate.any() else track
    _, stray = scene.read(track)
    if count := int(inaccurate.sum() + stray.sum()):
        notes.append(f"{track.name}: {counted(count, 'detection')} too inaccurate or outlying: not used")
    return track.without(stray)
