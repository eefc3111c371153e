"""Least squares over many small problems that share constants: initial states and constants together.

In: an `Objective`, `SharedConstants` and start values. Out: a `Solution`: initial states, constants, covariance of
the constants, whether it converged.

Levenberg-Marquardt for the constants with the initial states eliminated. With J^T W J in blocks of initial states x and
constants c, and the gradient J^T W r,

    information = A_cc - A_cx A_xx^-1 A_xc        (Schur complement)
    gradient    = g_c  - A_cx A_xx^-1 g_x,

each summed over the problems. Constants at a bound that would cross it are held there, and the others move as if these
were known (a projected Newton step; D. P. Bertsekas, SIAM Journal on Control and Optimization 20, 221, 1982).
"""

from __future__ import annotations

import logging
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.solver.journal import recorded
from sysid.estimation.solver.least_squares import (
    MIN_DAMPING,
    Array,
    Objective,
    Prior,
    best_of,
    fit_each,
    linearised,
    solve_each,
)
from sysid.estimation.solver.normal_equations import NormalEquations
from sysid.estimation.solver.spread import by_parts

MAX_STALLED_STEPS = 2  # successive steps without improvement
MAX_ATTEMPTS = 8  # attempts at a step of the constants, each with ten times the damping
FIRST_DAMPING = 1e-4
MAX_STATE_STEPS = 6  # iterations of initial states, at most, for every step of the constants
NEGLIGIBLE_LOSS = 0.5  # a smaller change of the loss is less than a standard deviation in any direction
ROUGH_LOSS = 10.0  # predicted improvement, in tolerances, that a rough loss may leave
ARRIVED_SD = 0.02  # predicted step that is small enough, in standard deviations
MIN_WIDTH_SD = 4.0  # least width of a determined constant's bounds, in its standard deviations
LEAST_SHARE = 1e-12  # least information in any direction, relative to each constant's own: about the rounding error
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SharedConstants:
    """Steps, bounds and prior of the constants (q,) that all problems share."""

    steps: Array  # (q,) finite differences
    bounds: Array  # (q, 2)
    known: Prior | None = None  # (q,) prior knowledge

    @property
    def width(self) -> Array:
        """Width of the bounds: (q,)."""
        return np.maximum(self.bounds[:, 1] - self.bounds[:, 0], 1e-12)

    def steps_from(self, c: Array) -> Array:
        """Finite-difference steps at constants (q,); inwards at an upper bound, since beyond it nothing may change."""
        return np.where(c + self.steps > self.bounds[:, 1], -self.steps, self.steps)

    def prior(self, start: Array) -> Prior:
        """Prior of the constants; the sd of an otherwise unknown one is the width of its bounds.

        So a constant that the data do not determine stays near its start.
        """
        mean, sd = start.copy(), self.width
        if self.known is not None:
            known = np.isfinite(self.known.sd)
            mean[known], sd[known] = self.known.mean[known], self.known.sd[known]
        return Prior(mean, sd)


@dataclass(frozen=True)
class StoppingRule:
    """Stopping rule of a fit of constants."""

    steps: int = 20  # of the constants, at most
    tolerance: float = 1e-5  # share of the loss


@dataclass(frozen=True)
class Solution:
    """A joint fit: initial states (n, p), constants (q,), their covariance (q, q), and whether it converged."""

    initial_states: Array
    constants: Array
    covariance: Array  # of the constants; NaN where it could not be computed
    cost: float
    converged: bool
    information: Array  # (n, q, q) of each problem on the constants, its initial state eliminated
    gradient: Array  # (n, q) of each problem's loss by the constants, its initial state eliminated


class ReducedSystem(NamedTuple):
    """Normal equations of the constants, the initial states eliminated."""

    information: Array  # (n, q, q) Schur complement
    gradient: Array  # (n, q)
    state_by_constant: Array  # (n, p, q) A_xx^-1 A_xc: a step d of the constants moves initial states by its -d
    state_step: Array  # (n, p) A_xx^-1 g_x, less which initial states are at their best


def eliminated(normal: NormalEquations, x: Array, prior: Prior) -> ReducedSystem:
    """Eliminate initial states x (n, p) from normal equations of these and of constants."""
    n, p = x.shape
    sd = np.broadcast_to(prior.sd, (n, p))
    axx = normal.matrix[:, :p, :p] + np.einsum("np,pq->npq", 1 / sd**2 + 1e-9, np.eye(p))
    axc, acc = normal.matrix[:, :p, p:], normal.matrix[:, p:, p:]
    gx, gc = normal.gradient[:, :p] + prior.residuals(x) / sd, normal.gradient[:, p:]
    solved = solve_each(axx, np.concatenate([axc, gx[..., None]], axis=2))
    state_by_constant, state_step = solved[..., :-1], solved[..., -1]
    information = acc - np.swapaxes(axc, 1, 2) @ state_by_constant
    gradient = gc - np.einsum("npq,np->nq", axc, state_step)
    return ReducedSystem(information, gradient, state_by_constant, state_step)


def reduced_system(objective: Objective, x: Array, c: Array, shared: SharedConstants) -> ReducedSystem:
    """`eliminated`, from finite differences about initial states (n, p) and constants (q,)."""
    data = linearised(objective, x, c, np.arange(len(x)), shared.steps_from(c))
    return eliminated(data, x, objective.prior)


def fit_joint(
    objective: Objective, x: Array, c: Array, shared: SharedConstants, rule: StoppingRule | None = None,
    what: str = "fit",
) -> Solution:  # fmt: skip
    """Fit shared constants (q,) together with every problem's initial state.

    Converged means that the remaining full (undamped) step moves no constant by more than its standard deviation. The
    covariance is the larger of the inverse information and the sandwich over problems, which holds for a slightly
    wrong model, and includes that step. Noise that is correlated from sample to sample reduces the information by its
    correlation time.

    Args:
        objective: of all problems.
        x: (n, p) start values of the initial states.
        c: (q,) start values of the constants.
        shared: steps, bounds and prior of the constants.
        rule: when to stop.
        what: name of the fit, for the log.
    """
    rule = rule or StoppingRule()
    joint = _Joint(objective, shared, shared.prior(c), rule)
    low, high = shared.bounds.T

    def fits(found: tuple[Array, ...]) -> bool:
        return objective.holds(found[0]) and bool(np.all((found[1] >= low) & (found[1] <= high)))

    limits = np.array([rule.steps, rule.tolerance, objective.cauchy_sd])
    question, shapes = (x, c, shared.bounds, limits), (x.shape, c.shape, ())
    x, c, cost = recorded(lambda: _minimised(joint, x, c, what), question, shapes, fits)
    reduced, sd, width = joint.reduced(x, c), joint.prior.sd, shared.width
    known = np.where(sd < width, 1 / sd**2, 0.0)
    found = covariance(reduced.information, reduced.gradient, width, known, objective.correlation_time)
    step = joint.newton(reduced, c).full
    converged = is_within(step, found)
    return Solution(
        x, c, found + np.outer(step, step), float(cost), converged, reduced.information, reduced.gradient
    )  # fmt: skip


def is_within(step: Array, covariance: Array) -> bool:
    """Whether a step (q,) moves no constant by more than its standard deviation, where that is known (q, q)."""
    sd = np.sqrt(np.maximum(np.diag(covariance), 0.0))  # rounding may make the variance of a poorly known one negative
    return bool(np.all(np.abs(step)[np.isfinite(sd)] < sd[np.isfinite(sd)]))


def _minimised(joint: _Joint, x: Array, c: Array, what: str) -> tuple[Array, ...]:
    """Initial states and constants of the least loss, and that loss."""
    objective, rule = joint.objective, joint.rule
    x, costs = fit_each(objective, x, c, MAX_STATE_STEPS)
    at = _Iterate(x, c, joint.cost(costs, c), FIRST_DAMPING)
    stalled = 0
    for step in range(rule.steps):
        log.info("%s, step %d: loss %.0f", what, step, at.cost)
        reduced = joint.reduced(at.x, at.c)
        newton = joint.newton(reduced, at.c)
        arrived = joint.arrived(newton, at)
        new = joint.lower(at, reduced, newton, 1 if arrived else MAX_ATTEMPTS)
        if new is None:
            break
        # If the loss is rough on the scale of the remaining improvement, no better optimum can be found.
        threshold = rule.tolerance * at.cost
        stalled = stalled + 1 if at.cost - new.cost < threshold else 0
        rough = stalled >= MAX_STALLED_STEPS and newton.predicted < max(ROUGH_LOSS * threshold, NEGLIGIBLE_LOSS)
        at = new
        if arrived or rough or stalled > MAX_STALLED_STEPS:
            break
    return at.x, at.c, np.array(at.cost)


@dataclass(frozen=True)
class _Iterate:
    """The current values of a joint fit."""

    x: Array  # (n, p)
    c: Array  # (q,)
    cost: float
    damping: float


class _Newton(NamedTuple):
    """The quadratic model of the loss over the constants, including their prior."""

    hessian: Array  # (q, q)
    gradient: Array  # (q,)
    free: NDArray[np.bool_]  # (q,) which constants may move
    full: Array  # (q,) the undamped step, with its sign reversed; 0 where held
    sd: Array  # (q,) of the constants
    predicted: float  # improvement of the loss by the full step


def newton_step(hessian: Array, gradient: Array, c: Array, bounds: Array) -> tuple[Array, NDArray[np.bool_]]:
    """The step (q,) to subtract from constants (q,) within bounds (q, 2), and which of them are free (q,).

    A constant at a bound is held where the loss falls beyond it, or where the step of the others would lead it there.
    """
    low, high = c <= bounds[:, 0], c >= bounds[:, 1]
    free = ~((low & (gradient > 0)) | (high & (gradient < 0)))
    while True:
        step = np.zeros(c.size)
        step[free] = np.linalg.lstsq(hessian[np.ix_(free, free)], gradient[free], rcond=None)[0]
        leaves = free & ((low & (step > 0)) | (high & (step < 0)))
        if not leaves.any():
            return step, free
        free &= ~leaves


@dataclass(frozen=True)
class _Joint:
    """A joint fit's problem, and a step of it."""

    objective: Objective
    shared: SharedConstants
    prior: Prior  # of the constants
    rule: StoppingRule

    def cost(self, each: Array, c: Array) -> float:
        """Loss of all problems (n,), plus that of the constants' prior."""
        return float(each.sum()) + 0.5 * float(np.sum(self.prior.residuals(c) ** 2))

    def reduced(self, x: Array, c: Array) -> ReducedSystem:
        """See `reduced_system`."""
        return reduced_system(self.objective, x, c, self.shared)

    def newton(self, reduced: ReducedSystem, c: Array) -> _Newton:
        """The full step and the improvement predicted for it."""
        h = reduced.information.sum(axis=0) + np.diag(1 / self.prior.sd**2)
        g = reduced.gradient.sum(axis=0) + (c - self.prior.mean) / self.prior.sd**2
        full, free = newton_step(h, g, c, self.shared.bounds)
        sd = np.sqrt(np.maximum(np.diag(np.linalg.pinv(h)), 0))
        return _Newton(h, g, free, full, sd, 0.5 * float(g @ full))

    def arrived(self, newton: _Newton, at: _Iterate) -> bool:
        """Whether the full step is negligible."""
        small = bool(np.all(np.abs(newton.full[newton.free]) < ARRIVED_SD * newton.sd[newton.free]))
        return small or newton.predicted < self.rule.tolerance * at.cost

    def lower(self, at: _Iterate, reduced: ReducedSystem, newton: _Newton, attempts: int) -> _Iterate | None:
        """A step that lowers the loss, damped as much as necessary; None if none is found."""
        damping, free = at.damping, newton.free
        h, g, step = newton.hessian[np.ix_(free, free)], newton.gradient[free], np.zeros(at.c.size)
        low, high = self.shared.bounds.T
        for _ in range(attempts):
            damped = h + damping * np.diag(np.diag(h)) + 1e-12 * np.eye(len(g))
            step[free] = np.linalg.solve(damped, g)
            c = np.clip(at.c - step, low, high)
            x, costs = fit_each(self.objective, self._best_start(at, reduced, c), c, MAX_STATE_STEPS)
            cost = self.cost(costs, c)
            if cost < at.cost:
                return _Iterate(x, c, cost, max(damping / 10, MIN_DAMPING))
            damping *= 10
        return None

    def _best_start(self, at: _Iterate, reduced: ReducedSystem, c: Array) -> Array:
        """Initial states for other constants: each problem's best of unchanged, moved with them, or a Newton step."""
        along = at.x - np.einsum("npq,q->np", reduced.state_by_constant, c - at.c)
        starts = self.objective.inside(np.stack([at.x, along, along - reduced.state_step], axis=1))
        return by_parts(best_of, self.objective, starts, c, np.arange(len(starts)))[0]


def covariance(
    information: Array, gradient: Array, width: Array, known: Array | None = None, correlation_time: float = 1.0
) -> Array:
    """Covariance of the constants: (q, q); NaN for those with an sd above a quarter of their bounds' width.

    Args:
        information: (n, q, q) of each problem.
        gradient: (n, q) of each problem's loss.
        width: (q,) of the bounds.
        known: (q,) prior information on each constant, 1 / sd^2.
        correlation_time: of the noise [samples], by which the residuals' information is divided.
    """
    h = information.sum(axis=0) / correlation_time
    q = len(h)
    if known is not None:
        h = h + np.diag(known)
    determined = np.diag(h) > (MIN_WIDTH_SD / width) ** 2
    out = np.full((q, q), np.nan)
    if not determined.any():
        return out
    k = np.ix_(determined, determined)
    size = np.sqrt(np.diag(h)[determined])
    scale = np.outer(size, size)
    value, way = np.linalg.eigh(h[k] / scale)
    inverse = way / np.maximum(value, LEAST_SHARE) @ way.T / scale  # rounding may make an eigenvalue negative
    g = gradient[:, determined] / correlation_time
    g = g[np.any(g != 0, axis=1)]
    n = max(len(g), 1)
    g = g - g.sum(axis=0) / n  # their common part is a remaining step, not scatter
    sandwich = inverse @ (g.T @ g) @ inverse * (n / max(n - determined.sum(), 1))
    # Correlations are those of the information; standard deviations are the larger of both.
    grow = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.maximum(np.diag(inverse), 1e-300)))
    out[k] = inverse * np.outer(grow, grow)
    return out
