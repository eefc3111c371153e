"""Impossible turned angles of marks: in degrees, or wrapped at every turn.

In: a `ClipSet`. Out: a `Contradiction`. A cue at the miscue limit, half a radius off the centre, gives sidespin of
5/4 v / R: 350 rad/s for a hard break.
"""

from __future__ import annotations

import numpy as np

from models.shot import Array
from sysid.clips.clip_set import ClipSet
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction

MAX_SPIN_RAD_S = 350.0
MIN_STEPS = 10  # fewest steps of one mark for a median rate
LEAST_TURN_RAD_S = 1.0  # least rate of a turning mark
TURN_TOLERANCE_RAD = 0.6  # largest deviation of a jump from a whole turn, relative to the steps around it
MIN_JUMPS = 3


def marks(clip_set: ClipSet) -> Contradiction | None:
    """Contradictions by marks that turn faster than any ball, or jump by whole turns."""
    rates, jumps, first = [], 0, ""
    for clip in clip_set.clips:
        for seen in clip.balls.values():
            known = np.isfinite(seen.theta)
            time, step = np.diff(seen.time[known]), np.diff(seen.theta[known])
            if len(step) < MIN_STEPS:
                continue
            rate = float(np.median(np.abs(step / time)))
            rates += [rate] if rate > LEAST_TURN_RAD_S else []
            count = _jumps(step)
            first = first or clip.file * (count > 0)
            jumps += count
    rate = float(np.median(rates)) if rates else 0.0
    if rate > MAX_SPIN_RAD_S:
        text = (
            f"marks turn by {rate:.0f} rad/s, and no cue gives more than {MAX_SPIN_RAD_S:.0f}: write theta in radians"
        )
        return Contradiction(ALL_CLIPS, text, True)
    if jumps < MIN_JUMPS:
        return None
    text = f"theta jumps by a whole turn in {jumps} places ({first} first): unwrap it, to continue beyond a turn"
    return Contradiction(ALL_CLIPS, text, True)


def _jumps(step: Array) -> int:
    """Number of steps that differ by a whole turn from those around them."""
    off = np.abs(np.abs(step - np.median(step)) - 2 * np.pi)
    return int(np.sum(off < TURN_TOLERANCE_RAD))
