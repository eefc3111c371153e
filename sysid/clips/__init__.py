"""Tracked shots: read, checked and written, with what the tracks say of the camera and of events on the way.

In: a folder in the format `billiard-clips/1`. Out: a `ClipSet`.

    clip_set        the values: Observation, CueCommand, Clip, ClipSet
    read, write     whole or not at all; header, rows and keys of their files, faults in one line each
    plausibility    what rows must satisfy: times go forwards, balls lie on the table
    noise, clock    of the camera, from the tracks themselves
    outliers        samples that a tracker threw elsewhere
    segments        motion between events; pieces of one impact each; clips up to a pocket's jaws
"""

from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
from sysid.clips.read import check_clip_set, read_clip_set
from sysid.clips.write import write_clip_set

__all__ = ["Clip", "ClipSet", "CueCommand", "Observation", "check_clip_set", "read_clip_set", "write_clip_set"]
