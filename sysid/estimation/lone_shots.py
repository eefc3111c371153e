"""Shots that determine a constant nearly alone, tried from other spins with that constant fitted along.

In: a problem, where its fit has ended, and the information of every shot. Out: a better start, if there is one.

Where a single clip shows two balls meeting, its unknown sidespin and the impact's restitution and friction imitate each
other: there are several optima, and at the constants of a false one every other spin fits worse. So such a shot is
fitted from other spins with the constants that hang on it as unknowns of its own. What the other shots say of these
is their prior.
"""

from __future__ import annotations

import numpy as np

from sysid.estimation.initial_states import OTHER_SPINS
from sysid.estimation.least_squares import Objective, Prior, fit_each
from sysid.estimation.problem import Array, Index, constant_bounds, constant_steps
from sysid.estimation.shot_problem import ShotProblem

LONE_SHARE = 0.3  # of the information on a constant, from which a shot is tried
TRIAL_STEPS, TRIAL_TOLERANCE = 25, 1e-6
MIN_LOSS_GAIN = 1.0  # of a shot, for which it is moved


def from_other_optima(problem: ShotProblem, x: Array, c: Array, information: Array) -> tuple[Array, Array] | None:
    """Initial states (n, p) and constants (q,) with the shots that determine constants nearly alone at better optima.

    None where none of them has a better one.

    Args:
        problem: whole shots.
        x: (n, p) where a fit has ended.
        c: (q,) the same of the constants.
        information: (n, q, q) of each shot on the constants.
    """
    each = np.einsum("nqq->nq", information)
    share = each / np.maximum(each.sum(axis=0), 1e-300)
    x, c, better = x.copy(), c.copy(), False
    for row in np.flatnonzero((share > LONE_SHARE).any(axis=1)).tolist():
        if problem.clips[row].cue is None:
            some = np.flatnonzero(share[row] > LONE_SHARE)
            best = _best_of_shot(problem, row, some, (x, c), each[:, some].sum(axis=0) - each[row, some])
            if best is not None:
                better, x[row], c[some] = True, *best
    return (x, c) if better else None


def _best_of_shot(
    problem: ShotProblem, row: int, some: Index, at: tuple[Array, Array], others: Array
) -> tuple[Array, Array] | None:
    """The state (p,) of one shot and constants number `some`, of which other shots have information `others`.

    None where they are at their best.
    """
    x, c = at
    p, names = x.shape[1], [problem.names[k] for k in some]
    bounds = constant_bounds(problem.model, names)
    sd = np.minimum(1.0 / np.sqrt(np.maximum(others, 1e-300)), bounds[:, 1] - bounds[:, 0])
    plain, prior = problem.objective(), problem.prior

    def evaluate(both: Array, fixed: Array, which: Index) -> Array:
        values = np.array(np.broadcast_to(fixed, (len(both), c.size)))
        values[:, some] = both[:, p:]
        return problem.evaluate(np.ascontiguousarray(both[:, :p]), values, which)

    start = np.concatenate([x[row], c[some]])
    trials = np.tile(start, (1 + len(OTHER_SPINS), 1))
    for trial, (unknown, shift) in zip(trials[1:], OTHER_SPINS, strict=True):
        trial[unknown] += shift * np.hypot(start[2], start[3])
    n = len(x)
    known = Prior(
        np.concatenate([prior.mean, np.tile(c[some], (n, 1))], axis=1),
        np.concatenate([np.broadcast_to(prior.sd, (n, p)), np.tile(sd, (n, 1))], axis=1),
    )
    objective = Objective(
        evaluate, np.concatenate([plain.steps, constant_steps(problem.model, names)]), known, plain.cauchy_sd,
        plain.correlation_time, np.concatenate([plain.bounds, bounds]),
    )  # fmt: skip
    found, cost = fit_each(objective, trials, c, TRIAL_STEPS, np.full(len(trials), row), TRIAL_TOLERANCE)
    k = int(np.argmin(cost))
    return (found[k, :p], found[k, p:]) if cost[k] < cost[0] - MIN_LOSS_GAIN else None
