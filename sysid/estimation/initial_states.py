"""The initial state of every shot, at given constants.

In: a problem, constants, where to begin. Out: initial states, and the loss of each shot.

A whole shot has many local optima beyond its first impacts, so the horizon grows from event to event, with a
discrepancy in proportion to the path length tolerated; shots that do not fit are tried again with other spins. The
whole shot, with equal weight for every sample, comes last.

A commanded shot is a starting point and not the truth. The scatter of speed and azimuth about their commands, which
tracks show, is estimated robustly over all commanded clips, and is never taken below the repeatability of a good
launcher. A part of the azimuth's error that is proportional to the commanded side offset is no scatter but squirt, and
is regressed out. Tip offsets keep their wide prior: where a track does not determine a spin, the spin stays at its
command, and its scatter would be estimated as none. Clips without commands keep theirs, too.
"""

from __future__ import annotations

import dataclasses
import logging

import numpy as np

from sysid.estimation.problem import CAUCHY_SD, Array, Index
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.least_squares import Prior, fit_each, loss

STAGE_STEPS, RETRY_STEPS = 6, 4  # steps of a stage, and of a trial from another spin
RETRY_LOSS = 4.0  # times the loss of noise beyond which a shot is tried from other spins
RETRY_SPINS = ((6, -0.8), (6, -0.3), (6, 0.3), (6, 0.8), (5, -0.7), (5, 0.7))  # unknown, shift over speed
# A sidespin that has decayed before a cushion no longer shows in its derivatives: a grid of other spins is tried.
OTHER_SPINS = (
    *((6, s * sign) for s in (0.03, 0.07, 0.12, 0.2, 0.35, 0.6, 0.9) for sign in (-1, 1)), (5, -0.3), (5, 0.3),
)  # unknown, shift over speed  # fmt: skip
OTHER_SPIN_STEPS = 15
REGROWN_STEPS = 40
BETTER_LOSS = 1e-3  # share of its loss by which a shot that is grown again must improve
POLISH_STEPS, POLISH_ROUNDS = 10, 2
CLIPPED_RESIDUAL_SD = 4.0  # times a shot's scatter, as which larger residuals count in it
MIN_COMMANDED_CLIPS = 5  # from which a scatter is estimated
CLIPPED_SCATTER_SD = 2.0  # robust standard deviations, as which larger errors count: another stroke, or a false optimum
LAUNCHER_REPEATABILITY = {"speed": 0.003, "azimuth": 0.001}  # fraction, [rad]: no launcher does better
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
    found, _ = fit_each(problem.objective(), x, c, steps, tolerance=tolerance)
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
    objective = problem.objective()
    best, cost = fit_each(objective, x[todo], c, STAGE_STEPS, todo)
    if not retry:
        return best
    r = problem.evaluate(best, np.tile(c, (todo.size, 1)), todo)
    bad = np.flatnonzero(loss(r, CAUCHY_SD) > RETRY_LOSS * np.isfinite(r).sum(axis=1) / 2)
    if bad.size == 0:
        return best
    for unknown, shift in RETRY_SPINS:
        moved = best[bad].copy()
        moved[:, unknown] += shift * np.hypot(moved[:, 2], moved[:, 3])
        new, new_cost = fit_each(objective, moved, c, RETRY_STEPS, todo[bad])
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


def from_other_spins(problem: ShotProblem, rows: Index, x: Array, c: Array, scale: float = 1.0) -> Array:
    """Initial states with some shots tried from other spins, at constants (q,); those that end better are kept.

    From their present state and from their start values: a shot in a false optimum may have no good one near it. The
    spins are multiplied by `scale`.
    """
    shifts = [(base, *spin) for base in (x, problem.start) for spin in OTHER_SPINS] + [(problem.start, 6, 0.0)]
    k = len(shifts)
    which, moved = np.tile(rows, k), np.stack([base[rows] for base, _, _ in shifts])
    for trial, (_, unknown, shift) in zip(moved, shifts, strict=True):
        trial[:, unknown] += scale * shift * np.hypot(trial[:, 2], trial[:, 3])
    tried, cost = fit_each(problem.objective(), moved.reshape(len(which), -1), c, OTHER_SPIN_STEPS, which)
    best = np.argmin(cost.reshape(k, len(rows)), axis=0)
    better = cost.reshape(k, -1)[best, np.arange(len(rows))] < shot_losses(problem, x, c)[0][rows]
    x = x.copy()
    x[rows[better]] = tried.reshape(k, len(rows), -1)[best, np.arange(len(rows))][better]
    return x


def polished(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Initial states of whole shots by least squares, Cauchy's loss being scaled to each shot's clipped scatter."""
    n = len(x)
    for _ in range(POLISH_ROUNDS):
        r = problem.evaluate(x, np.tile(c, (n, 1)), np.arange(n))
        limit = CLIPPED_RESIDUAL_SD * np.nanstd(r, axis=1, keepdims=True)
        scale = np.maximum(np.sqrt(np.nanmean(np.minimum(np.abs(r), limit) ** 2, axis=1)), 1.0)
        scaled = dataclasses.replace(
            problem, sd=problem.sd * scale[:, None, None], sd_theta=problem.sd_theta * scale
        )  # fmt: skip
        x = fit_states(scaled, x, c, POLISH_STEPS)
    return x


def with_scatter(problem: ShotProblem, x: Array) -> ShotProblem:
    """The problem, its commands known as well as the scatter of initial states x (n, p) about them."""
    rows = np.array([k for k, clip in enumerate(problem.clips) if clip.cue is not None], int)
    if rows.size < MIN_COMMANDED_CLIPS:
        return problem
    cues = [cue for k in rows if (cue := problem.clips[k].cue) is not None]
    speed, side = np.array([cue.speed for cue in cues]), np.array([cue.side for cue in cues])
    error = x[rows] - problem.prior.mean[rows]
    sd = problem.prior.sd.copy()
    sd[rows, 2] = _robust_sd(error[:, 2] / speed, LAUNCHER_REPEATABILITY["speed"]) * speed
    sd[rows, 3] = _robust_sd(_regressed_out(error[:, 3] / speed, side), LAUNCHER_REPEATABILITY["azimuth"]) * speed
    return dataclasses.replace(problem, prior=Prior(problem.prior.mean, sd))


def _robust_sd(values: Array, floor: float) -> float:
    """Standard deviation about 0 of values (n,), outliers clipped; `floor` at least."""
    limit = CLIPPED_SCATTER_SD * 1.4826 * float(np.median(np.abs(values)))
    return max(float(np.sqrt(np.mean(np.clip(values, -limit, limit) ** 2))), floor)


def _regressed_out(values: Array, regressor: Array) -> Array:
    """Residuals (n,) of a proportionality to a regressor (n,), scaled up for the degree of freedom that it takes."""
    power = float(regressor @ regressor)
    residual = values - regressor * (float(regressor @ values) / power) if power > 0 else values
    return np.asarray(residual * np.sqrt(len(values) / max(len(values) - 1, 1)))
