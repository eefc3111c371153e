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

from models.model_file import Model
from models.shot import Shot
from models.simulation.observe import observed
from sysid.clips import Clip, ClipSet, Cue, Observation
from sysid.estimation.fitted import Point
from sysid.estimation.least_squares import Prior, differences
from sysid.estimation.problem import Array, constant_steps, turn
from sysid.estimation.shot_problem import shot_problem

SHOTS = 64  # tried; a power of two
SECONDS = 4.0
FPS = 60.0
SPEEDS = (0.6, 2.7)  # of the ball [m/s] (Robotic Billiards 2015: to 2.75)
OFFSET = 0.012  # of the tip, sideways and up [m] (the same)
CUT = 0.8  # of a ball's diameter, sideways, at which the other ball is met
FAR = 20.0  # standard deviations: two models that meet different balls are no further apart than that
COMMAND_SD = (0.01, 0.005, 0.0003)  # speed (fraction), azimuth [rad], offsets [m]


@dataclass(frozen=True)
class NextShot:
    """What to play, and how far it would part the two."""

    cue: Cue
    place: tuple[float, float]  # of the cue ball [m]
    other: tuple[float, float] | None  # of the ball to hit, if any [m]
    sigmas: float  # between the two predictions
    why: str

    def told(self) -> dict[str, Any]:
        """As result.json has it."""
        return {
            "why": self.why, "cue": dataclasses.asdict(self.cue), "ball": list(self.place),
            "other": list(self.other) if self.other else None, "separates_sd": self.sigmas,
        }  # fmt: skip


def propose(one: Point, two: Model, covariance: Array, sigma: float, why: str, seed: int = 0) -> NextShot:
    """The shot, of a cue ball alone or at another ball, that parts two models most.

    Args:
        one: a fit that has arrived, whose model is to be tested.
        two: the other model; the shots are played in it.
        covariance: of the constants of `one`, (q, q).
        sigma: noise of the camera [m].
        why: what the shot is for, in words.
        seed: of the shots tried.
    """
    from scipy.stats import qmc  # slow to load, and needed once

    model = one.model
    table, radius = model.table, model.ball.radius
    unit = qmc.Sobol(8, seed=seed).random(SHOTS)
    room = np.array([table.length / 2, table.width / 2]) - 4 * radius
    low = np.array([SPEEDS[0], -np.pi, -OFFSET, -OFFSET, -room[0], -room[1], 0.25, -CUT])
    high = np.array([SPEEDS[1], np.pi, OFFSET, OFFSET, room[0], room[1], 0.8, CUT])
    plan = low + unit * (high - low)
    plan[:, 2:4] *= np.minimum(1.0, OFFSET / np.maximum(np.hypot(plan[:, 2], plan[:, 3]), 1e-9))[:, None]
    plan[::2, 2] = 0.0  # half of them without side
    times = np.arange(0, SECONDS, 1 / FPS)
    shots, clips, cues, others = [], [], [], []
    for number, (speed, azimuth, side, height, x, y, far, cut) in enumerate(plan):
        q, lever = turn(azimuth), 2.5 * speed / radius**2
        spin = np.array([*(q @ np.array([0.0, lever * height])), lever * side])
        ball = np.array([x, y]) + q @ np.array([far, 2 * radius * cut])
        pair = number % 3 == 0 and bool(np.all(np.abs(ball) < room + 2 * radius))
        names = ("cue", "red") if pair else ("cue",)
        n = len(names)
        places, velocity, spins = np.array([[x, y], ball])[:n], np.zeros((n, 2)), np.zeros((n, 3))
        velocity[0], spins[0] = q @ np.array([speed, 0.0]), spin
        shots.append(Shot(names, places, velocity, spins, times))
        others.append((float(f"{ball[0]:.3f}"), float(f"{ball[1]:.3f}")) if pair else None)
    for shot, row, track in zip(shots, plan, observed(two, shots), strict=True):
        balls = {}
        for b, name in enumerate(shot.names):
            seen = np.isfinite(track.position[:, b, 0])
            xy = track.position[seen, b]
            balls[name] = Observation(times[seen], xy, np.full(len(xy), np.nan))
        cues.append(Cue(float(row[0]), float(row[1]), float(row[2]), float(row[3]), 0.0))
        clips.append(Clip("", "cue", balls, cues[-1]))
    fine = [k for k, c in enumerate(clips) if min(len(o.time) for o in c.balls.values()) > FPS / 2]
    clips, cues, others, plan = [clips[k] for k in fine], [cues[k] for k in fine], [others[k] for k in fine], plan[fine]
    known = ClipSet(table, model.ball, FPS, tuple(clips), sigma)
    problem = shot_problem(one.problem.model, one.problem.names, known, sigma)
    mean = problem.prior.mean.copy()
    mean[:, :2] = plan[:, 4:6]
    lever = 2.5 * plan[:, 0] / radius
    sd = problem.prior.sd.copy()
    sd[:, :7] = np.column_stack(
        [np.full((len(plan), 2), 1e-3), COMMAND_SD[0] * plan[:, 0], COMMAND_SD[1] * plan[:, 0],
         np.full(len(plan), 0.02), COMMAND_SD[2] * lever + 0.01, COMMAND_SD[2] * lever + 0.01]
    )  # fmt: skip
    problem = dataclasses.replace(problem, prior=Prior(mean, sd))
    steps = constant_steps(problem.model, problem.names)
    r, jx, jc = differences(problem.evaluate, mean, one.constants, np.arange(len(plan)), problem.steps, steps)
    sound, own = np.nan_to_num(covariance), len(problem.steps)
    apart = np.zeros(len(plan))
    for k in range(len(plan)):
        use = np.isfinite(r[k])
        j = np.concatenate([jx[k, use], jc[k, use]], axis=1)
        p = np.zeros((j.shape[1],) * 2)
        p[:own, :own], p[own:, own:] = np.diag(sd[k] ** 2), sound
        d = np.clip(r[k, use], -FAR, FAR)
        # d' (1 + J P J')^-1 d
        inner = np.linalg.solve(np.eye(len(p)) + p @ (j.T @ j), p @ (j.T @ d))
        apart[k] = np.sqrt(max(float(d @ d - (j.T @ d) @ inner), 0.0))
    best = int(np.argmax(apart))
    rounded = Cue(*(float(f"{v:.4f}") for v in dataclasses.astuple(cues[best])))
    place = (float(f"{plan[best, 4]:.3f}"), float(f"{plan[best, 5]:.3f}"))
    return NextShot(rounded, place, others[best], float(apart[best]), why)
