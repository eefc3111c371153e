"""Initial states of shots at given constants: refinement, likelihood, and scatter about the commands.

In: a problem, constants, start values. Out: initial states, and the loss or the likelihood of each shot.

A shot that the model does not follow has its own discrepancy, the most likely one. Its loss plus the logarithms of the
standard deviations is its negative log likelihood, by which initial states and models are compared.

A commanded shot is a starting point and not the truth. The scatter of speed and azimuth about their commands, which
tracks show, is estimated robustly over all commanded clips, and is never taken below the repeatability of a good
launcher. A part of the azimuth's error that is proportional to the commanded side offset is no scatter but squirt, and
is regressed out. Tip offsets keep their wide prior: where a track does not determine a spin, the spin stays at its
command, and its scatter would be estimated as none. Clips without commands keep theirs, too.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from sysid.estimation.problem import CAUCHY_SD, Array
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.least_squares import Prior, fit_each, loss

CHANCE_SD = 3.0  # standard deviations of a shot's chi-square that chance does not exceed
POLISH_STEPS, POLISH_ROUNDS = 10, 2
CLIPPED_RESIDUAL_SD = 4.0  # clip limit of residuals, in standard deviations of the shot's scatter
MIN_COMMANDED_CLIPS = 5  # from which a scatter is estimated
CLIPPED_SCATTER_SD = 2.0  # clip limit of errors, in robust standard deviations, for other strokes and false optima
LAUNCHER_REPEATABILITY = {"speed": 0.003, "azimuth": 0.001}  # fraction, [rad]: no launcher does better


def shot_losses(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array]:
    """Loss of every shot including its prior, and its number of residuals: (n,), (n,)."""
    losses, used = _losses(problem, x, c)
    return losses, used.sum(axis=1)


def _losses(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Loss of every shot including its prior, and which residuals it has: (n,), (n, m)."""
    n = len(x)
    r = problem.evaluate(x, np.tile(c, (n, 1)), np.arange(n))
    return loss(r, CAUCHY_SD) + 0.5 * np.sum(problem.prior.residuals(x) ** 2, axis=1), np.isfinite(r)


def within_noise(loss: Array, count: Array, correlation_time: float) -> NDArray[np.bool_]:
    """Whether shots miss by no more than noise explains, from their losses (n,) and numbers of residuals (n,)."""
    sd = np.sqrt(0.5 * correlation_time / np.maximum(count, 1))
    return np.asarray(loss / np.maximum(count, 1) <= 0.5 + CHANCE_SD * sd)


def followed(problem: ShotProblem, x: Array, c: Array, rate: float = 0.0) -> NDArray[np.bool_]:
    """Whether shots miss by no more than noise, and a discrepancy of this rate, explain: (n,)."""
    bare = problem.with_own_rates(np.zeros(len(x))).with_discrepancy(rate)
    return within_noise(*shot_losses(bare, x, c), problem.correlation_time)


def own_scores(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array]:
    """Negative log likelihood of every shot at its own most likely discrepancy, and these rates: (n,), (n,).

    States of one shot are compared by it, since it does not depend on the other shots.
    """
    rates = _own_rates(problem, x, c)
    return weighed_scores(problem.with_own_rates(rates), x, c, 0.0)[0], rates


def shot_scores(problem: ShotProblem, x: Array, c: Array) -> tuple[Array, Array]:
    """Negative log likelihood of every shot at its own discrepancy or the median one if larger, and rates: (n,), (n,).

    Models are compared by it, since none follows a shot better than most but by chance.
    """
    rates = _own_rates(problem, x, c)
    return weighed_scores(problem.with_own_rates(rates), x, c, float(np.median(rates)))[0], rates


def _own_rates(problem: ShotProblem, x: Array, c: Array) -> Array:
    """The most likely discrepancy rate of every shot (n,): 0 where it misses by no more than noise explains."""
    return np.where(followed(problem, x, c), 0.0, problem.discrepancy_rates(x, c))


def weighed_scores(problem: ShotProblem, x: Array, c: Array, rate: float) -> tuple[Array, Array]:
    """Negative log likelihood of every shot at these discrepancies, and its number of residuals: (n,), (n,)."""
    seen = problem.with_discrepancy(rate)
    losses, used = _losses(seen, x, c)
    logs, clip, ball = np.zeros(len(x)), -1, 0
    for k, _, xy in problem.by_ball(used.astype(float)):
        ball, clip = (ball + 1 if k == clip else 0), k
        logs[k] += float(np.sum(np.log(seen.sd[k, ball, : len(xy), None] / problem.noise_of_fits) * xy))
    return losses + logs, used.sum(axis=1)


def fit_states(problem: ShotProblem, x: Array, c: Array, steps: int) -> Array:
    """Refine initial states (n, p) at constants (q,) by a number of steps."""
    found, _ = fit_each(problem.objective(), x, c, steps)
    return found


def polished(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Initial states of whole shots by least squares, with Cauchy's loss scaled to each shot's clipped scatter."""
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
    """The problem, with the prior of commands given by the scatter of initial states x (n, p) about them."""
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
    """Standard deviation about 0 of values (n,), outliers clipped; at least `floor`."""
    limit = CLIPPED_SCATTER_SD * 1.4826 * float(np.median(np.abs(values)))
    return max(float(np.sqrt(np.mean(np.clip(values, -limit, limit) ** 2))), floor)


def _regressed_out(values: Array, regressor: Array) -> Array:
    """Residuals (n,) after regression on one regressor (n,), scaled up for the lost degree of freedom."""
    power = float(regressor @ regressor)
    residual = values - regressor * (float(regressor @ values) / power) if power > 0 else values
    return np.asarray(residual * np.sqrt(len(values) / max(len(values) - 1, 1)))
