"""Tracked shots: read, checked, written and cut; noise and clock of the camera.

In: a folder in the format `billiard-clips/1`. Out: a `ClipSet`.

    clip_set        the values: Observation, CueCommand, Clip, ClipSet
    read, write     whole or not at all; header and rows of their files, names of balls and clips
    choose          one clip, as users name it
    template        a clip set to fill in
    plausibility    times increase, balls are on the table and do not overlap
    trust           doubts about the camera, carried along
    running         clips that begin in mid-motion, and which balls move then
    consistency     what the tracks of a set contradict: units and axes, sizes, commands, times, marks, the strike
    tracker         noise and clock of the camera, and samples that the tracker placed elsewhere
    segments        motion between two impacts
    jaws            clips up to the first touch of a pocket's jaws
"""

from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
from sysid.clips.read import Inspection, check_clip_set, inspect_clip_set, read_clip_set
from sysid.clips.write import write_clip_set

__all__ = [
    "Clip",
    "ClipSet",
    "CueCommand",
    "Inspection",
    "Observation",
    "check_clip_set",
    "inspect_clip_set",
    "read_clip_set",
    "write_clip_set",
]
