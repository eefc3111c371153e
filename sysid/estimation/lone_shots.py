"""Shots that determine a constant nearly alone: their sidespin scanned with that constant fitted along.

In: a problem, where its fit has ended, and the information of every shot. Out: a `SpinScan` of each such shot.

Where a single clip shows two balls meeting and nobody knows its sidespin, that spin and the impact's restitution and
friction imitate each other. The loss then has several optima, since a sidespin that is gone before the impact changes
nothing, and none of them is a parabola. At the constants of a false optimum every other spin fits worse. So such a shot
is fitted at each of many sidespins, with the constants that hang on it as unknowns of its own; what the other shots say
of these is their prior. The best of them is a better start; and with losses L the constants c scatter about the best by

    var = sum w (c - c_best)^2 / sum w,    w = exp(-(L - L_best) / tau),    tau the noise's correlation time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.estimation.problem import Array, Index, constant_bounds, constant_steps
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each
from sysid.estimation.start_values import MISCUE_SPIN, RUNNING_SPIN

LONE_SHARE = 0.3  # of the information on a constant, from which a shot is scanned
SIDESPIN_COUNT = 41  # sidespins between the miscue limits, or those of a ball that has slowed down since
SIDESPIN_INDEX = 6  # number of the sidespin in an initial state
HELD_SPIN_SD = 1e-3  # of the distance of two sidespins: how firmly each is held
SCAN_STEPS, SCAN_TOLERANCE = 20, 1e-5
MIN_GAIN = 1.0  # of a shot's loss, for which it is moved


@dataclass(frozen=True)
class SpinScan:
    """One shot at many sidespins, the first as fitted."""

    row: int  # number of the shot
    some: Index  # (m,) numbers of the constants that hang on it
    states: Array  # (k, p)
    constants: Array  # (k, m)
    loss: Array  # (k,)
    correlation_time: float  # of the noise [samples]

    @property
    def best(self) -> int:
        """Which of them fits best; 0 where none is clearly better than the first."""
        k = int(np.argmin(self.loss))
        return k if self.loss[k] < self.loss[0] - MIN_GAIN else 0

    @property
    def variance(self) -> Array:
        """Of the constants about the first, over all sidespins that fit about as well: (m,).

        At least that of the first and any other one alone: many sidespins that change nothing do not outvote one.
        """
        weight = np.exp(-np.maximum(self.loss[1:] - self.loss.min(), 0.0) / self.correlation_time)
        square = (self.constants[1:] - self.constants[0]) ** 2
        alone = (weight / (1.0 + weight))[:, None] * square
        return np.asarray(np.maximum(weight @ square / max(float(weight.sum()), 1e-300), alone.max(axis=0)))


def scan_lone_shots(problem: ShotProblem, x: Array, c: Array, information: Array) -> list[SpinScan]:
    """Scans of the shots that determine constants nearly alone and whose stroke nobody knows.

    Args:
        problem: whole shots.
        x: (n, p) where a fit has ended.
        c: (q,) the same of the constants.
        information: (n, q, q) of each shot on the constants.
    """
    each = np.einsum("nqq->nq", information)
    share = each / np.maximum(each.sum(axis=0), 1e-300)
    scans = []
    for row in np.flatnonzero((share > LONE_SHARE).any(axis=1)).tolist():
        if problem.clips[row].cue is None:
            some = np.flatnonzero(share[row] > LONE_SHARE)
            scans.append(_scan(problem, row, some, (x[row], c), each[:, some].sum(axis=0) - each[row, some]))
    return scans


def _scan(problem: ShotProblem, row: int, some: Index, at: tuple[Array, Array], others: Array) -> SpinScan:
    """One shot from its state and all constants, `at`; other shots have information `others` on constants `some`."""
    x, c = at
    p, names = x.size, [problem.names[k] for k in some]
    bounds, steps = constant_bounds(problem.model, names), constant_steps(problem.model, names)
    steps = np.where(c[some] + steps > bounds[:, 1], -steps, steps)
    sd = np.minimum(1.0 / np.sqrt(np.maximum(others, 1e-300)), bounds[:, 1] - bounds[:, 0])
    plain, own = problem.objective(), problem.prior.only(np.array([row]))

    def evaluate(both: Array, fixed: Array, which: Index) -> Array:
        values = np.array(np.broadcast_to(fixed, (len(both), c.size)))
        values[:, some] = both[:, p:]
        return problem.evaluate(np.ascontiguousarray(both[:, :p]), values, np.full(len(which), row))

    most = MISCUE_SPIN * (RUNNING_SPIN if problem.clips[row].running else 1.0)
    spins = np.linspace(-1.0, 1.0, SIDESPIN_COUNT) * most * np.hypot(x[2], x[3])
    trials = np.tile(np.concatenate([x, c[some]]), (1 + SIDESPIN_COUNT, 1))
    trials[1:, SIDESPIN_INDEX] = spins
    mean = np.tile(np.concatenate([own.mean.ravel(), c[some]]), (1 + SIDESPIN_COUNT, 1))
    spread = np.tile(np.concatenate([own.sd.ravel(), sd]), (1 + SIDESPIN_COUNT, 1))
    mean[1:, SIDESPIN_INDEX], spread[1:, SIDESPIN_INDEX] = spins, HELD_SPIN_SD * (spins[1] - spins[0])
    objective = Objective(
        evaluate, np.concatenate([plain.steps, steps]), Prior(mean, spread),
        plain.cauchy_sd, plain.correlation_time, np.concatenate([plain.bounds, bounds]),
    )  # fmt: skip
    found, loss = fit_each(objective, trials, c, SCAN_STEPS, tolerance=SCAN_TOLERANCE)
    return SpinScan(row, some, found[:, :p], found[:, p:], loss, problem.correlation_time)
