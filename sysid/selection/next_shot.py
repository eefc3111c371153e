"""The shot that separates two models best, within what the launcher can play.

In: a fit (`Point`) with the covariance of its constants, and another model. Out: a `NextShot`.

Many shots are played in the other model and compared with the fitted one. With d the difference of the tracks in
standard deviations of the camera, J its Jacobian by initial states and constants, and P their covariance (scatter of
the commands, uncertainty of the constants), the separation is the Mahalanobis distance sqrt(d' (1 + J P J')^-1 d):
what the fit could make up for by its unknowns does not count.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.model_file import Model
from models.shot import Shot, Track
from models.simulation.observe import observed
from sysid.clips import Clip, ClipSet, CueCommand, Observation
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array, constant_steps, turn
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.solver.least_squares import Prior, differences
from sysid.estimation.split import Split
from sysid.selection.score import Score
from sysid.selection.screening import Screening

TRIED_SHOTS = 64  # a power of two, as Sobol sequences need
SHOT_DURATION_S = 4.0
CAMERA_FPS = 60.0
BALL_SPEEDS_M_S = (0.6, 2.7)  # of the struck ball (Robotic Billiards 2015: to 2.75)
MAX_TIP_OFFSET_M = 0.012  # of the tip, sideways and up (the same)
MAX_CUT_DIAMETERS = 0.8  # sideways distance at which the other ball is met
MAX_DIFFERENCE_SD = 20.0  # more is not counted: the balls met something else
MAX_SD_OF_RANGE = 0.05  # of the bounds' width: an effect of larger standard deviation is imitated by the active ones
NEXT_SHOT_EFFECT_SD = 3.0  # standard deviations: size of the effect that the next shot is to show
COMMAND_SD = (0.01, 0.005, 0.0003)  # scatter of speed (fraction), azimuth [rad], offsets [m]
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class NextShot:
    """A shot to film, and how well it separates two models."""

    cue: CueCommand
    place: tuple[float, float]  # of the cue ball [m]
    other: tuple[float, float] | None  # of the ball to hit, if any [m]
    sigmas: float  # separation of the two predictions [standard deviations]
    why: str

    def to_dict(self) -> dict[str, Any]:
        """As result.json has it."""
        return {
            "why": self.why, "cue": dataclasses.asdict(self.cue), "ball": list(self.place),
            "other": list(self.other) if self.other else None, "separates_sd": self.sigmas,
        }  # fmt: skip


@dataclass(frozen=True)
class _PlannedShot:
    """A shot to be tried."""

    shot: Shot
    cue: CueCommand
    other: tuple[float, float] | None  # of the ball to hit [m]


def propose_shot(one: Point, two: Model, covariance: Array, sigma: float, why: str, seed: int = 0) -> NextShot:
    """The shot, of a cue ball alone or at another ball, that separates two models best.

    Args:
        one: a converged fit, whose model is to be tested.
        two: the other model; the shots are played in it.
        covariance: of the constants of `one`, (q, q).
        sigma: noise of the camera [m].
        why: what the shot is for, in words.
        seed: of the shots tried.
    """
    planned = _planned_shots(one.model, seed)
    clips = [
        _clip_of(plan, track) for plan, track in zip(planned, observed(two, [p.shot for p in planned]), strict=True)
    ]
    long_enough = [k for k, c in enumerate(clips) if min(len(o.time) for o in c.balls.values()) > CAMERA_FPS / 2]
    planned, clips = [planned[k] for k in long_enough], [clips[k] for k in long_enough]
    separation = _separations(one, planned, clips, covariance, sigma)
    best = int(np.argmax(separation))
    cue = CueCommand(*(float(f"{v:.4f}") for v in dataclasses.astuple(planned[best].cue)))
    x, y = planned[best].shot.position[0]
    return NextShot(cue, (float(f"{x:.3f}"), float(f"{y:.3f}")), planned[best].other, float(separation[best]), why)


def _planned_shots(model: Model, seed: int) -> list[_PlannedShot]:
    """Shots spread evenly over speed, azimuth, tip offset, place and cut; every third at another ball."""
    from scipy.stats import qmc  # slow to load, and needed once

    table, radius = model.table, model.ball.radius
    unit = qmc.Sobol(8, seed=seed).random(TRIED_SHOTS)
    room = np.array([table.length / 2, table.width / 2]) - 4 * radius
    offset = MAX_TIP_OFFSET_M
    low = np.array([BALL_SPEEDS_M_S[0], -np.pi, -offset, -offset, -room[0], -room[1], 0.25, -MAX_CUT_DIAMETERS])
    high = np.array([BALL_SPEEDS_M_S[1], np.pi, offset, offset, room[0], room[1], 0.8, MAX_CUT_DIAMETERS])
    plan = low + unit * (high - low)
    plan[:, 2:4] *= np.minimum(1.0, offset / np.maximum(np.hypot(plan[:, 2], plan[:, 3]), 1e-9))[:, None]
    plan[::2, 2] = 0.0  # half of them without side
    times = np.arange(0, SHOT_DURATION_S, 1 / CAMERA_FPS)
    planned = []
    for number, (speed, azimuth, side, height, x, y, distance, cut) in enumerate(plan.tolist()):
        q, lever = turn(azimuth), 2.5 * speed / radius**2
        ball = np.array([x, y]) + q @ np.array([distance, 2 * radius * cut])
        pair = number % 3 == 0 and bool(np.all(np.abs(ball) < room + 2 * radius))
        names = ("cue", "red") if pair else ("cue",)
        n = len(names)
        places, velocity, spins = np.array([[x, y], ball])[:n], np.zeros((n, 2)), np.zeros((n, 3))
        velocity[0] = q @ np.array([speed, 0.0])
        spins[0] = np.array([*(q @ np.array([0.0, lever * height])), lever * side])
        shot = Shot(names, places, velocity, spins, times)
        other = (float(f"{ball[0]:.3f}"), float(f"{ball[1]:.3f}")) if pair else None
        planned.append(_PlannedShot(shot, CueCommand(speed, azimuth, side, height), other))
    return planned


def _clip_of(plan: _PlannedShot, track: Track) -> Clip:
    """What the camera would see of a shot, without noise."""
    balls = {}
    for b, name in enumerate(plan.shot.names):
        seen = np.isfinite(track.position[:, b, 0])
        xy = track.position[seen, b]
        balls[name] = Observation(plan.shot.times[seen], xy, np.full(len(xy), np.nan))
    return Clip("", "cue", balls, plan.cue)


def _separations(
    one: Point, planned: Sequence[_PlannedShot], clips: Sequence[Clip], covariance: Array, sigma: float
) -> Array:
    """Mahalanobis distance of each shot's track from the prediction of the fit `one`: (n,)."""
    model = one.model
    clip_set = ClipSet(model.table, model.ball, CAMERA_FPS, tuple(clips), sigma)
    problem = shot_problem(one.problem.model, one.problem.names, clip_set, sigma)
    mean = problem.prior.mean.copy()
    mean[:, :2] = [plan.shot.position[0] for plan in planned]
    speed = np.array([plan.cue.speed for plan in planned])
    lever = 2.5 * speed / model.ball.radius
    n = len(planned)
    sd = problem.prior.sd.copy()
    sd[:, :7] = np.column_stack(
        [np.full((n, 2), 1e-3), COMMAND_SD[0] * speed, COMMAND_SD[1] * speed, np.full(n, 0.02),
         COMMAND_SD[2] * lever + 0.01, COMMAND_SD[2] * lever + 0.01]
    )  # fmt: skip
    problem = dataclasses.replace(problem, prior=Prior(mean, sd))
    steps = constant_steps(problem.model, problem.names)
    r, jx, jc = differences(problem.evaluate, mean, one.constants, np.arange(n), problem.steps, steps)
    states = len(problem.steps)
    separation = np.zeros(n)
    for k in range(n):
        use = np.isfinite(r[k])
        j = np.concatenate([jx[k, use], jc[k, use]], axis=1)
        p = np.zeros((j.shape[1],) * 2)
        p[:states, :states], p[states:, states:] = np.diag(sd[k] ** 2), np.nan_to_num(covariance)
        d = np.clip(r[k, use], -MAX_DIFFERENCE_SD, MAX_DIFFERENCE_SD)
        # Woodbury: d' (1 + J P J')^-1 d = d'd - d'J (1 + P J'J)^-1 P J'd
        inner = np.linalg.solve(np.eye(len(p)) + p @ (j.T @ j), p @ (j.T @ d))
        separation[k] = np.sqrt(max(float(d @ d - (j.T @ d) @ inner), 0.0))
    return separation


def propose_next(
    parts: Split, now: FittedModel, rounds: Sequence[Screening], verdict: Sequence[str]
) -> NextShot | None:
    """The shot that separates the verdict from its closest rival or, without one, shows what the clips may hide most.

    Args:
        parts: the clips.
        now: their last fit.
        rounds: all screenings.
        verdict: effects that were named.
    """
    if not rounds:
        return None
    log.info("the next shot")
    named = [r for r in rounds if r.best is not None and r.best.name in verdict]
    if named and (best := named[-1].best) is not None:
        rivals = [one for one in named[-1].fits if one.name != best.name]
        if rivals:
            rival = rivals[0].fitted
            why = f"to separate {best.name} from {rivals[0].name}, the next best"
            return propose_shot(rival, best.fitted.model, rival.covariance, parts.noise, why)
    # An effect that the active ones can imitate wholly is hidden at any size: no shot would show it.
    rows = [row for row in rounds[-1].scores.rows if _is_separate(row)]
    if not rows:
        return None
    row = max(rows, key=_hidden_share)
    one = row.candidate
    value = np.clip(one.off() + NEXT_SHOT_EFFECT_SD * row.sd, *one.bounds().T)
    hidden = ", ".join(f"{k} = {v:.3g}" for k, v in zip(one.keys, value, strict=True))
    why = f"these clips say least about {one.name}: they could hide {hidden}"
    return propose_shot(now, now.model.add(one.at(value)), now.covariance, parts.noise, why)


def _is_separate(row: Score) -> bool:
    """Whether the active effects do not imitate a candidate."""
    low, high = row.candidate.bounds().T
    return bool(np.all((row.sd > 0) & (row.sd < MAX_SD_OF_RANGE * (high - low))))


def _hidden_share(row: Score) -> float:
    """Standard deviation of a candidate's parameters over their usual size, the largest of them."""
    return float(np.max(row.sd / np.maximum(np.abs(row.candidate.usual()), 1e-12)))
