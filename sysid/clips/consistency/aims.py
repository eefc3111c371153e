"""Commanded azimuths and speeds against where and how fast struck balls set off.

In: a `ClipSet`. Out: `Contradiction`s. The struck ball first moves where the cue was aimed, but for
squirt and swerve.
"""

from __future__ import annotations

import shlex

import numpy as np

from models.commands.console import as_called
from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction

MIN_COMMANDS = 4  # fewer commands are not judged
SOUND_TURN, FITTING_TURN = 0.25, 0.1  # first direction off the aim: no fault, and explained by a remedy [rad]
AIMED_M = 0.08  # the first direction is measured over this distance
SOUND_PACE, CERTAIN_PACE = 0.12, 0.3  # |log(first speed / commanded speed)|: no fault up to here, and a certain fault
SLIDE_M_S2 = 2.5  # largest deceleration of a sliding ball, 0.25 g
MAX_PACE_SPREAD = 0.5  # spread over the departure; a larger one speaks for careless shots, not for a common cause
READINGS_OF_AZIMUTH = {  # (factor, offset) of the azimuth, and the remedy where tracks fit that
    (-1.0, 0.0): "y is counted downwards, or azimuths clockwise: change the sign of y",
    (-1.0, np.pi): "x is counted from right to left: change the sign of x",
    (1.0, np.pi): "both axes are reversed: change the signs of x and y",
    (-1.0, np.pi / 2): "x and y are exchanged, or azimuths count from y: exchange the columns",
    (1.0, np.pi / 2): "azimuths are counted from -y: add a quarter turn to them",
    (1.0, -np.pi / 2): "azimuths are counted from +y: subtract a quarter turn from them",
}
IMPORT_OPTIONS = {  # of `sysid import`, for readings that turn the tracks
    (-1.0, 0.0): "--y down",
    (-1.0, np.pi): "--y down --turned",
    (1.0, np.pi): "--turned",
}


def reading_command(clip_set: ClipSet, options: str) -> str:
    """The `sysid import` command that reads a clip set's files with these options."""
    command = f"sysid import {shlex.quote(str(clip_set.folder))} {options} --out FIXED"
    return as_called(command)


def aims(clip_set: ClipSet) -> Array | None:
    """Commanded azimuths, and first directions of the struck balls: (n, 2) [rad]; None of too few."""
    found = [(c.cue.azimuth, went) for c in clip_set.clips if c.cue and (went := _first_direction(c)) is not None]
    return np.array(found) if len(found) >= MIN_COMMANDS else None


def off_aim(pairs: Array, factor: float = 1.0, offset: float = 0.0) -> float:
    """Median angle between first directions and azimuths, for a reading of the azimuths [rad]."""
    stated, went = pairs.T
    return float(np.median(np.abs((went - factor * stated - offset + np.pi) % (2 * np.pi) - np.pi)))


def azimuths(clip_set: ClipSet) -> Contradiction | None:
    """Contradictions between the commanded azimuths and the tracks."""
    pairs = aims(clip_set)
    if pairs is None or off_aim(pairs) < SOUND_TURN:
        return None
    best = min(READINGS_OF_AZIMUTH, key=lambda reading: off_aim(pairs, *reading))
    head = f"struck balls set off {off_aim(pairs):.2f} rad from the commanded azimuth (median of {len(pairs)})"
    if off_aim(pairs, *best) < FITTING_TURN:
        options = IMPORT_OPTIONS.get(best)
        command = f" (or: {reading_command(clip_set, options)})" if options else ""
        return Contradiction(ALL_CLIPS, f"{head}; {READINGS_OF_AZIMUTH[best]}{command}", True)
    return Contradiction(ALL_CLIPS, f"{head}: correct cue.azimuth, counted from +x to +y in rad, or omit cue", False)


def _first_direction(clip: Clip) -> float | None:
    """The struck ball's first direction [rad]; None where it hardly moves."""
    first = _first_way(clip)
    return None if first is None else float(np.arctan2(first[1], first[0]))


def _first_way(clip: Clip) -> Array | None:
    """The struck ball's first displacement in space and time (x, y, t) [m, m, s]; None if it hardly moves."""
    seen = clip.balls.get(clip.struck)
    far = np.zeros(0) if seen is None else np.flatnonzero(np.hypot(*(seen.xy - seen.xy[:1]).T) > AIMED_M)
    if seen is None or not len(far):
        return None
    return np.array([*(seen.xy[far[0]] - seen.xy[0]), seen.time[far[0]] - seen.time[0]])


def speeds_of_cue(clip_set: ClipSet) -> Contradiction | None:
    """Contradiction by commanded speeds that all differ from the tracks' by one factor."""
    pace = [
        _pace(float(np.hypot(way[0], way[1]) / way[2]), float(way[2]), c.cue.speed)
        for c in clip_set.clips
        if c.cue and c.cue.speed > 0 and (way := _first_way(c)) is not None and way[2] > 0
    ]
    if len(pace) < MIN_COMMANDS:
        return None
    off = float(np.median(pace))
    spread = 1.4826 * float(np.median(np.abs(np.array(pace) - off)))
    if abs(off) < SOUND_PACE or spread > MAX_PACE_SPREAD * abs(off):
        return None
    text = (
        f"struck balls set off at {np.exp(off):.2f} of the commanded speed (median of {len(pace)}): correct t and fps, "
        "or cue.speed, which is the speed of the ball, or omit cue"
    )
    return Contradiction(ALL_CLIPS, text, abs(off) > CERTAIN_PACE)


def _pace(mean: float, time: float, commanded: float) -> float:
    """Logarithm of a ball's first speed over the commanded one, whether it slides or rolls at first; 0 if it fits.

    Over a time it moves at a mean speed, and at first by half its deceleration times that time faster.
    """
    slowest, fastest = np.log(mean / commanded), np.log((mean + SLIDE_M_S2 * time / 2) / commanded)
    return float(slowest if slowest > 0 else fastest if fastest < 0 else 0.0)
