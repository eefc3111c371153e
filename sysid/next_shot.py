"""The shot that would tell two models apart, within what the launcher can play.

Each of many shots is played in one model and looked at in the other. What the other could make up for by its own
unknowns, within the scatter of the commands, or by constants within their uncertainty, does not count: the shot whose
difference is most standard deviations after that is proposed.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import qmc

from models.model_file import Model
from models.observe import observed
from models.shot import Shot
from sysid.clips import Clip, ClipSet, Cue, Observation
from sysid.evidence import Point
from sysid.problem import Array, shot_problem, turn
from sysid.solve import Prior, differences

SHOTS = 64  # tried; a power of two
SECONDS = 4.0
FPS = 60.0
SPEEDS = (0.6, 2.7)  # of the ball [m/s] (Robotic Billiards 2015: to 2.75)
OFFSET = 0.012  # of the tip, sideways and up [m] (the same)
COMMAND_SD = (0.01, 0.005, 0.0003)  # speed (fraction), azimuth [rad], offsets [m]


@dataclass(frozen=True)
class NextShot:
    """What to play, and how far it would part the two."""

    cue: Cue
    place: tuple[float, float]  # of the ball [m]
    sigmas: float  # between the two predictions
    why: str

    def told(self) -> dict[str, Any]:
        """As result.json has it."""
        return {
            "why": self.why, "cue": dataclasses.asdict(self.cue), "ball": list(self.place), "separates_sd": self.sigmas
        }  # fmt: skip


def propose(one: Point, two: Model, covariance: Array, sigma: float, why: str, seed: int = 0) -> NextShot:
    """The shot, of one cue ball, that parts model `one` (with its constants' covariance) from model `two` most."""
    model = one.model
    table, radius = model.table, model.ball.radius
    unit = qmc.Sobol(6, seed=seed).random(SHOTS)
    room = np.array([table.length / 2, table.width / 2]) - 4 * radius
    low = np.array([SPEEDS[0], -np.pi, -OFFSET, -OFFSET, -room[0], -room[1]])
    high = np.array([SPEEDS[1], np.pi, OFFSET, OFFSET, room[0], room[1]])
    plan = low + unit * (high - low)
    plan[:, 2:4] *= np.minimum(1.0, OFFSET / np.maximum(np.hypot(plan[:, 2], plan[:, 3]), 1e-9))[:, None]
    plan[::2, 2] = 0.0  # half of them without side
    times = np.arange(0, SECONDS, 1 / FPS)
    shots, clips, cues = [], [], []
    for speed, azimuth, side, height, x, y in plan:
        q, lever = turn(azimuth), 2.5 * speed / radius**2
        spin = np.array([*(q @ np.array([0.0, lever * height])), lever * side])
        shots.append(Shot(("cue",), np.array([[x, y]]), (q @ np.array([speed, 0.0]))[None], spin[None], times))
    for (speed, azimuth, side, height, _x, _y), track in zip(plan, observed(two, shots), strict=True):
        seen = np.isfinite(track.position[:, 0, 0])
        xy = track.position[seen, 0]
        cue = Cue(float(speed), float(azimuth), float(side), float(height), 0.0)
        cues.append(cue)
        clips.append(Clip("", "cue", {"cue": Observation(times[seen], xy, np.full(len(xy), np.nan))}, cue))
    fine = [k for k, c in enumerate(clips) if len(c.balls["cue"].time) > FPS / 2]
    clips, cues, plan = [clips[k] for k in fine], [cues[k] for k in fine], plan[fine]
    known = ClipSet(table, model.ball, FPS, tuple(clips), sigma)
    problem = shot_problem(one.problem.model, one.problem.names, known, sigma)
    mean = problem.prior.mean.copy()
    mean[:, :2] = plan[:, 4:6]
    lever = 2.5 * plan[:, 0] / radius
    sd = np.column_stack(
        [np.full((len(plan), 2), 1e-3), COMMAND_SD[0] * plan[:, 0], COMMAND_SD[1] * plan[:, 0],
         np.full(len(plan), 0.02), COMMAND_SD[2] * lever + 0.01, COMMAND_SD[2] * lever + 0.01]
    )  # fmt: skip
    problem = dataclasses.replace(problem, prior=Prior(mean, sd))
    steps = 1e-5 * np.array([np.subtract(*problem.model.meta(n)["bounds"][::-1]) for n in problem.names])
    r, jx, jc = differences(problem.evaluate, mean, one.c, np.arange(len(plan)), problem.steps, steps)
    sound = np.nan_to_num(covariance)
    apart = np.zeros(len(plan))
    for k in range(len(plan)):
        use = np.isfinite(r[k])
        j = np.concatenate([jx[k, use], jc[k, use]], axis=1)
        p = np.zeros((j.shape[1],) * 2)
        p[:7, :7], p[7:, 7:] = np.diag(sd[k] ** 2), sound
        d = r[k, use]
        # d' (1 + J P J')^-1 d
        inner = np.linalg.solve(np.eye(len(p)) + p @ (j.T @ j), p @ (j.T @ d))
        apart[k] = np.sqrt(max(float(d @ d - (j.T @ d) @ inner), 0.0))
    best = int(np.argmax(apart))
    rounded = Cue(*(float(f"{v:.4f}") for v in dataclasses.astuple(cues[best])))
    place = (float(f"{plan[best, 4]:.3f}"), float(f"{plan[best, 5]:.3f}"))
    return NextShot(rounded, place, float(apart[best]), why)
