"""Candidates tried at their usual size, where a false optimum hides what is missing.

In: clips (`Split`), a fit (`FittedModel`) and candidates. Out: the same clips fitted with one effect more.

A fit that lacks a large effect may bend its constants so far that the derivative by that effect, of which its score is
made, vanishes. Held at its usual size, with constants and initial states fitted again for a few steps, the right effect
lowers the loss all the same.
"""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence

import numpy as np

from models.effect import Effect
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import fit, loss_soon
from sysid.estimation.split import Split, fit_on
from sysid.selection.score import Candidate, candidate, with_candidate

MAX_TRIAL_SHOTS = 60  # on which every candidate is tried
MIN_TRIAL_SHARE = 0.02  # of the loss by which a trial must lower it
MIN_TRIAL_OF_BEST = 0.5  # and of what the best fit lowers it by
MAX_PROMISING = 2  # effects: of two that go together, one alone may be fitted into a false optimum
log = logging.getLogger(__name__)


def most_promising(base: FittedModel, kinds: Sequence[type[Effect]], fits: Sequence[FittedModel]) -> list[type[Effect]]:
    """Effects that lower the loss of a fit most at their usual size, best first; those that rival the fits there are.

    Args:
        base: the fit without any of them.
        kinds: effects that may be missing.
        fits: the clips fitted with one effect more.
    """
    log.info("%d effects at their usual size", len(kinds))
    count = len(base.initial_states)
    rows = np.unique(np.linspace(0, count - 1, min(count, MAX_TRIAL_SHOTS)).astype(np.int64))
    few = base.weighted.only(rows)

    def soon(at: Point, effect: Effect | None = None) -> float:
        model = at.model if effect is None else at.model.add(effect)
        return loss_soon(few.with_model(model, at.names), at.initial_states[rows], at.constants)

    before = soon(base)
    gains = [before - soon(base, kind()) for kind in kinds]
    best = np.argsort(gains)[::-1][:MAX_PROMISING]
    least = max([MIN_TRIAL_SHARE * before, *(MIN_TRIAL_OF_BEST * (before - soon(one)) for one in fits)])
    return [kinds[k] for k in best if gains[k] > least]


def fit_from_usual(parts: Split, base: FittedModel, kind: type[Effect]) -> FittedModel:
    """All constants and initial states fitted: first beside an effect held at its usual size, then with it."""
    one = candidate(kind)
    held = base.problem.with_model(base.model.add(one.effect), base.names)
    start = fit(Point(held, base.initial_states, base.constants, base.discrepancy_rate), f"beside {one.name}")
    return fit_with(parts, base, one, start, {})


def fit_with(parts: Split, base: FittedModel, one: Candidate, start: Point, values: Mapping[str, float]) -> FittedModel:
    """All constants, those of a candidate among them, and all initial states.

    Args:
        parts: the clips.
        base: their fit without the candidate.
        one: the candidate.
        start: initial states, the base's constants and the discrepancy rate to start from.
        values: the candidate's parameters to start from, by key; others have their usual values.
    """
    keys = tuple(one.effect.parameters())
    problem = with_candidate(base.problem, one, [f"{one.name}.{key}" for key in keys])
    added = [values.get(key, float(getattr(one.effect, key))) for key in keys]
    free = Point(problem, start.initial_states, np.concatenate([start.constants, added]), start.discrepancy_rate)
    return fit_on(parts, free, base, f"with {one.name}")
