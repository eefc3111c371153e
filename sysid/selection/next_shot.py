"""The shots to film next: a sequence that separates all remaining models, within the launcher's range.

In: the last fit, the fits of rival causes, or effects that the clips may hide. Out: `NextShot`s, in the order to film.

Many shots are tried. If there is a verdict, they are played in its model and compared with every rival's fit; otherwise
they are played in the fit and with every effect as large as these clips can hide it. With d the difference of the
tracks in standard deviations of the camera, J its Jacobian by initial states and constants, and P their covariance
(scatter of the commands, uncertainty of the constants), two models are D = d' (1 + J P J')^-1 d apart, which excludes
differences that a fit could compensate by its unknowns. D adds up over shots, and the probability of confusion is at
most exp(-D / 8) / 2 (A. Bhattacharyya 1943, for normal distributions of equal covariance). So the next shot is the one
that minimises the sum of these over all rivals, until that is below the error rate.
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
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.solver.least_squares import Prior, differences
from sysid.estimation.split import Split
from sysid.selection.judgement import ERROR_RATE
from sysid.selection.scoring.score import Score
from sysid.selection.scoring.signatures import with_candidate
from sysid.selection.screening import Screening

TRIED_SHOTS = 64  # a power of two, as Sobol sequences need
SHOT_DURATION_S = 4.0
CAMERA_FPS = 60.0
BALL_SPEEDS_M_S = (0.6, 2.7)  # range of the struck ball's speed (Robotic Billiards 2015: to 2.75)
MAX_TIP_OFFSET_M = 0.012  # largest offset of the tip, sideways and up (likewise)
MAX_CUT_DIAMETERS = 0.8  # largest offset of the aim from the other ball's centre
MAX_DIFFERENCE_SD = 20.0  # larger differences are clipped: the balls met something else
MAX_SD_OF_RANGE = 0.05  # an effect with a larger sd, over its bounds' width, is imitated by active ones
HIDDEN_EFFECT_SD = 3.0  # size of an effect that clips may hide, in standard deviations
MAX_NEXT_SHOTS = 8  # most shots that are proposed
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
    doubt: float  # bound on the probability of confusion between the models after this shot and those before

    def shot(self, radius: float) -> Shot:
        """As it is commanded, of balls of a radius [m], for SHOT_DURATION_S."""
        return _commanded(self.cue, np.array(self.place), None if self.other is None else np.array(self.other), radius)

    def in_words(self) -> str:
        """What to lay and to strike; places from the table's middle, x along it, azimuths from +x towards +y."""
        c, (x, y) = self.cue, self.place
        red = f", a red at x = {self.other[0]:.3f}, y = {self.other[1]:.3f} m" if self.other else ""
        tip = [
            f"{1e3 * abs(value):.0f} mm {words[value > 0]}"
            for value, words in ((c.side, ("left of", "right of")), (c.height, ("below", "above")))
            if round(1e3 * abs(value)) > 0
        ]
        offset = f"{' and '.join(tip)} the middle" if tip else "in the middle"
        return (
            f"the cue ball at x = {x:.3f}, y = {y:.3f} m{red}; strike the cue ball {offset}, "
            f"to {c.speed:.2f} m/s, azimuth {c.azimuth:.3f} rad ({np.degrees(c.azimuth):.1f} degrees)"
        )

    def to_dict(self) -> dict[str, Any]:
        """The shot as an entry of result.json."""
        return {
            "why": self.why, "cue": dataclasses.asdict(self.cue), "ball": list(self.place),
            "other": list(self.other) if self.other else None, "separates_sd": self.sigmas, "doubt": self.doubt,
        }  # fmt: skip


@dataclass(frozen=True)
class _PlannedShot:
    """A candidate for the next shot."""

    shot: Shot
    cue: CueCommand
    other: tuple[float, float] | None  # of the ball to hit [m]


@dataclass(frozen=True)
class Rival:
    """A fit from which another model is to be separated."""

    name: str
    fit: Point
    covariance: Array  # of its constants (q, q)


def propose_shots(
    truth: Model, rivals: Sequence[Rival], sigma: float, why: str, error_rate: float = ERROR_RATE, seed: int = 0
) -> tuple[NextShot, ...]:
    """The shots, of a cue ball alone or at another ball, that separate a model from its rivals, the best first.

    Args:
        truth: the model in which the shots are played.
        rivals: fits to separate it from.
        sigma: noise of the camera [m].
        why: the purpose of the shots, a text that a rival's name follows.
        error_rate: probability of confusion at which the sequence ends.
        seed: for the candidate shots.
    """
    planned, clips = _played(truth, seed)
    apart = []
    for rival in rivals:
        seen = _look_ahead(rival.fit, planned, clips, rival.covariance, sigma)
        apart.append(seen.apart(seen.residuals))
    return sequence(planned, np.array(apart), [f"{why} {rival.name}" for rival in rivals], error_rate, whole=True)


def propose_to_show(
    now: FittedModel, rows: Sequence[Score], sigma: float, error_rate: float = ERROR_RATE, seed: int = 0
) -> tuple[NextShot, ...]:
    """The shots that reveal effects that the clips may hide, at the largest hidden size.

    Args:
        now: the fit.
        rows: scores of effects that it lacks.
        sigma: noise of the camera [m].
        error_rate: probability of confusion at which the sequence ends.
        seed: for the candidate shots.
    """
    planned, clips = _played(now.model, seed)
    seen = _look_ahead(now, planned, clips, now.covariance, sigma)
    apart, whys, which = [], list[str](), np.arange(len(planned))
    for row in rows:
        one = row.candidate
        value = np.clip(one.off() + HIDDEN_EFFECT_SD * row.sd, *one.bounds().T)
        constants = np.tile([*now.constants, *value], (len(planned), 1))
        with_it = with_candidate(seen.problem, one).evaluate(seen.states, constants, which)
        apart.append(seen.apart(with_it - seen.residuals))
        hidden = ", ".join(value_in_words(k, v, off) for k, v, off in zip(one.keys, value, one.off(), strict=True))
        whys.append(f"these clips hardly determine {one.name}: they could hide {hidden}")
    return sequence(planned, np.array(apart), whys, error_rate, whole=False)


def sequence(
    planned: Sequence[_PlannedShot], apart: Array, whys: Sequence[str], error_rate: float, *, whole: bool
) -> tuple[NextShot, ...]:
    """Shots, each the one that leaves least doubt; `apart` (k, n) is the separation of k rivals by each shot.

    They end with the last that settles a rival, if any does, and if not the `whole` sequence is for all of them.
    """
    so_far, found, left, settled = np.zeros(len(apart)), list[NextShot](), list(range(len(planned))), list[int]()
    while left and len(found) < MAX_NEXT_SHOTS:
        doubts = 0.5 * np.exp(-(so_far[:, None] + apart[:, left]) / 8.0)
        best = left[int(np.argmin(doubts.sum(axis=0)))]
        rival = int(np.argmax(np.exp(-so_far / 8.0) - np.exp(-(so_far + apart[:, best]) / 8.0)))
        so_far = so_far + apart[:, best]
        left.remove(best)
        doubt = min(float(0.5 * np.exp(-so_far / 8.0).sum()), 1.0)
        found.append(_told(planned[best], float(np.sqrt(apart[rival, best])), whys[rival], doubt))
        settled.append(int(np.sum(0.5 * np.exp(-so_far / 8.0) < error_rate)))
        if doubt < error_rate:
            break
    return tuple(found if whole or not settled[-1] else found[: 1 + settled.index(settled[-1])])


def value_in_words(key: str, value: float, off: float) -> str:
    """A value that is hardly other than where an effect does nothing."""
    return f"{key} = {off:g} {value - off:+.2g}" if off else f"{key} = {value:.3g}"


def _told(plan: _PlannedShot, sigmas: float, why: str, doubt: float) -> NextShot:
    """A shot, rounded for output."""
    cue = CueCommand(*(float(f"{v:.4f}") for v in dataclasses.astuple(plan.cue)))
    x, y = plan.shot.position[0]
    return NextShot(cue, (float(f"{x:.3f}"), float(f"{y:.3f}")), plan.other, sigmas, why, doubt)


def _played(truth: Model, seed: int) -> tuple[list[_PlannedShot], list[Clip]]:
    """Candidate shots that the camera sees long enough, and their simulated clips."""
    planned = shots_to_try(truth, seed)
    tracks = observed(truth, [plan.shot for plan in planned])
    clips = [_clip_of(plan, track) for plan, track in zip(planned, tracks, strict=True)]
    long_enough = [k for k, c in enumerate(clips) if min(len(o.time) for o in c.balls.values()) > CAMERA_FPS / 2]
    return [planned[k] for k in long_enough], [clips[k] for k in long_enough]


def shots_to_try(model: Model, seed: int) -> list[_PlannedShot]:
    """Shots spread evenly over speed, azimuth, tip offset, place and cut; every third at another ball."""
    from scipy.stats import qmc  # slow to import and rarely needed

    table, radius = model.table, model.ball.radius
    unit = qmc.Sobol(8, seed=seed).random(TRIED_SHOTS)
    room = np.array([table.length / 2, table.width / 2]) - 4 * radius
    offset = MAX_TIP_OFFSET_M
    low = np.array([BALL_SPEEDS_M_S[0], -np.pi, -offset, -offset, -room[0], -room[1], 0.25, -MAX_CUT_DIAMETERS])
    high = np.array([BALL_SPEEDS_M_S[1], np.pi, offset, offset, room[0], room[1], 0.8, MAX_CUT_DIAMETERS])
    plan = low + unit * (high - low)
    plan[:, 2:4] *= np.minimum(1.0, offset / np.maximum(np.hypot(plan[:, 2], plan[:, 3]), 1e-9))[:, None]
    plan[::2, 2] = 0.0  # half of them without side
    planned = []
    for number, (speed, azimuth, side, height, x, y, distance, cut) in enumerate(plan.tolist()):
        ball = np.array([x, y]) + turn(azimuth) @ np.array([distance, 2 * radius * cut])
        pair = number % 3 == 0 and bool(np.all(np.abs(ball) < room + 2 * radius))
        cue = CueCommand(speed, azimuth, side, height)
        shot = _commanded(cue, np.array([x, y]), ball if pair else None, radius)
        other = (float(f"{ball[0]:.3f}"), float(f"{ball[1]:.3f}")) if pair else None
        planned.append(_PlannedShot(shot, cue, other))
    return planned


def _commanded(cue: CueCommand, place: Array, other: Array | None, radius: float) -> Shot:
    """A stroke at a ball at a place (2,) as it is commanded, and another ball to be hit (2,), if any."""
    q, lever = turn(cue.azimuth), 2.5 * cue.speed / radius**2
    names = ("cue",) if other is None else ("cue", "red")
    n = len(names)
    places, velocity, spins = (
        np.array([place, place if other is None else other])[:n],
        np.zeros((n, 2)),
        np.zeros((n, 3)),
    )
    velocity[0] = q @ np.array([cue.speed, 0.0])
    spins[0] = np.array([*(q @ np.array([0.0, lever * cue.height])), lever * cue.side])
    return Shot(names, places, velocity, spins, np.arange(0, SHOT_DURATION_S, 1 / CAMERA_FPS))


def _clip_of(plan: _PlannedShot, track: Track) -> Clip:
    """The clip that the camera would record of a shot, without noise."""
    balls = {}
    for b, name in enumerate(plan.shot.names):
        seen = np.isfinite(track.position[:, b, 0])
        xy = track.position[seen, b]
        balls[name] = Observation(plan.shot.times[seen], xy, np.full(len(xy), np.nan))
    return Clip("", "cue", balls, plan.cue)


@dataclass(frozen=True)
class _Ahead:
    """A fit's prediction for shots that were not played yet, with its uncertainty."""

    problem: ShotProblem
    states: Array  # (n, p) as commanded
    residuals: Array  # (n, m) of the shots, over the standard deviation of the noise
    jacobian: Array  # (n, m, p + q) by states and constants
    covariance: Array  # (n, p + q, p + q) of these

    def apart(self, differences: Array) -> Array:
        """Squared Mahalanobis distance of differences (n, m), beyond what the fit's unknowns can explain: (n,)."""
        found = np.zeros(len(differences))
        for k, (row, of_row, p) in enumerate(zip(differences, self.jacobian, self.covariance, strict=True)):
            use = np.isfinite(row)
            j, d = np.nan_to_num(of_row[use]), np.clip(row[use], -MAX_DIFFERENCE_SD, MAX_DIFFERENCE_SD)
            # Woodbury: d' (1 + J P J')^-1 d = d'd - d'J (1 + P J'J)^-1 P J'd
            inner = np.linalg.solve(np.eye(len(p)) + p @ (j.T @ j), p @ (j.T @ d))
            found[k] = max(float(d @ d - (j.T @ d) @ inner), 0.0)
        return found


def _look_ahead(
    one: Point, planned: Sequence[_PlannedShot], clips: Sequence[Clip], covariance: Array, sigma: float
) -> _Ahead:
    """A fit's prediction for shots of which these clips would be filmed."""
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
    states, q = len(problem.steps), len(steps)
    p = np.zeros((n, states + q, states + q))
    p[:, np.arange(states), np.arange(states)], p[:, states:, states:] = sd**2, np.nan_to_num(covariance)
    return _Ahead(problem, mean, r, np.concatenate([jx, jc], axis=2), p)


def propose_next(
    parts: Split, now: FittedModel, rounds: Sequence[Screening], verdict: Sequence[str], error_rate: float = ERROR_RATE
) -> tuple[NextShot, ...]:
    """The shots that separate the verdict from its rivals, or, without a verdict, reveal what the clips may hide.

    Args:
        parts: the clips.
        now: their last fit.
        rounds: all screenings.
        verdict: named effects.
        error_rate: probability of confusion at which the sequence ends.
    """
    if not rounds:
        return ()
    log.info("the next shots")
    named = [r for r in rounds if r.best is not None and r.best.name in verdict]
    if named and (best := named[-1].best) is not None:
        rivals = [Rival(one.name, one.fitted, one.fitted.covariance) for one in named[-1].fits if one.name != best.name]
        if rivals:
            return propose_shots(best.fitted.model, rivals, parts.noise, f"to separate {best.name} from", error_rate)
    # An effect that the active ones imitate completely is hidden at any size: no shot would show it.
    rows = [row for row in rounds[-1].scores.rows if _is_separate(row)]
    return propose_to_show(now, rows, parts.noise, error_rate) if rows else ()


def _is_separate(row: Score) -> bool:
    """Whether a candidate is not imitated by the active effects."""
    low, high = row.candidate.bounds().T
    return bool(np.all((row.sd > 0) & (row.sd < MAX_SD_OF_RANGE * (high - low))))
