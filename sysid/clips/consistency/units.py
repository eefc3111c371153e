"""Units, origin and axes of a whole clip set: coordinates or times that are wrong in the same way everywhere.

In: a clip set with the table and the frame rate that clips.toml states. Out: one fault in place of one for every row.
Where many rows lie off the table, the likeliest reading (sysid/clips/consistency/readings.py) is named.
"""

from __future__ import annotations

import numpy as np

from models.shot import Array
from sysid.clips.clip_set import ClipSet
from sysid.clips.consistency.aims import reading_command
from sysid.clips.consistency.readings import (
    all_readings,
    directed,
    likely_readings,
    may_be_pixels,
    places,
    possible_readings,
    share_inside,
)

SECONDS_BY_UNIT = {"milliseconds": 1e-3, "microseconds": 1e-6}
MIN_SHARE_OUTSIDE = 0.05  # least share of a clip's rows off the table for its coordinates to be suspect
MIN_SHARE_SUSPECT = 0.5  # least share of suspect clips for the set to be suspect
MIN_ROWS = 30  # sets with fewer rows are judged row by row
MIN_PIXELS = 3.0  # least ratio of coordinates to the table in metres if they are in no unit of length
MAX_OFF_UNIT = 0.3  # largest relative difference of an interval from a frame's in another unit
MIN_FRAMES_APART = 5.0  # nominal frames between rows, from which whole numbers count frames
WHOLE_TOLERANCE = 1e-6


def coordinates_fault(clip_set: ClipSet) -> str | None:
    """A fault if the coordinates of most clips follow another convention than metres from the centre."""
    table, ball = clip_set.table, clip_set.ball
    all_xy = [xy for xy in places(clip_set.clips) if len(xy)]
    suspect = [share_inside(xy, table, ball) < 1 - MIN_SHARE_OUTSIDE for xy in all_xy]
    if sum(map(len, all_xy)) < MIN_ROWS or np.mean(suspect) < MIN_SHARE_SUSPECT:
        return None
    (x0, y0), (x1, y1) = np.percentile(np.concatenate(all_xy), (0, 100), axis=0)
    head = f"x = {x0:.4g} to {x1:.4g}, y = {y0:.4g} to {y1:.4g} on a table of {table.length:g} x {table.width:g} m"
    fits = likely_readings(clip_set, [one for one in all_readings() if one.changes])
    if fits:
        best = directed(clip_set, fits[0].reading) or fits[0].reading
        command = reading_command(clip_set, best.options())
        text = f"{head} look like {best.looks()}: {command}, or {best.remedy()}"
        if may_be_pixels(clip_set) and not fits[0].shows_scale:
            text += (
                f"; if they are pixels, calibrate the camera, then: {reading_command(clip_set, '--camera CAM.toml')}"
            )
        return text
    if max(x1 - x0, y1 - y0) < MIN_PIXELS * table.length:
        return None
    command = reading_command(clip_set, "--camera CAM.toml")
    return f"{head} fit no unit of length; if they are pixels, calibrate the camera, then: {command}"


def clip_fault(clip_set: ClipSet) -> str | None:
    """A fault if one clip alone follows another convention, so that hardly a row is on the table."""
    [xy] = places(clip_set.clips)
    if not len(xy) or share_inside(xy, clip_set.table, clip_set.ball) > MIN_SHARE_OUTSIDE:
        return None
    readings = [one for one in all_readings() if one.changes]
    fits = likely_readings(clip_set, readings) or possible_readings(clip_set, readings)
    if not fits:
        return None
    best = min(fits, key=lambda one: (-one.support, -one.coverage, one.reading.changes)).reading
    (x0, y0), (x1, y1) = np.percentile(xy, (0, 100), axis=0)
    here = f"x = {x0:.4g} to {x1:.4g}, y = {y0:.4g} to {y1:.4g}"
    return f"{here} look like {best.looks()}, other than in the rest of the set: {best.remedy()}"


def steps_of(clip_set: ClipSet) -> Array:
    """Intervals between the rows of all clips: (n,), in the unit of the times."""
    stamps = [np.concatenate([np.zeros(0), *(o.time for o in clip.balls.values())]) for clip in clip_set.clips]
    return np.concatenate([np.zeros(0), *(np.diff(np.unique(t[np.isfinite(t)])) for t in stamps)])


def are_whole(steps: Array) -> bool:
    """Whether all intervals are whole numbers."""
    return bool(len(steps)) and bool((np.abs(steps - np.round(steps)) < WHOLE_TOLERANCE).all())


def times_fault(clip_set: ClipSet) -> str | None:
    """A fault if the times of all clips are in another unit than seconds."""
    fps, steps = clip_set.fps, steps_of(clip_set)
    if len(steps) < MIN_ROWS:
        return None
    step = float(np.median(steps))
    head = f"rows are {step:.4g} apart where {fps:g} frames a second make {1 / fps:.4g} s"
    for unit, seconds in SECONDS_BY_UNIT.items():
        if abs(step * fps * seconds - 1) < MAX_OFF_UNIT:
            command = reading_command(clip_set, f"--time {unit}")
            return f"{head}, and t looks like {unit}: {command}, or divide it by {1 / seconds:.0f}"
    if are_whole(steps) and step < MIN_FRAMES_APART and step * min(fps, 1.0) >= 1:
        command = reading_command(clip_set, f"--time frames --fps {'F' if fps <= 1 else f'{fps:g}'}")
        return f"{head}, and t counts frames: {command}, or divide it by the frame rate"
    return None
