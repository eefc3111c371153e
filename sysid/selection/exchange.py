"""Held-out shots that a model does not follow, although it follows the others: they and training shots change places.

In: clips (`Split`) and their fits. Out: both, with such shots among those in which causes are sought.

A law that explains a few clips may be the law of these alone. That a held-out clip contradicts it says that something
else is missing, but not what: that shows where the clip is a training clip. So the search goes on as in another fold of
a cross-validation.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence

import numpy as np

from sysid.clips import Clip
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.split import Split, fit_on
from sysid.selection.departures import departing_held_out

log = logging.getLogger(__name__)


def exchanged(parts: Split, fits: Sequence[FittedModel]) -> tuple[Split, tuple[FittedModel, ...]] | None:
    """The clips with held-out ones that the last fit does not follow used for training, and the fits to them.

    In place of each, the training clip nearest in the session is held out. None if all are followed, or had come from
    there before.
    """
    held_out, last = parts.held_out, fits[-1]
    if held_out is None or last.held_out is None or parts.excluded:
        return None
    moved = {file for file, _ in parts.exchanged}
    coming = [held_out.clips[k] for k in departing_held_out(last) if held_out.clips[k].file not in moved]
    going = _nearest(coming, [clip for clip in parts.training.clips if clip.file not in moved])
    if not coming or len(going) < len(coming):
        return None
    training = _with_clips(parts.training, coming, going)
    held = _with_clips(held_out, going, coming)
    pairs = tuple((one.file, two.file) for one, two in zip(coming, going, strict=True))
    for one, two in pairs:
        log.info("%s, held out, is not followed: fitted in place of %s", one, two)
    now = dataclasses.replace(parts, training=training, held_out=held, exchanged=(*parts.exchanged, *pairs))
    return now, tuple(_fitted_again(parts, now, one) for one in fits)


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


def _fitted_again(before: Split, now: Split, found: FittedModel) -> FittedModel:
    """Repeat a fit with the clips that have changed places, from the initial states that it has for all of them."""
    problem = now.training.with_model(found.problem.model, found.names)
    start = Point(problem, _states(before, found, now.training), found.constants, found.discrepancy_rate)
    if now.held_out is not None and found.held_out is not None:
        held = dataclasses.replace(found.held_out, initial_states=_states(before, found, now.held_out))
        found = dataclasses.replace(found, held_out=held)
    return fit_on(now, start, found, "with held-out clips exchanged")


def _states(before: Split, found: FittedModel, part: ShotProblem) -> Array:
    """Initial states of the clips of a problem (n, p), which a fit has for those of a split."""
    every = before.states_of(found, [clip.file for clip in part.clips])
    if every is None:
        raise ValueError("shots are excluded")
    problems = [one for one in (before.training, before.held_out) if one is not None]
    resting = max(one.motions_from for one in problems)
    moving = part.start.shape[1] - part.motions_from
    return np.asarray(np.hstack([every[:, : part.motions_from], every[:, resting : resting + moving]]))
