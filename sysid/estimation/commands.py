"""How far shots scatter about their commands: the prior of the initial states, estimated from the shots themselves.

In: a problem and the initial states fitted so far. Out: the problem with the standard deviations of the commands.

A commanded shot is a starting point and not the truth. The scatter of speed and azimuth about their commands, which
tracks show, is estimated robustly over all commanded clips, and is never taken below the repeatability of a good
launcher. A part of the azimuth's error that is proportional to the commanded side offset is no scatter but squirt, and
is regressed out. Tip offsets keep their wide prior: where a track does not determine a spin, the spin stays at its
command, and its scatter would be estimated as none. Clips without commands keep theirs, too.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from sysid.estimation.least_squares import Prior
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem

MIN_COMMANDED_CLIPS = 5  # from which a scatter is estimated
CLIPPED_SCATTER_SD = 2.0  # robust standard deviations, as which larger errors count: another stroke, or a false optimum
LAUNCHER_REPEATABILITY = {"speed": 0.003, "azimuth": 0.001}  # fraction, [rad]: no launcher does better


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
