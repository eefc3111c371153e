"""Held-out shots that a model does not follow, although it follows the others: they and training shots change places.

In: clips (`Split`) and a fit. Out: the clips, with such shots among those in which causes are sought.

A law that explains a few clips may be the law of these alone. That a held-out clip contradicts it says that something
else is missing, but not what: that shows where the clip is a training clip. So causes are sought again, as in another
fold of a cross-validation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

from sysid.clips import Clip
from sysid.estimation.fitted import FittedModel
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.split import Split
from sysid.selection.departures import departing_held_out


def exchanged(parts: Split, last: FittedModel) -> Split | None:
    """The clips with held-out ones that a fit does not follow used for training.

    In place of each, the training clip nearest in the session is held out. None if all are followed, or had come from
    there before.
    """
    held_out, moved = parts.held_out, {file for file, _ in parts.exchanged}
    if held_out is None:
        return None
    coming = [held_out.clips[k] for k in departing_held_out(last) if held_out.clips[k].file not in moved]
    going = _nearest(coming, [clip for clip in parts.training.clips if clip.file not in moved])
    if not coming or len(going) < len(coming):
        return None
    pairs = tuple((one.file, two.file) for one, two in zip(coming, going, strict=True))
    return dataclasses.replace(
        parts, training=_with_clips(parts.training, coming, going), held_out=_with_clips(held_out, going, coming),
        exchanged=(*parts.exchanged, *pairs),
    )  # fmt: skip


def _nearest(coming: Sequence[Clip], free: Sequence[Clip]) -> list[Clip]:
    """For each clip another one of those that are free, the nearest in the session; fewer if there are too few."""
    found, left = list[Clip](), list(free)
    for clip in coming[: len(left)]:
        found.append(min(left, key=lambda one: abs(one.session.order - clip.session.order)))
        left = [one for one in left if one is not found[-1]]
    return found


def _with_clips(problem: ShotProblem, coming: Sequence[Clip], going: Sequence[Clip]) -> ShotProblem:
    """The problem with other clips, in the order of the session."""
    gone = {clip.file for clip in going}
    clips = sorted((*coming, *(c for c in problem.clips if c.file not in gone)), key=lambda clip: clip.session.order)
    few = dataclasses.replace(problem.clip_set, clips=tuple(clips))
    return shot_problem(
        problem.model, problem.names, few, problem.noise, problem.known, problem.correlation_time, problem.slow_noise
    )
