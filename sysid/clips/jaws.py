"""Clips cut at the first touch of a pocket's jaws: the fitted models have pockets without jaws.

In: a `ClipSet`. Out: the same, every clip cut where needed.

A ball that touches a jaw and drops is followed up to the touch. Where it rebounds, it may meet other balls, so the
whole clip ends there. The jaws are those of models/analytic/pocket.py, with a margin.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.analytic.pocket import jaw_gaps, pockets_of
from models.commands.console import named
from models.errors import BadInput
from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.plausibility import POCKET_REACH

JAW_MARGIN_M = 3e-3  # allowance for noise and for the uncertainty of the jaws' position
MIN_CLIP_SAMPLES = 12  # of the struck ball: shorter clips are left out


def before_jaws(clip_set: ClipSet) -> ClipSet:
    """Cut every clip at the first touch of a jaw; leave out clips of which too few samples remain."""
    try:
        jaws = pockets_of(clip_set.table, clip_set.ball).jaws
    except BadInput:  # pockets that do not take these balls
        return clip_set
    if len(jaws) == 0:
        return clip_set
    clips = [_before(clip, clip_set, jaws) for clip in clip_set.clips]
    return dataclasses.replace(
        clip_set, clips=tuple(c for c in clips if len(c.balls[c.struck].time) >= MIN_CLIP_SAMPLES)
    )


def jaws_line(whole: ClipSet, cut: ClipSet) -> str | None:
    """A line on the clips that `before_jaws` cut and left out; None if there are none."""
    left = {clip.file: clip for clip in cut.clips}
    shorter = [clip.file for clip in whole.clips if left.get(clip.file, clip) is not clip]
    gone = [clip.file for clip in whole.clips if clip.file not in left]
    parts = [
        f"{named(files)} {'is' if len(files) == 1 else 'are'} {what}"
        for files, what in (
            (shorter, "used up to where a ball touches a pocket's jaws, which no fit follows"),
            (gone, "left out: a ball touches a pocket's jaws at once"),
        )
        if files
    ]
    return "; ".join(parts) or None


def _before(clip: Clip, clip_set: ClipSet, jaws: Array) -> Clip:
    end, ends = np.inf, {}
    last = max(float(seen.time[-1]) for seen in clip.balls.values())
    for name, seen in clip.balls.items():
        touched = _touched(seen, jaws)
        if touched is None:
            continue
        away = clip_set.table.to_pocket(seen.xy[-1])
        if away < clip_set.ball.radius or (away < POCKET_REACH * clip_set.ball.diameter and seen.time[-1] < last):
            ends[name] = touched
        else:
            end = min(end, touched)
    if end == np.inf and not ends:
        return clip
    balls = {name: _until(seen, min(end, ends.get(name, np.inf))) for name, seen in clip.balls.items()}
    return dataclasses.replace(clip, balls=balls)


def _touched(seen: Observation, jaws: Array) -> float | None:
    """When a ball that moves first meets a jaw [s]."""
    gap = jaw_gaps(seen.xy, jaws)
    met = np.flatnonzero((gap < JAW_MARGIN_M).any(axis=1))
    if met.size == 0 or np.ptp(seen.xy, axis=0).max() < JAW_MARGIN_M:
        return None
    return float(seen.time[met[0]])


def _until(seen: Observation, end: float) -> Observation:
    rows = np.flatnonzero(seen.time < end)
    if rows.size == len(seen.time):
        return seen
    rows = rows if rows.size else np.array([0])
    return seen.at(rows)
