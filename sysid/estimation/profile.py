"""Standard deviations of constants from the profile of the loss, which is rough after a dozen impacts.

In: a fit of whole shots that are followed to the noise. Out: the same fit, or a better one nearby, with standard
deviations that are not too small.

Derivatives give the slope of the loss over a step far shorter than a standard deviation. If impacts appear and vanish
within one, that slope exceeds the mean one. So each constant is moved, the others with it by their correlation, until
the loss of all shots, with their initial states fitted again, has risen by the value of one standard deviation
(D. J. Venzon and S. H. Moolgavkar, Applied Statistics 37, 87, 1988).
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
from sysid.estimation.states.state_search import BETTER_LOSS

LOSS_RISE = 0.5  # rise of the loss at one standard deviation
PROFILE_SD = (1.0, 2.0, 4.0, 8.0)  # distances at which the loss is evaluated, in standard deviations of the fit
MAX_BETTER = 4  # better optima found on the way, from each of which the fit continues
log = logging.getLogger(__name__)


def profiled(found: FittedModel) -> FittedModel:
    """The fit at the best optimum found, with standard deviations from profiles where these are wider."""
    for _ in range(MAX_BETTER):
        better, widening = _widenings(found)
        if better is None:
            log.info("standard deviations from profiles: up to %.1f times wider", widening.max(initial=1.0))
            return dataclasses.replace(found, covariance=found.covariance * np.outer(widening, widening))
        found = fit(better, "from a better optimum")
    return dataclasses.replace(found, converged=False)


def _widenings(found: FittedModel) -> tuple[Point | None, Array]:
    """Width of each constant's profile over its standard deviation (q,), and a better point if one was found."""
    problem, x, c = found.weighted, found.initial_states, found.constants
    objective, shared = problem.objective(), shared_constants(problem.model, problem.names, problem.known)
    follow = reduced_system(objective, x, c, shared).state_by_constant
    known, sd = np.nan_to_num(found.covariance), np.sqrt(np.diag(found.covariance))
    low, high = shared.bounds.T
    _, losses = fit_each(objective, x, c, MAX_STATE_STEPS)
    widening = np.ones(c.size)
    for k in np.flatnonzero(np.isfinite(sd)):
        for side in (-1.0, 1.0):
            for wide in PROFILE_SD:
                moved = np.clip(c + side * wide * known[:, k] / sd[k], low, high)
                along = objective.inside(x - np.einsum("npq,q->np", follow, moved - c))
                (start,) = best_of(objective, np.stack([x, along], axis=1), moved, np.arange(len(x)))
                states, there = fit_each(objective, start, moved, MAX_STATE_STEPS)
                rise = float(there.sum() - losses.sum())
                if rise < -BETTER_LOSS:
                    log.info("%s: loss %.1f lower nearby", problem.names[k], -rise)
                    return Point(found.problem, states, moved, found.discrepancy_rate), widening
                if rise >= LOSS_RISE:
                    break
            widening[k] = max(widening[k], wide / np.sqrt(max(rise, LOSS_RISE) / LOSS_RISE))
    return None, widening
