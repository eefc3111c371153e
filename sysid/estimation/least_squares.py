"""Least squares over many small problems at once: each has an initial state, all may share constants.

Every iteration asks for all residuals and their finite differences in one call, which is one batch of simulations.
Levenberg-Marquardt with Marquardt's scaling, a damping for every problem; shared constants are stepped with the initial
states eliminated (Schur complement). The loss is Cauchy's, c^2/2 log(1 + (r/c)^2), by reweighting.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.normal_equations import NormalEquations, from_differences, from_jacobian, robust_loss

Array = NDArray[np.float64]
STALLED_STEPS = 2  # in a row that gain nothing
MAX_ATTEMPTS = 8  # at a step of the constants, ten times shorter each
FIRST_DAMPING = 1e-4
STATE_DAMPING = 1e-3  # the first one of an initial state
MAX_STATE_ATTEMPTS = 6
BATCH_PROBLEMS = 256  # whose residuals are held at a time, each with its unknowns moved
MORE_STATE_STEPS = 6  # times as many, where no step of the constants helps
FLAT_GAIN = 0.5  # or in any case: less than a standard deviation along a direction that the data hardly know
ROUGH_LOSS = 10.0  # times the tolerance: what a step may still predict where the loss is rough
ARRIVED_SD = 0.02  # of a standard deviation: a step still wanted that is small enough
WIDE_SD = 4.0  # times a constant's standard deviation must fit into its bounds, or the data say nothing of it
log = logging.getLogger(__name__)
Evaluate = Callable[[Array, Array, NDArray[np.int64]], Array]
"""(k, p) initial states, (k, q) constants, (k,) problem numbers -> (k, m) residuals in units of noise, NaN unused."""


@dataclass(frozen=True)
class Prior:
    """Gaussian knowledge of unknowns: residuals (x - mean) / sd beside the data; sd inf is none."""

    mean: Array
    sd: Array

    def residuals(self, x: Array) -> Array:
        """(k, p) for (k, p) unknowns."""
        return (x - self.mean) / self.sd

    def only(self, rows: NDArray[np.int64]) -> Prior:
        """That of some problems."""
        return Prior(self.mean[rows], self.sd[rows])


def loss(residuals: Array, c: float) -> Array:
    """Half the loss of every problem: (n,) for (n, m) residuals; NaN counts nothing, infinite c is least squares."""
    return robust_loss(residuals, c)


def weights(residuals: Array, c: float) -> Array:
    """Weights that make least squares follow the loss: (n, m)."""
    r = np.nan_to_num(residuals)
    return np.isfinite(residuals) / (1.0 + (r / c) ** 2)


def moved(evaluate: Evaluate, x: Array, c: Array, which: NDArray[np.int64], steps: Array, steps_c: Array) -> Array:
    """Residuals (1 + p + q, n, m) at a point, and with each unknown, then each constant, moved by its step."""
    (n, p), q = x.shape, len(steps_c)
    rows = np.tile(x, (1 + p + q, 1, 1))
    constants = np.tile(c, (1 + p + q, n, 1))
    for k in range(p):
        rows[1 + k, :, k] += steps[k]
    for k in range(q):
        constants[1 + p + k, :, k] += steps_c[k]
    count = (1 + p + q) * n
    r = evaluate(rows.reshape(count, p), constants.reshape(count, c.size), np.tile(which, 1 + p + q))
    return r.reshape(1 + p + q, n, -1)


def differences(
    evaluate: Evaluate, x: Array, c: Array, which: NDArray[np.int64], steps: Array, steps_c: Array
) -> tuple[Array, Array, Array]:
    """Residuals (n, m) and their derivatives by initial states (n, m, p) and constants (n, m, q), in one call."""
    r = moved(evaluate, x, c, which, steps, steps_c)
    d = np.nan_to_num((r[1:] - r[0]) / np.concatenate([steps, steps_c])[:, None, None])
    p = x.shape[1]
    return r[0], np.moveaxis(d[:p], 0, -1), np.moveaxis(d[p:], 0, -1)


def fit_each(
    evaluate: Evaluate,
    x: Array,
    c: Array,
    steps: Array,
    prior: Prior,
    robust: float,
    iterations: int,
    which: NDArray[np.int64] | None = None,
    tolerance: float = 1e-4,
) -> tuple[Array, Array]:
    """Initial states of every problem at given constants; returns them and the cost: (n, p), (n,)."""
    n, p = x.shape
    which = np.arange(n) if which is None else which
    x, damping, cost = x.copy(), np.full(n, STATE_DAMPING), np.full(n, np.inf)
    active = np.arange(n)
    means, sds = np.broadcast_to(prior.mean, (n, p)), np.broadcast_to(prior.sd, (n, p))
    for _step in range(iterations):
        here = Prior(means[active], sds[active])
        parts = [
            from_differences(moved(evaluate, x[some], c, which[some], steps, np.zeros(0)), steps, robust)
            for some in np.split(active, range(BATCH_PROBLEMS, active.size, BATCH_PROBLEMS))
        ]
        rp = here.residuals(x[active])
        cost[active] = np.concatenate([part.loss for part in parts]) + 0.5 * np.sum(rp * rp, axis=1)
        a = np.concatenate([part.matrix for part in parts])
        g = np.concatenate([part.gradient for part in parts]) + rp / here.sd
        diagonal = np.einsum("npp->np", a) + 1 / here.sd**2
        trial, trial_cost = x[active].copy(), np.full(active.size, np.inf)
        todo = np.arange(active.size)
        for _ in range(MAX_STATE_ATTEMPTS):
            lhs = a[todo] + np.einsum(
                "np,pq->npq", 1 / here.sd[todo] ** 2 + damping[active[todo], None] * diagonal[todo] + 1e-12, np.eye(p)
            )
            step = -np.linalg.solve(lhs, g[todo][..., None])[..., 0]
            new = x[active[todo]] + step
            r_new = evaluate(new, np.broadcast_to(c, (todo.size, c.size)), which[active[todo]])
            rp_new = Prior(here.mean[todo], here.sd[todo]).residuals(new)
            new_cost = loss(r_new, robust) + 0.5 * np.sum(rp_new * rp_new, axis=1)
            better = new_cost < cost[active[todo]]
            trial[todo[better]], trial_cost[todo[better]] = new[better], new_cost[better]
            damping[active[todo[better]]] = np.maximum(damping[active[todo[better]]] / 10, 1e-9)
            todo = todo[~better]
            damping[active[todo]] *= 10
            if todo.size == 0:
                break
        done = ~np.isfinite(trial_cost)
        gain = np.where(done, 0.0, cost[active] - np.where(done, 0.0, trial_cost))
        x[active] = trial
        cost[active] = np.where(done, cost[active], trial_cost)
        active = active[gain > tolerance * (1.0 + cost[active])]
        if active.size == 0:
            break
    return x, cost


@dataclass(frozen=True)
class Solution:
    """A joint fit: initial states (n, p), constants (q,), their covariance (q, q), and whether it converged."""

    initial_states: Array
    constants: Array
    covariance: Array  # of the constants; NaN where it could not be computed
    cost: float
    converged: bool
    information: Array  # (n, q, q) what each problem says of the constants
    gradient: Array  # (n, q) of each problem's cost by the constants, its initial state eliminated


def _eliminate(
    evaluate: Evaluate, x: Array, c: Array, steps: Array, steps_c: Array, prior: Prior, robust: float
) -> tuple[Array, Array, Array, Array]:
    """`eliminated` at a point, from finite differences."""
    rows = moved(evaluate, x, c, np.arange(len(x)), steps, steps_c)
    return _eliminated_states(from_differences(rows, np.concatenate([steps, steps_c]), robust), x, prior)


def eliminated(
    r: Array, jx: Array, jc: Array, x: Array, prior: Prior, robust: float
) -> tuple[Array, Array, Array, Array]:
    """Information (n, q, q) and score (n, q) on the constants, initial states eliminated; step map (n, p, q), (n, p).

    From residuals (n, m) and their derivatives by initial states (n, m, p) and constants (n, m, q).
    """
    return _eliminated_states(from_jacobian(r, np.concatenate([jx, jc], axis=2), robust), x, prior)


def _eliminated_states(normal: NormalEquations, x: Array, prior: Prior) -> tuple[Array, Array, Array, Array]:
    n, p = x.shape
    sd = np.broadcast_to(prior.sd, (n, p))
    axx = normal.matrix[:, :p, :p] + np.einsum("np,pq->npq", 1 / sd**2 + 1e-9, np.eye(p))
    axc, acc = normal.matrix[:, :p, p:], normal.matrix[:, p:, p:]
    gx, gc = normal.gradient[:, :p] + prior.residuals(x) / sd, normal.gradient[:, p:]
    solved = np.linalg.solve(axx, np.concatenate([axc, gx[..., None]], axis=2))
    lift, back = solved[..., :-1], solved[..., -1]
    information = acc - np.swapaxes(axc, 1, 2) @ lift
    score = gc - np.einsum("npq,np->nq", axc, back)
    return information, score, lift, back


def fit_joint(
    evaluate: Evaluate,
    x: Array,
    c: Array,
    steps: Array,
    steps_c: Array,
    prior: Prior,
    bounds: Array,
    robust: float,
    iterations: int = 20,
    state_iterations: int = 2,
    tolerance: float = 1e-5,
    known: Prior | None = None,
    what: str = "fit",
) -> Solution:
    """Shared constants (q,) within bounds (q, 2), with every problem's initial state fitted beside them.

    What is known of the constants beside the data is `known`, (q,) each; sd inf is nothing. `what` is being fitted, for
    the log.

    Converged means that the last full (undamped) step asked to change no constant by more than 2 % of its standard
    deviation, or predicted to lower the loss by less than `tolerance` of itself, or by less than ten
    times that after steps that gained nothing. The covariance is the larger of the
    inverse information and the sandwich over problems, which holds where the model is not quite right.
    """
    x, cost_each = fit_each(evaluate, x, c, steps, prior, robust, 3 * state_iterations)
    # A constant of which the data say nothing stays near its start: bounds as a very wide Gaussian.
    begin, width = c.copy(), np.maximum(bounds[:, 1] - bounds[:, 0], 1e-12)
    wide = width.copy()
    if known is not None:
        told = np.isfinite(known.sd)
        begin[told], wide[told] = known.mean[told], known.sd[told]

    def leash(at: Array) -> float:
        return 0.5 * float(np.sum(((at - begin) / wide) ** 2))

    cost, damping, converged, stalled = float(cost_each.sum()) + leash(c), FIRST_DAMPING, False, 0
    for iteration in range(iterations):
        information, score, lift, back = _eliminate(evaluate, x, c, steps, steps_c, prior, robust)
        h = information.sum(axis=0) + np.diag(1 / wide**2)
        g = score.sum(axis=0) + (c - begin) / wide**2
        full = np.linalg.lstsq(h, g, rcond=None)[0]
        log.info("%s, step %d: loss %.0f", what, iteration, cost)
        sd = np.sqrt(np.maximum(np.diag(np.linalg.pinv(h)), 0))
        # One at its bound that pushes out has arrived.
        inside = ((c > bounds[:, 0]) | (full < 0)) & ((c < bounds[:, 1]) | (full > 0))
        predicted = 0.5 * float(g @ full)
        arrived = bool(np.all(np.abs(full[inside]) < ARRIVED_SD * sd[inside]) or predicted < tolerance * cost)
        improved, state_steps = False, state_iterations
        for attempt in range(1 if arrived else 2 * MAX_ATTEMPTS):
            if (
                attempt == MAX_ATTEMPTS
            ):  # no step helps: perhaps since initial states do not get where it would lead them
                damping, state_steps = FIRST_DAMPING, MORE_STATE_STEPS * state_iterations
            step = -np.linalg.solve(h + damping * np.diag(np.diag(h)) + 1e-12 * np.eye(c.size), g)
            new_c = np.clip(c + step, bounds[:, 0], bounds[:, 1])
            new_x = _best_start(evaluate, new_c, prior, robust, x, back, np.einsum("npq,q->np", lift, new_c - c))
            new_x, new_each = fit_each(evaluate, new_x, new_c, steps, prior, robust, state_steps)
            if new_each.sum() + leash(new_c) < cost:
                improved = True
                break
            damping *= 10
        if not improved:
            # No step lowers the loss: at the optimum if the wanted step is small against the uncertainty.
            converged = arrived or bool(np.all(np.abs(full) < 0.1 * sd + 1e-12))
            break
        new_cost = float(new_each.sum()) + leash(new_c)
        # A loss that is rough at the scale of what is left to gain has no better optimum to offer.
        stalled = stalled + 1 if cost - new_cost < tolerance * cost else 0
        arrived = arrived or (stalled >= STALLED_STEPS and predicted < max(ROUGH_LOSS * tolerance * cost, FLAT_GAIN))
        x, c, cost = new_x, new_c, new_cost
        damping = max(damping / 10, 1e-9)
        if arrived:
            converged = True
            break
        if stalled > STALLED_STEPS:
            break
    information, score, _, _ = _eliminate(evaluate, x, c, steps, steps_c, prior, robust)
    found = covariance(information, score, width, np.where(wide < width, 1 / wide**2, 0.0))
    return Solution(x, c, found, cost, converged, information, score)


def _best_start(
    evaluate: Evaluate, c: Array, prior: Prior, robust: float, x: Array, back: Array, lifted: Array
) -> Array:
    """Initial states after a step of the constants: as they were, moved with it, or by Newton's step; each its best."""
    n = len(x)
    starts = np.stack([x, x - lifted, x - lifted - back])
    r = evaluate(starts.reshape(3 * n, -1), np.tile(c, (3 * n, 1)), np.tile(np.arange(n), 3)).reshape(3, n, -1)
    costs = loss(r, robust) + 0.5 * np.sum(np.stack([prior.residuals(s) for s in starts]) ** 2, axis=-1)
    return np.asarray(starts[np.argmin(costs, axis=0), np.arange(n)])


def covariance(information: Array, score: Array, wide: Array, beside: Array | None = None) -> Array:
    """Of the constants, from what each problem says: (q, q); NaN for those known no better than a quarter of `wide`.

    `beside` (q,) is what is known of each constant apart from the problems, as 1 / sd^2.
    """
    h = information.sum(axis=0)
    q = len(h)
    if beside is not None:
        h = h + np.diag(beside)
    known = np.diag(h) > (WIDE_SD / wide) ** 2
    out = np.full((q, q), np.nan)
    if not known.any():
        return out
    k = np.ix_(known, known)
    inverse = np.linalg.pinv(h[k])
    s = score[:, known]
    n = max(int(np.sum(np.any(s != 0, axis=1))), 1)
    sandwich = inverse @ (s.T @ s) @ inverse * (n / max(n - known.sum(), 1))
    # Take correlations from the information, the larger of both standard deviations.
    grow = np.sqrt(np.maximum(1.0, np.diag(sandwich) / np.maximum(np.diag(inverse), 1e-300)))
    out[k] = inverse * np.outer(grow, grow)
    return out
