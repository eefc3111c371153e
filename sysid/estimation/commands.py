"""How well a cue keeps to its commands, from the shots themselves.

A commanded shot is a starting point and not the truth; how far the real ones scatter around the commands says how much
a command tells. The scatter of speed and azimuth, which the tracks show, is taken over all commanded clips, robustly,
and never below what a good launcher repeats. What goes with the commanded side is no scatter: a cue that squirts would
hide in it. Tip offsets keep their wide start: where a track says nothing of a spin it stays at its command, and its
scatter would look like none. So do clips without commands.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from sysid.estimation.least_squares import Prior
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem

LEAST = 5  # commanded clips from which a scatter is estimated
CLIPPED = 2.0  # times the median's standard deviation, beyond which a stroke was another one, or its fit astray
REPEATS = {"speed": 0.003, "azimuth": 0.001}  # fraction, [rad]: no launcher does better


def with_scatter(problem: ShotProblem, x: Array) -> ShotProblem:
    """The problem, its commands known as well as initial states x (n, p) show."""
    rows = np.array([k for k, clip in enumerate(problem.clips) if clip.cue is not None], int)
    if rows.size < LEAST:
        return problem
    cues = [cue for k in rows if (cue := problem.clips[k].cue) is not None]
    speed, side = np.array([cue.speed for cue in cues]), np.array([cue.side for cue in cues])
    away = x[rows] - problem.prior.mean[rows]
    sd = problem.prior.sd.copy()
    sd[rows, 2] = _spread(away[:, 2] / speed, REPEATS["speed"]) * speed
    sd[rows, 3] = _spread(_beside(away[:, 3] / speed, side), REPEATS["azimuth"]) * speed
    return dataclasses.replace(problem, prior=Prior(problem.prior.mean, sd))


def _spread(values: Array, least: float) -> float:
    """Standard deviation about 0 of values (n,), those far out counted as less; `least` at least."""
    far = CLIPPED * 1.4826 * float(np.median(np.abs(values)))
    return max(float(np.sqrt(np.mean(np.clip(values, -far, far) ** 2))), least)


def _beside(values: Array, by: Array) -> Array:
    """What is left of values (n,) beside a proportion to others (n,), as much as it would be without one."""
    power = float(by @ by)
    left = values - by * (float(by @ values) / power) if power > 0 else values
    return np.asarray(left * np.sqrt(len(values) / max(len(values) - 1, 1)))
