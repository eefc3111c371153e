"""Detections of a ball that are not used, being beside its path.

In: the scene and a track. Out: the track without them.
"""

from __future__ import annotations

from models.messages import counted
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import TrackedScene


def without_strays(scene: TrackedScene, track: BallTrack, notes: list[str]) -> BallTrack:
    """A track without those detections that are none of the ball; appends to the notes."""
    _, stray = scene.read(track)
    if count := int(stray.sum()):
        notes.append(f"{track.name}: {counted(count, 'detection')} outlying: not used")
    return track.without(stray)
