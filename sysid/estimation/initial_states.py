"""The initial state of every shot, at given constants.

A whole shot has many false optima beyond its first impacts, so the horizon grows from event to event, errors being
forgiven in proportion to the path length, most of all since the first event; shots that do not fit are tried again
with other spins. Last comes the whole shot with equal weight for every sample.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from sysid.estimation.least_squares import fit_each, loss
from sysid.estimation.problem import CAUCHY_SD, Array, Index
from sysid.estimation.shot_problem import ShotProblem

STAGE_STEPS, RETRY_STEPS = 6, 4  # steps of a stage, and of a trial from another spin
RETRY_LOSS = 4.0  # times the loss of noise beyond which a shot is tried from other spins
RETRY_SPINS = ((6, -0.8), (6, -0.3), (6, 0.3), (6, 0.8), (5, -0.7), (5, 0.7))  # unknown, shift over speed
# Where a sidespin has died out before a cushion, its start no longer shows: other spins are tried by hand.
SIDESPINS = (0.03, 0.07, 0.12, 0.2, 0.35, 0.6, 0.9)
OTHER_SPINS = (
    *((6, s * sign) for s in SIDESPINS for sign in (-1, 1)),
    (5, -0.3),
    (5, 0.3),
)  # unknown, shift over speed
OTHER_SPIN_STEPS = 15
REGROWN_STEPS = 40
BETTER_LOSS = 1e-3  # of itself, by which the loss of a shot that is grown again must fall
POLISH_STEPS, POLISH_ROUNDS = 10, 2
CLIPPED_SD = 4.0  # times a shot's scatter, as which larger residuals count in it
log = logging.getLogger(__name__)


def shot_losses(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array]:
    """Loss of every shot, its prior with it, and how many residuals it has: (n,), (n,)."""
    n = len(x)
    r = problem.evaluate(x, np.tile(c, (n, 1)), np.arange(n))
    return loss(r, CAUCHY_SD) + 0.5 * np.sum(problem.prior.residuals(x) ** 2, axis=1), np.isfinite(r).sum(axis=1)


def losses_per_residual(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Loss of every shot over the number of its residuals: (n,); a half for noise."""
    total, count = shot_losses(problem, x, c)
    return np.asarray(total / np.maximum(count, 1))


def fit_states(problem: ShotProblem, x: Array, c: Array, steps: int, tolerance: float = 1e-4) -> Array:
    """Initial states (n, p) at constants (q,), from nearly right ones, in so many steps."""
    found, _ = fit_each(problem.evaluate, x, c, problem.steps, problem.prior, CAUCHY_SD, steps, tolerance=tolerance)
    return found


def grown_states(problem: ShotProblem, c: Array) -> Array:
    """The initial state of every shot at constants (q,), grown from event to event: (n, p)."""
    x = problem.start.copy()
    for stage in range(problem.stages):
        x = grown_by_stage(problem, x, c, stage)
        log.info("shots up to event %d of %d", stage + 1, problem.stages)
    return x


def grown_by_stage(problem: ShotProblem, x: Array, c: Array, stage: int) -> Array:
    """Initial states at a stage, from those of the stage before: (n, p)."""
    todo = np.flatnonzero(problem.horizon_at(stage) > problem.horizon_at(stage - 1))
    x = x.copy()
    if todo.size:
        x[todo] = _stage(problem.growing(stage), x, c, todo, retry=stage > 0)
    return x


def _stage(problem: ShotProblem, x: Array, c: Array, todo: Index, retry: bool) -> Array:
    prior = problem.prior.only(todo)
    best, cost = fit_each(problem.evaluate, x[todo], c, problem.steps, prior, CAUCHY_SD, STAGE_STEPS, todo)
    if not retry:
        return best
    r = problem.evaluate(best, np.tile(c, (todo.size, 1)), todo)
    bad = np.flatnonzero(loss(r, CAUCHY_SD) > RETRY_LOSS * np.isfinite(r).sum(axis=1) / 2)
    if bad.size == 0:
        return best
    for unknown, shift in RETRY_SPINS:
        moved = best[bad].copy()
        moved[:, unknown] += shift * np.hypot(moved[:, 2], moved[:, 3])
        new, new_cost = fit_each(
            problem.evaluate, moved, c, problem.steps, prior.only(bad), CAUCHY_SD, RETRY_STEPS, todo[bad]
        )
        better = new_cost < cost[bad]
        best[bad[better]], cost[bad[better]] = new[better], new_cost[better]
    return best


def regrown(problem: ShotProblem, rows: Index, x: Array, c: Array, steps: int = REGROWN_STEPS) -> tuple[Array, int]:
    """Initial states with some shots grown again from their strike; those that end better are kept, and counted."""
    part = problem.only(rows)
    new = fit_states(part, grown_states(part, c), c, steps)
    better = losses_per_residual(part, new, c) < losses_per_residual(part, x[rows], c) * (1 - BETTER_LOSS)
    x = x.copy()
    x[rows[better]] = new[better]
    return x, int(better.sum())


def from_other_spins(problem: ShotProblem, rows: Index, x: Array, c: Array) -> Array:
    """Initial states with some shots tried from other spins, at constants (q,); those that end better are kept.

    From where they are, and from where they began: one that has gone far astray has no good optimum near it.
    """
    shifts = [(base, *spin) for base in (x, problem.start) for spin in OTHER_SPINS] + [(problem.start, 6, 0.0)]
    k = len(shifts)
    which, moved = np.tile(rows, k), np.stack([base[rows] for base, _, _ in shifts])
    for trial, (_, unknown, shift) in zip(moved, shifts, strict=True):
        trial[:, unknown] += shift * np.hypot(trial[:, 2], trial[:, 3])
    tried, cost = fit_each(
        problem.evaluate, moved.reshape(len(which), -1), c, problem.steps, problem.prior.only(which), CAUCHY_SD,
        OTHER_SPIN_STEPS, which,
    )  # fmt: skip
    best = np.argmin(cost.reshape(k, len(rows)), axis=0)
    better = cost.reshape(k, -1)[best, np.arange(len(rows))] < shot_losses(problem, x, c)[0][rows]
    x = x.copy()
    x[rows[better]] = tried.reshape(k, len(rows), -1)[best, np.arange(len(rows))][better]
    return x


def polished(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Whole shots, by their noise alone: least squares but for what lies beyond four times a shot's own scatter."""
    n = len(x)
    for _ in range(POLISH_ROUNDS):
        r = problem.evaluate(x, np.tile(c, (n, 1)), np.arange(n))
        far = CLIPPED_SD * np.nanstd(r, axis=1, keepdims=True)
        scale = np.maximum(np.sqrt(np.nanmean(np.minimum(np.abs(r), far) ** 2, axis=1)), 1.0)
        scaled = dataclasses.replace(
            problem, sd=problem.sd * scale[:, None, None], sd_theta=problem.sd_theta * scale
        )  # fmt: skip
        x = fit_states(scaled, x, c, POLISH_STEPS)
    return x
