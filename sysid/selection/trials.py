"""Candidates tried at sizes that matter, where a false optimum hides what is missing, or an effect begins flat.

In: clips (`Split`), a fit (`FittedModel`) and candidates. Out: the same clips fitted with one effect more.

A fit that lacks a large effect may bend its constants so far that the derivative by that effect, of which its score is
made, vanishes. So does that by an effect that grows with the square of its parameter. Held at its usual size, or at
several times that if it vanishes at a bound, with constants and initial states fitted again for a few steps, the right
effect lowers the loss all the same.
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
LARGER = 3.0  # times its usual size, at which an effect is tried as well that vanishes at a bound
MAX_PROMISING = 2  # effects: of two that go together, one alone may be fitted into a false optimum
log = logging.getLogger(__name__)


def most_promising(base: FittedModel, kinds: Sequence[type[Effect]]) -> list[Effect]:
    """Effects, at the size tried, that lower the loss of a fit most, best first.

    Args:
        base: the fit without any of them.
        kinds: effects that may be missing.
    """
    log.info("%d effects at their usual size", len(kinds))
    count = len(base.initial_states)
    rows = np.unique(np.linspace(0, count - 1, min(count, MAX_TRIAL_SHOTS)).astype(np.int64))
    few = base.weighted.only(rows)

    def soon(effect: Effect | None = None) -> float:
        model = base.model if effect is None else base.model.add(effect)
        return loss_soon(few.with_model(model, base.names), base.initial_states[rows], base.constants)

    before, best = soon(), list[tuple[float, Effect]]()
    for kind in kinds:
        gain, effect = max(((before - soon(one), one) for one in _sizes(kind)), key=lambda tried: tried[0])
        if gain > MIN_TRIAL_SHARE * before:
            best.append((gain, effect))
    return [effect for _, effect in sorted(best, key=lambda tried: -tried[0])[:MAX_PROMISING]]


def _sizes(kind: type[Effect]) -> list[Effect]:
    """An effect at the sizes at which it is tried."""
    one = candidate(kind)
    if not one.one_sided:
        return [one.effect]
    low, high = one.bounds().T
    return [one.effect, one.at(np.clip(one.off() + LARGER * one.usual(), low, high))]


def fit_from_trial(parts: Split, base: FittedModel, effect: Effect) -> FittedModel:
    """All constants and initial states fitted: first beside an effect held at its size, then with it."""
    one = candidate(effect)
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
