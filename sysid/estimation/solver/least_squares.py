"""Least squares of many small problems at once, each with its initial state, at given constants.

In: an `Objective`: residuals as a function of initial states and constants, finite-difference steps, prior, loss.
Out: the initial states with the lowest loss. joint_fit.py beside it fits the constants that problems share.

Every iteration evaluates all residuals and their finite differences in one call, that is, one batch of simulations.
Levenberg-Marquardt with Marquardt's scaling and a damping for each problem, which ends when the full step predicts no
improvement; a step that fails is bent along its valley (`_Local.step`). The loss is Cauchy's,
c^2/2 log(1 + (r/c)^2), by reweighting.
"""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.normal_equations import (
    NormalEquations,
    from_differences,
    projected,
    robust_loss,
)
from sysid.estimation.solver.spread import by_parts

Array = NDArray[np.float64]
FIRST_STATE_DAMPING = 1e-3
MIN_DAMPING = 1e-9
MAX_STEP_SD, SHORT_STEP_SD = 0.3, 0.1  # longest finite-difference step, and a shortened one, over the sd
MAX_SHORTENINGS = 3  # attempts, since far too long a difference underestimates the slope
MAX_STATE_ATTEMPTS = 6  # attempts at a step of the initial states, each with ten times the damping
BATCH_PROBLEMS = 32  # problems whose residuals are in memory at a time, once for each finite difference
PROBED_SHARE = 0.1  # share of a step over which its curvature is measured
NO_STEPS = np.zeros(0)
NO_BOUNDS = np.array([[-np.inf, np.inf]])
SINGULAR_SHARE = 1e-9  # largest eigenvalue of a scaled matrix that counts as undetermined
Mask = NDArray[np.bool_]
Evaluate = Callable[[Array, Array, NDArray[np.int64]], Array]
"""(k, p) initial states, (k, q) constants, (k,) problem numbers -> (k, m) residuals in units of noise, NaN unused."""


@dataclass(frozen=True)
class Prior:
    """Gaussian prior of unknowns, which adds the residuals (x - mean) / sd; sd is inf without knowledge."""

    mean: Array  # (n, p), or (p,) of every problem
    sd: Array  # the same shape

    def residuals(self, x: Array) -> Array:
        """(k, p) for (k, p) unknowns."""
        return (x - self.mean) / self.sd

    def only(self, rows: NDArray[np.int64]) -> Prior:
        """The prior of some problems."""
        return self if self.mean.ndim == 1 else Prior(self.mean[rows], self.sd[rows])


@dataclass(frozen=True)
class Objective:
    """The objective of a fit of initial states: robust loss of all residuals plus half the prior's squares."""

    evaluate: Evaluate
    steps: Array  # (p,) finite differences of the initial state
    prior: Prior  # of the initial states
    cauchy_sd: float  # Cauchy's constant, in standard deviations; inf is least squares
    correlation_time: float = 1.0  # of the noise [samples]: that many samples count as one
    bounds: Array = field(default_factory=NO_BOUNDS.copy)  # (p, 2) of the initial state, or (1, 2)
    part: Callable[[NDArray[np.int64]], Evaluate] | None = None  # `evaluate` of some problems, for other processes
    lengths: NDArray[np.int64] | None = None  # (n,) number of residuals of each problem
    free: Mask | None = None  # (n, p) which unknowns each has; None for all
    rough: bool = False  # whether residuals are too rough for shorter finite-difference steps

    def batches(self, which: NDArray[np.int64]) -> list[NDArray[np.int64]]:
        """Batches of problems (n,) of similar length whose residuals are in memory at a time, as positions."""
        return batches(which if self.lengths is None else self.lengths[which])

    def only(self, rows: NDArray[np.int64]) -> Objective | None:
        """The objective of some problems, for other processes; None if it cannot leave this one."""
        if self.part is None:
            return None
        return dataclasses.replace(self, evaluate=self.part(rows), prior=self.prior.only(rows), part=None)

    def inside(self, x: Array) -> Array:
        """Initial states (..., p), clipped to their bounds."""
        return np.clip(x, self.bounds[:, 0], self.bounds[:, 1])

    def holds(self, x: Array) -> bool:
        """Whether initial states (..., p) are within their bounds."""
        return bool(np.all(self.inside(x) == x))


def loss(residuals: Array, c: float) -> Array:
    """Half the loss of every problem: (n,) for (n, m) residuals; NaN is ignored, infinite c is least squares."""
    return robust_loss(residuals, c)


def weights(residuals: Array, c: float) -> Array:
    """Weights with which least squares reproduces the loss: (n, m)."""
    r = np.nan_to_num(residuals)
    return np.isfinite(residuals) / (1.0 + (r / c) ** 2)


def moved(
    evaluate: Evaluate, x: Array, c: Array, which: NDArray[np.int64], steps: Array, steps_c: Array,
    share: Array | float = 1.0, free: Mask | None = None,
) -> Array:  # fmt: skip
    """Residuals (1 + p + q, n, m) at a point, and with each unknown, then each constant, moved by its step.

    `share` of the steps, of all problems or of each (n,). Unknowns that are not `free` (n, p) stay.
    """
    moves = Moves.of(x, c, which, steps, steps_c, share, free)
    return moves.laid_out(evaluate(moves.x, moves.c, moves.which))


@dataclass(frozen=True)
class Moves:
    """Problems at a point, and with each unknown, then each constant, moved by its step, one move after the other."""

    x: Array  # (k, p)
    c: Array  # (k, q)
    which: NDArray[np.int64]  # (k,)
    made: Mask  # (1 + p + q, n) which moves are included

    @classmethod
    def of(
        cls, x: Array, c: Array, which: NDArray[np.int64], steps: Array, steps_c: Array, share: Array | float = 1.0,
        free: Mask | None = None,
    ) -> Moves:  # fmt: skip
        """See `moved`."""
        n, count = len(x), 1 + len(steps) + len(steps_c)
        rows, constants = np.tile(x, (count, 1, 1)), np.tile(c, (count, n, 1))
        for k in range(len(steps)):
            rows[1 + k, :, k] += share * steps[k]
        for k in range(len(steps_c)):
            constants[1 + len(steps) + k, :, k] += share * steps_c[k]
        made = np.ones((count, n), bool)
        if free is not None:
            made[1 : 1 + len(steps)] = free.T
        return cls(rows[made], constants[made], np.broadcast_to(which, made.shape)[made], made)

    def laid_out(self, found: Array) -> Array:
        """Results (k, m) arranged as (1 + p + q, n, m); moves that are not included repeat the point."""
        if self.made.all():
            return found.reshape(*self.made.shape, -1)
        n = self.made.shape[1]
        out = np.empty((*self.made.shape, found.shape[1]))
        out[:] = found[:n]
        out[self.made] = found
        return out


def differences(
    evaluate: Evaluate, x: Array, c: Array, which: NDArray[np.int64], steps: Array, steps_c: Array
) -> tuple[Array, Array, Array]:
    """Residuals (n, m) and their derivatives by initial states (n, m, p) and constants (n, m, q), in one call."""
    r = moved(evaluate, x, c, which, steps, steps_c)
    d = np.nan_to_num((r[1:] - r[0]) / np.concatenate([steps, steps_c])[:, None, None])
    p = x.shape[1]
    return r[0], np.moveaxis(d[:p], 0, -1), np.moveaxis(d[p:], 0, -1)


def solve_each(matrix: Array, right: Array) -> Array:
    """Solutions (n, p, k) of symmetric systems (n, p, p) with right-hand sides (n, p, k); singular ones regularised.

    A singular matrix is scaled by the root of its diagonal and solved by its pseudoinverse, so that undetermined
    directions do not move. Solutions that are not finite become 0.
    """
    try:
        found = np.linalg.solve(matrix, right)
    except np.linalg.LinAlgError:  # one singular matrix must not affect the others
        found = np.full_like(right, np.nan)
        for k in range(len(matrix)):
            with contextlib.suppress(np.linalg.LinAlgError):
                found[k] = np.linalg.solve(matrix[k], right[k])
    singular = ~np.isfinite(found).all(axis=(1, 2))
    if singular.any():
        found[singular] = _regularised(matrix[singular], right[singular])
    return np.asarray(found)


def _regularised(matrix: Array, right: Array) -> Array:
    """See `solve_each`."""
    diagonal = np.abs(np.einsum("npp->np", matrix))
    scale = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = matrix / (scale[:, :, None] * scale[:, None, :])
    finite = np.isfinite(scaled).all(axis=(1, 2)) & np.isfinite(right).all(axis=(1, 2))
    values, vectors = np.linalg.eigh(scaled[finite])
    turned = np.swapaxes(vectors, 1, 2) @ (right[finite] / scale[finite][:, :, None])
    out = np.zeros_like(right)
    inverse = np.where(values > SINGULAR_SHARE, 1 / np.maximum(values, SINGULAR_SHARE), 0.0)
    solved = vectors @ (inverse[:, :, None] * turned)
    out[finite] = solved / scale[finite][:, :, None]
    return out


def fit_each(
    objective: Objective,
    x: Array,
    c: Array,
    iterations: int,
    which: NDArray[np.int64] | None = None,
    tolerance: float = 1e-4,
) -> tuple[Array, Array]:
    """Fit initial states at constants c (q,); returns them with the loss of each problem: (n, p), (n,).

    Args:
        objective: of all problems.
        x: (n, p) start values of the initial states.
        c: (q,) constants.
        iterations: largest number of iterations.
        which: (n,) numbers of the problems; None for all in order.
        tolerance: a problem ends when its full step predicts a smaller improvement, as a share of its loss.
    """
    which = np.arange(len(x)) if which is None else which

    def work() -> tuple[Array, ...]:
        return by_parts(_fit_each, objective, x, c, which, iterations, tolerance)

    question = (x, c, which.astype(float), np.array([iterations, tolerance, objective.cauchy_sd]))
    states, cost = recorded(work, question, (x.shape, x.shape[:1]), lambda found: objective.holds(found[0]))
    return states, cost


def _fit_each(
    objective: Objective, x: Array, c: Array, which: NDArray[np.int64], iterations: int, tolerance: float
) -> tuple[Array, Array]:
    """See `fit_each`."""
    x, cost = objective.inside(x), np.full(len(x), np.inf)
    for rows in objective.batches(which):
        x[rows], cost[rows] = _fit_batch(objective, x[rows], c, which[rows], iterations, tolerance)
    return x, cost


def _fit_batch(
    objective: Objective, x: Array, c: Array, which: NDArray[np.int64], iterations: int, tolerance: float
) -> tuple[Array, Array]:
    """See `fit_each`."""
    n = len(x)
    damping, cost, active = np.full(n, FIRST_STATE_DAMPING), np.full(n, np.inf), np.arange(n)
    for _step in range(iterations):
        here = _Local.at(objective, x[active], c, which[active])
        arrived = here.predicted <= tolerance * (1.0 + here.cost)
        found, new_cost, todo = here.x.copy(), here.cost.copy(), np.arange(active.size)
        for _ in range(MAX_STATE_ATTEMPTS):
            trial, trial_cost = here.step(todo, damping[active[todo]])
            better = trial_cost < here.cost[todo]
            found[todo[better]], new_cost[todo[better]] = trial[better], trial_cost[better]
            damping[active[todo[better]]] = np.maximum(damping[active[todo[better]]] / 10, MIN_DAMPING)
            damping[active[todo[~better]]] *= 10
            todo = todo[~better & ~arrived[todo]]
            if not todo.size:
                break
        x[active], cost[active] = found, new_cost
        active = active[~arrived & (new_cost < here.cost)]
        if active.size == 0:
            break
    return x, cost


@dataclass(frozen=True)
class _Local:
    """The local quadratic model of n problems, and steps from there."""

    objective: Objective
    x: Array  # (n, p)
    c: Array  # (q,)
    which: NDArray[np.int64]  # (n,)
    prior: Prior  # (n, p)
    cost: Array  # (n,) including the prior
    matrix: Array  # (n, p, p) J^T W J, including the prior
    gradient: Array  # (n, p)
    rows: Array  # (1 + p, n, m) residuals here, and with each unknown moved
    steps: Array  # (n, p) of those moves

    @classmethod
    def at(cls, objective: Objective, x: Array, c: Array, which: NDArray[np.int64]) -> _Local:
        """Build the model from finite differences."""
        data, rows, share = _differenced(objective, x, c, which, NO_STEPS)
        known = objective.prior.only(which)
        prior = Prior(np.broadcast_to(known.mean, x.shape), np.broadcast_to(known.sd, x.shape))
        r, precision = prior.residuals(x), 1 / prior.sd**2
        matrix = data.matrix + np.einsum("np,pq->npq", precision + 1e-12, np.eye(x.shape[1]))
        return cls(
            objective, x, c, which, prior, data.loss + 0.5 * np.sum(r * r, axis=1), matrix,
            data.gradient + r / prior.sd, rows, share[:, None] * objective.steps,
        )  # fmt: skip

    def played(self, x: Array, some: NDArray[np.int64]) -> tuple[Array, Array]:
        """Residuals (k, m) of some problems at states (k, p), and their cost (k,)."""
        r = self.objective.evaluate(x, np.broadcast_to(self.c, (some.size, self.c.size)), self.which[some])
        known = self.prior.only(some).residuals(x)
        return r, loss(r, self.objective.cauchy_sd) + 0.5 * np.sum(known**2, axis=1)

    @property
    def predicted(self) -> Array:
        """Improvement of the cost by the full step in the quadratic model: (n,)."""
        full = solve_each(self.matrix, self.gradient[..., None])[..., 0]
        return np.asarray(0.5 * np.einsum("np,np->n", self.gradient, full))

    def step(self, some: NDArray[np.int64], damping: Array) -> tuple[Array, Array]:
        """States (k, p) after a step of some problems with a damping each (k,), and their cost (k,).

        After a dozen impacts the cost has narrow curved valleys. If it does not fall, the step is bent along the valley
        (geodesic acceleration: M. K. Transtrum and J. P. Sethna, arXiv:1201.5885), if that is better.
        """
        matrix = self.matrix[some]
        damped = matrix * (1 + damping[:, None, None] * np.eye(self.x.shape[1]))
        straight = -solve_each(damped, self.gradient[some][..., None])[..., 0]
        x = self.objective.inside(self.x[some] + straight)
        _, cost = self.played(x, some)
        bent = np.flatnonzero(~(cost < self.cost[some]))
        if not bent.size:
            return x, cost
        rows, along = some[bent], straight[bent]
        ahead, behind = (
            self.played(self.objective.inside(self.x[rows] + part * along), rows)[0]
            for part in (PROBED_SHARE, -PROBED_SHARE)
        )
        now = self.rows[:, rows, : ahead.shape[1]]  # as long as the longest of them
        curvature = (ahead - 2 * now[0] + behind) / PROBED_SHARE**2
        right = projected(now, self.steps[rows], curvature, self.objective.cauchy_sd)
        bend = -0.5 * solve_each(damped[bent], right[..., None])[..., 0]
        curved = self.objective.inside(self.x[rows] + along + bend)
        _, curved_cost = self.played(curved, rows)
        closer = curved_cost < cost[bent]
        x[bent[closer]], cost[bent[closer]] = curved[closer], curved_cost[closer]
        return x, cost


def linearised(objective: Objective, x: Array, c: Array, which: NDArray[np.int64], steps_c: Array) -> NormalEquations:
    """Normal equations of problems by their initial states, and by the constants where those have steps (q,)."""
    return NormalEquations(*by_parts(_normal_equations, objective, x, c, which, steps_c))


def _normal_equations(
    objective: Objective, x: Array, c: Array, which: NDArray[np.int64], steps_c: Array
) -> tuple[Array, ...]:
    """Loss, matrix and gradient, as in `linearised`."""
    n, k = len(x), x.shape[1] + len(steps_c)
    loss, matrix, gradient = np.empty(n), np.empty((n, k, k)), np.empty((n, k))
    for rows in objective.batches(which):
        part, _, _ = _differenced(objective, x[rows], c, which[rows], steps_c)
        loss[rows], matrix[rows], gradient[rows] = part.loss, part.matrix, part.gradient
    return loss, matrix, gradient


def batches(lengths: NDArray[np.int64]) -> list[NDArray[np.int64]]:
    """Batches of problems of similar numbers of residuals (n,), as indices."""
    order = np.argsort(lengths, kind="stable")
    return np.split(order, range(BATCH_PROBLEMS, len(order), BATCH_PROBLEMS))


def _differenced(
    objective: Objective, x: Array, c: Array, which: NDArray[np.int64], steps_c: Array
) -> tuple[NormalEquations, Array, Array]:
    """Normal equations from finite differences, whose steps are shortened where an unknown is known better than these.

    Also returns their residuals (1 + k, n, m), and the share (n,) of the steps used. After a dozen impacts an initial
    state is known to a millionth of a millimetre, and a difference over a thousandth does not show the slope.
    """
    steps = np.concatenate([objective.steps, steps_c])
    free = None if objective.free is None else objective.free[which]
    rows = moved(objective.evaluate, x, c, which, objective.steps, steps_c, free=free)
    found = from_differences(rows, steps, objective.cauchy_sd)
    share = np.ones(len(x))
    for _ in range(0 if objective.rough else MAX_SHORTENINGS):
        in_sd = np.sqrt(np.max(np.einsum("npp->np", found.matrix) * steps**2, axis=1, initial=0.0))  # steps over sd
        far = np.flatnonzero(share * in_sd > MAX_STEP_SD)
        if not far.size:
            break
        share[far] = SHORT_STEP_SD / in_sd[far]
        now = moved(
            objective.evaluate, x[far], c, which[far], objective.steps, steps_c, share[far],
            None if free is None else free[far],
        )  # fmt: skip
        rows[:, far, : now.shape[2]] = now
        finer = from_differences(now, steps, objective.cauchy_sd)
        found.matrix[far] = finer.matrix / share[far, None, None] ** 2
        found.gradient[far] = finer.gradient / share[far, None]
    return found, rows, share


def best_of(objective: Objective, starts: Array, c: Array, which: NDArray[np.int64]) -> tuple[Array, ...]:
    """The best of several initial states of each problem (n, count, p), by loss: (n, p)."""
    n, count, p = starts.shape
    r = objective.evaluate(starts.reshape(-1, p), np.tile(c, (n * count, 1)), np.repeat(which, count))
    prior = objective.prior.only(which)
    squares = np.stack([prior.residuals(starts[:, k]) for k in range(count)], axis=1) ** 2
    costs = loss(r.reshape(n, count, -1), objective.cauchy_sd) + 0.5 * np.sum(squares, axis=-1)
    return (starts[np.arange(n), np.argmin(costs, axis=1)],)
