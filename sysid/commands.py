"""How well a cue keeps to its commands, from the shots themselves.

A commanded shot is a starting point and not the truth; how far the real ones scatter around the commands says how much
a command tells. The scatter of speed and azimuth, which the tracks show, is taken over all commanded clips, robustly,
and never below what a good launcher repeats. Tip offsets keep their wide start: where a track says nothing of a spin
it stays at its command, and its scatter would look like none. So do clips without commands.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from sysid.problem import Array, ShotProblem
from sysid.solve import Prior

LEAST = 5  # commanded clips from which a scatter is estimated
REPEATS = {"speed": 0.003, "azimuth": 0.001}  # fraction, [rad]: no launcher does better


def with_scatter(problem: ShotProblem, x: Array) -> ShotProblem:
    """The problem, its commands known as well as own unknowns x (n, p) show."""
    rows = np.array([k for k, clip in enumerate(problem.clips) if clip.cue is not None], int)
    if rows.size < LEAST:
        return problem
    speed = np.array([problem.clips[k].cue.speed for k in rows])
    away = x[rows] - problem.prior.mean[rows]
    sd = problem.prior.sd.copy()

    def spread(values: Array, least: float) -> float:
        return max(1.4826 * float(np.median(np.abs(values))), least)

    sd[rows, 2] = spread(away[:, 2] / speed, REPEATS["speed"]) * speed
    sd[rows, 3] = spread(away[:, 3] / speed, REPEATS["azimuth"]) * speed
    return dataclasses.replace(problem, prior=Prior(problem.prior.mean, sd))
