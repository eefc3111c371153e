"""Standard deviations of constants from the profile of the loss, which is rough after a dozen impacts.

In: a fit of whole shots that are followed to the noise. Out: the same fit, or a better one that lay nearby, with
standard deviations that are none too small.

Derivatives tell how steep the loss is over a step that is far shorter than a standard deviation. Where impacts come and
go within one, that is steeper than the loss is over all of it. So each constant is moved, the others along with it as
the fit has them correlated, until the loss of all shots, their initial states fitted anew, has risen as far as it does
over a standard deviation (D. J. Venzon and S. H. Moolgavkar, Applied Statistics 37, 87, 1988).
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import fit
from sysid.estimation.problem import Array, shared_constants
from sysid.estimation.solver.joint_fit import MAX_STATE_STEPS, reduced_system
from sysid.estimation.solver.least_squares import best_of, fit_each
from sysid.estimation.state_search import BETTER_LOSS

RISE = 0.5  # of the loss, one standard deviation away
WIDENINGS = (1.0, 2.0, 4.0, 8.0)  # standard deviations of the fit, over which the loss is looked at
MAX_BETTER = 4  # optima found on the way, from each of which the fit goes on
log = logging.getLogger(__name__)


def profiled(found: FittedModel) -> FittedModel:
    """The fit with standard deviations from profiles where these are wider, from the best optimum that they pass."""
    for _ in range(MAX_BETTER):
        better, widening = _widenings(found)
        if better is None:
            log.info("standard deviations from profiles: up to %.1f times wider", widening.max(initial=1.0))
            return dataclasses.replace(found, covariance=found.covariance * np.outer(widening, widening))
        found = fit(better, "from a better optimum")
    return dataclasses.replace(found, converged=False)


def _widenings(found: FittedModel) -> tuple[Point | None, Array]:
    """By how much the profile of each constant is wider than its standard deviation: (q,), and a better point met."""
    problem, x, c = found.weighted, found.initial_states, found.constants
    objective, shared = problem.objective(), shared_constants(problem.model, problem.names, problem.known)
    follow = reduced_system(objective, x, c, shared).state_by_constant
    known, sd = np.nan_to_num(found.covariance), np.sqrt(np.diag(found.covariance))
    low, high = shared.bounds.T
    _, losses = fit_each(objective, x, c, MAX_STATE_STEPS)
    widening = np.ones(c.size)
    for k in np.flatnonzero(np.isfinite(sd)):
        for side in (-1.0, 1.0):
            for wide in WIDENINGS:
                moved = np.clip(c + side * wide * known[:, k] / sd[k], low, high)
                along = objective.inside(x - np.einsum("npq,q->np", follow, moved - c))
                (start,) = best_of(objective, np.stack([x, along], axis=1), moved, np.arange(len(x)))
                states, there = fit_each(objective, start, moved, MAX_STATE_STEPS)
                rise = float(there.sum() - losses.sum())
                if rise < -BETTER_LOSS:
                    log.info("%s: loss %.1f lower nearby", problem.names[k], -rise)
                    return Point(found.problem, states, moved, found.discrepancy_rate), widening
                if rise >= RISE:
                    break
            widening[k] = max(widening[k], wide / np.sqrt(max(rise, RISE) / RISE))
    return None, widening
