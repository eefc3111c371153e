"""Whole shots as a least-squares problem.

In: a model, a clip set and the noise of the camera. Out: a `ShotProblem`, which evaluates residuals in units of their
sd from initial states and constants.

Residuals are differences between reported positions and the model's prediction of these reports; unknowns are true
quantities. The initial state of a shot is that of the struck ball (sysid/estimation/problem.py), followed by the
displacement of each other ball from the mean of its positions seen at rest (2 each) [m]: a twentieth of a millimetre
turns a cut by more than the effects sought. If clips begin in mid-motion, velocity and R omega of every other moving
ball follow (5 each) [m/s], in the table's frame; its displacement is then from the point to which its first samples
lead back.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from models.effect import Effect
from models.engine.impacts import strike_rows
from models.engine.play import Layout
from models.hooks import hooks_of
from models.model_file import Model
from models.shot import Shot, Track
from models.simulation.observe import observed, see, undone
from models.table.sizes import BALL_DIAMETER, stated_size
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.plausibility import POCKET_REACH
from sysid.clips.segments import CLAMP_MARGIN_M, free_from, moving_from
from sysid.estimation.discrepancy import discrepancy_rate, events_and_paths, likely_rate
from sysid.estimation.problem import CAUCHY_SD, STATE_STEPS, Array, Index, ball_of, by_events, state_bounds, turn
from sysid.estimation.residual_rows import (
    MOTION_SIZE,
    RESIDUALS_PER_SAMPLE,
    MeasuredShot,
    ShotData,
    ShotResiduals,
    Weighting,
    packed,
)
from sysid.estimation.solver.least_squares import Evaluate, Objective, Prior
from sysid.estimation.states.start_values import running_sd, running_start, shot_start, theta_noise

REST_STEP = 1e-6  # finite difference of a resting ball's position [m]
REST_SD = 2.0  # prior sd of its displacement from where it was seen, over both noises together
GROWING_RATE = 0.02  # discrepancy rate that is tolerated while the horizon grows
MAX_EVENTS = 3  # median number of impacts beyond which the shots of a set count as long
MAX_STAGES = 12  # most horizons of a shot that grows from event to event
SHORTLY_S = 1e-4  # over which a velocity is that of two places
BEFORE_EVENT_S = 1e-3  # by which a horizon ends before an event
Item = TypeVar("Item")


@dataclass(frozen=True)
class ShotProblem:
    """Whole shots, each up to its horizon."""

    model: Model
    names: tuple[str, ...]  # of the constants
    clip_set: ClipSet
    noise: float  # one standard deviation per axis [m]
    known: Mapping[str, tuple[float, float]]  # prior of constants: mean and standard deviation
    start: Array  # (n, p)
    azimuth: Array  # (n,)
    prior: Prior
    rest: tuple[Array, ...]  # of each clip: (nball - 1, 2) where the camera sees the others at rest [m]
    staying: tuple[tuple[str, ...], ...]  # balls of each clip that end elsewhere than at a pocket
    trusted: tuple[dict[str, NDArray[np.bool_]], ...]  # samples to use
    events: tuple[Array, ...]  # times of the struck ball's events in each clip [s]
    path: Array  # (n, nball, m) path length of each sample, see sysid/estimation/discrepancy.py [m]
    data: ShotData
    sd: Array  # (n, nball, m) of each sample's position [m]
    sd_theta: Array  # (n,) of a marked ball's angle [rad]
    end: Array  # (n,) of each clip [s]
    horizon: Array  # (n,) after which a shot counts no more [s]
    own_rates: Array  # (n,) each shot's own discrepancy rate
    correlation_time: float = 1.0  # of both noises [samples], see sysid/clips/tracker/noise.py
    slow_noise: float = 0.0  # one standard deviation per axis [m], see sysid/clips/tracker/slow_noise.py

    @property
    def clips(self) -> tuple[Clip, ...]:
        """The clips, one for each shot."""
        return self.clip_set.clips

    def only(self, rows: Index) -> ShotProblem:
        """Some of the shots."""
        few = [int(k) for k in rows]

        def part(values: Sequence[Item]) -> tuple[Item, ...]:
            return tuple(values[k] for k in few)

        return dataclasses.replace(
            self, clip_set=dataclasses.replace(self.clip_set, clips=part(self.clips)), start=self.start[few],
            azimuth=self.azimuth[few], prior=self.prior.only(rows), rest=part(self.rest), staying=part(self.staying),
            trusted=part(self.trusted), events=part(self.events), path=self.path[few], data=self.data.only(rows),
            sd=self.sd[few], sd_theta=self.sd_theta[few], end=self.end[few], horizon=self.horizon[few],
            own_rates=self.own_rates[few],
        )  # fmt: skip

    def until(self, horizon: Array) -> ShotProblem:
        """The shots up to other times."""
        return dataclasses.replace(self, horizon=horizon)

    def with_model(self, model: Model, names: Sequence[str]) -> ShotProblem:
        """The shots played by another model, with these constants to fit."""
        return dataclasses.replace(self, model=model, names=tuple(names))

    def with_discrepancy(self, rate: float) -> ShotProblem:
        """The shots weighted by both noises and an error that grows along their paths.

        That error has the rate `rate`, or a shot's own rate if it is larger.
        """
        rates = np.maximum(rate, self.own_rates)[:, None, None]
        return dataclasses.replace(self, sd=np.hypot(self.noise_of_fits, rates * self.path))

    def with_own_rates(self, rates: Array) -> ShotProblem:
        """The shots with a discrepancy rate for each: (n,)."""
        return dataclasses.replace(self, own_rates=rates)

    @property
    def noise_of_fits(self) -> float:
        """Noise and slow noise of the camera together, one standard deviation per axis [m]."""
        return math.hypot(self.noise, self.slow_noise)

    @property
    def is_long(self) -> bool:
        """Whether shots have so many impacts that errors of the model grow beyond what can be followed."""
        many = bool(self.clips) and float(np.median([len(e) for e in self.events])) > MAX_EVENTS
        return many and by_events(self.model)

    @property
    def stages(self) -> int:
        """Number of horizons from event to event; the last is the end of every shot."""
        return min(max((len(e) for e in self.events), default=0), MAX_STAGES) + 1

    def horizon_at(self, stage: int) -> Array:
        """Horizon of each shot in a stage, its next event: (n,) [s]; 0 before the first."""
        if stage < 0:
            return np.zeros_like(self.end)
        whole = stage >= self.stages - 1
        return np.array([
            end if whole or stage >= len(e) else min(float(e[stage]) - BEFORE_EVENT_S, float(end))
            for e, end in zip(self.events, self.end, strict=True)
        ])  # fmt: skip

    @property
    def steps(self) -> Array:
        """Finite differences of the initial state: (p,)."""
        moving, others = self.motions_from - len(STATE_STEPS), self.start.shape[1] - self.motions_from
        return np.concatenate([
            STATE_STEPS, np.full(moving, REST_STEP), np.tile(STATE_STEPS[2:], others // len(STATE_STEPS[2:])),
        ])  # fmt: skip

    @property
    def motions_from(self) -> int:
        """Index of the first unknown that belongs to another moving ball."""
        return len(STATE_STEPS) + 2 * (self.data.rest.shape[1] - 1)

    def objective(self, cauchy_sd: float = CAUCHY_SD) -> Objective:
        """For a fit of the initial states, with Cauchy's constant in standard deviations."""
        return Objective(
            self.evaluate, self.steps, self.prior, cauchy_sd, self.correlation_time, self.bounds, self._part
        )  # fmt: skip

    def _part(self, rows: Index) -> Evaluate:
        """`evaluate` of some of the shots, with only the data that it needs."""
        played = self._played
        return self.only(rows).evaluate if played is None else played.only(rows)

    @property
    def bounds(self) -> Array:
        """Bounds of positions, velocities and spins: (p, 2)."""
        first, others = state_bounds(self.model.table, self.model.ball), self.start.shape[1] - self.motions_from
        at_rest = np.full(self.motions_from - len(first), self.model.ball.diameter / 2)
        high = np.concatenate([first, at_rest, np.tile(first[2:], others // len(first[2:]))])
        return np.column_stack([-high, high])

    def balls(self, clip: int) -> tuple[str, ...]:
        """Names of the balls; the struck ball, or those that move at the start, come first."""
        return self.clips[clip].order_of_balls

    def shot(self, x: Array, clip: int, times: Array, radius: float) -> Shot:
        """The shot that an initial state (p,) stands for with balls of a radius [m].

        The others are where they are reported, see `undone`, and rest unless they move at the start.
        """
        others = self.rest[clip]
        rest = others + x[len(STATE_STEPS) : len(STATE_STEPS) + others.size].reshape(others.shape)
        position, velocity, spin = ball_of(x, self.azimuth[clip], radius)
        motion = np.zeros((len(rest), MOTION_SIZE))
        count = max(len(self.clips[clip].running) - 1, 0)
        motion[:count] = x[self.motions_from :][: MOTION_SIZE * count].reshape(count, MOTION_SIZE)
        return Shot(
            self.balls(clip), np.vstack([position, rest]), np.vstack([velocity, motion[:, :2]]),
            np.vstack([spin, motion[:, 2:] / radius]), times, session=self.clips[clip].session,
            struck=not self.clips[clip].running, staying=self.staying[clip],
        )  # fmt: skip

    def struck(self, x: Array, effect: Effect) -> Array:
        """Initial states (n, p) that compensate for effects which change what the cue delivers."""
        ball, q = self.model.ball, np.stack([turn(a) for a in self.azimuth])
        velocity, level = (np.einsum("nij,nj->ni", q, x[:, part]) for part in (slice(2, 4), slice(4, 6)))
        v, w = velocity[:, None].copy(), np.column_stack([level, x[:, 6]])[:, None] / ball.radius
        hooks = hooks_of([effect], len(x))
        struck = np.array([not clip.running for clip in self.clips])
        strike_rows(hooks.own, hooks.strike, ball.radius, ball.mass, struck, v, w)
        out = x.copy()
        out[:, 2:4] = np.einsum("nji,nj->ni", q, v[:, 0])
        out[:, 4:6] = np.einsum("nji,nj->ni", q, w[:, 0, :2] * ball.radius)
        out[:, 6] = w[:, 0, 2] * ball.radius
        return np.where(struck[:, None], out, x)

    def seen_alike(self, x: Array, effect: Effect) -> Array:
        """Initial states (n, p) that a camera with an effect reports where it reports these without, to first order.

        Of the struck ball; `undone` does so for balls at rest.
        """
        hooks, out = hooks_of([effect], len(x)), x.copy()
        times = np.array([0.0, SHORTLY_S])
        for k, (row, azimuth, clip) in enumerate(zip(x, self.azimuth, self.clips, strict=True)):
            position, velocity, _ = ball_of(row, azimuth, self.model.ball.radius)
            true = position + times[:, None, None] * velocity
            reported, moving = true.copy(), np.tile(velocity, (2, 1, 1))
            see(reported, moving, times, clip.session.row, hooks.own[k].ctypes.data, hooks.observe)
            start, later = (true - reported)[:, 0]
            out[k, :2] += start
            out[k, 2:4] += turn(azimuth).T @ (later - start) / times[1]
        return out

    def by_ball(self, residuals: Array) -> Iterator[tuple[int, str, Array]]:
        """Residuals (n, m) split by ball: index of the clip, ball, residuals of its positions (samples, 2)."""
        for k, clip in enumerate(self.clips):
            at = 0
            for name in self.balls(k):
                n = len(clip.balls[name].time)
                yield k, name, residuals[k, at : at + 2 * n].reshape(n, 2)
                at += RESIDUALS_PER_SAMPLE * n

    def times(self, clip: int) -> Array:
        """All times at which any ball was seen, up to the horizon."""
        seen = np.unique(np.concatenate([o.time for o in self.clips[clip].balls.values()]))
        return seen[seen <= self.horizon[clip] + 1e-9]

    def tracks(self, x: Array, c: Array, which: Index) -> list[Track]:
        """Predicted camera reports of these shots; constants (k, q)."""
        model = self.model.with_values({n: c[:, k] for k, n in enumerate(self.names)})
        stated = stated_size(BALL_DIAMETER, model.table, model.ball)
        radius = np.broadcast_to(np.asarray(model.sizes.get(BALL_DIAMETER, stated), float) / 2, (len(x),))
        shots = [self.shot(row, w, self.times(w), float(r)) for row, w, r in zip(x, which, radius, strict=True)]
        return observed(model, undone(model, shots))

    @cached_property
    def layout(self) -> Layout | None:
        """The model, laid out for the event engine; None where MuJoCo plays it."""
        return Layout(self.model, self.names) if by_events(self.model) else None

    @property
    def _played(self) -> ShotResiduals | None:
        """`evaluate` by the event engine; None if MuJoCo plays the model."""
        if self.layout is None:
            return None
        return ShotResiduals(self.layout, self.data, Weighting(self.sd, self.sd_theta, self.horizon))

    def evaluate(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over their standard deviation: (k, m)."""
        if (played := self._played) is not None:
            return played(x, c, which)
        out = np.full((len(x), self.data.size), np.nan)
        for k, (track, w) in enumerate(zip(self.tracks(x, c, which), which, strict=True)):
            at = 0
            for b, name in enumerate(track.names):
                seen = self.clips[w].balls[name]
                n = int(np.searchsorted(seen.time, self.horizon[w] + 1e-9, side="right"))
                r, angle = residual(track, b, seen, n)
                r = np.where(self.trusted[w][name][:n, None], r / self.sd[w, b, :n, None], np.nan)
                out[k, at : at + 2 * n] = r.ravel()
                out[k, at + 2 * n : at + 3 * n] = angle / self.sd_theta[w]
                at += RESIDUALS_PER_SAMPLE * len(seen.time)
        return out

    def discrepancy_rates(self, x: Array, c: Array) -> Array:
        """The most likely error per path length of each single shot: (n,)."""
        return np.array([likely_rate(e, path, self.noise_of_fits) for e, path in self._errors(x, c)])

    def discrepancy_rate(self, x: Array, c: Array, share: float = 0.5) -> float:
        """The model's error per path length at initial states (n, p) and constants (q,)."""
        errors, paths = (np.concatenate(part) for part in zip(*self._errors(x, c), strict=True))
        return discrepancy_rate(errors, paths, self.noise_of_fits, share)

    def _errors(self, x: Array, c: Array) -> list[tuple[Array, Array]]:
        """Residuals per axis of each shot [m], NaN if unused, and their path lengths [m]: (m,), (m,)."""
        unweighted = dataclasses.replace(self, sd=np.ones_like(self.sd))
        r = unweighted.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
        found: list[list[tuple[Array, Array]]] = [[] for _ in x]
        for k, _, xy in self.by_ball(r):
            found[k].append((xy.ravel(), np.repeat(self.path[k, len(found[k]), : len(xy)], 2)))
        return [(np.concatenate([e for e, _ in of]), np.concatenate([path for _, path in of])) for of in found]


def residual(track: Track, ball: int, seen: Observation, n: int) -> tuple[Array, Array]:
    """Model minus measurement of the first n samples: (n, 2) [m], (n,) [rad]; a potted ball stays at its pocket."""
    index = np.searchsorted(track.times, seen.time[:n])
    path = track.position[:, ball]
    gone = np.isnan(path[:, 0])
    if gone.any():
        path = path.copy()
        last = int(np.argmax(gone)) - 1
        path[gone] = path[max(last, 0)]
    angle = track.theta[index, ball] - seen.theta[:n]
    marked = np.isfinite(angle)
    # The angle at which the mark begins is unknown: the mean removes it, as a fitted offset would.
    return path[index] - seen.xy[:n], angle - (angle[marked].mean() if marked.any() else 0.0)


def shot_problem(
    model: Model, names: Sequence[str], clip_set: ClipSet, noise: float,
    known: Mapping[str, tuple[float, float]] | None = None, correlation_time: float = 1.0, slow_noise: float = 0.0,
) -> ShotProblem:  # fmt: skip
    """Set up whole shots: start values and priors from the cue's command, or from the first samples."""
    clips, n = clip_set.clips, len(clip_set.clips)
    events, paths = events_and_paths(clip_set, noise)
    start, mean, sd, azimuth = _starts(clip_set, noise, events, REST_SD * math.hypot(noise, slow_noise))
    shots = [_measured(clip, clip_set, noise, a) for clip, a in zip(clips, azimuth, strict=True)]
    names_of = [clip.order_of_balls for clip in clips]
    data = packed(shots)
    path = np.ones(data.theta.shape)
    for k, balls in enumerate(names_of):
        for i, name in enumerate(balls):
            path[k, i, : len(paths[k][name])] = paths[k][name]
    end = np.array([max(o.time[-1] for o in c.balls.values()) for c in clips])
    staying, trusted = [], []
    for balls, shot in zip(names_of, shots, strict=True):
        staying.append(tuple(b for b, stays in zip(balls, shot.stays, strict=True) if stays))
        trusted.append(dict(zip(balls, shot.trusted, strict=True)))
    return ShotProblem(
        model, tuple(names), clip_set, noise, dict(known or {}), start, azimuth, Prior(mean, sd),
        tuple(shot.rest for shot in shots), tuple(staying), tuple(trusted), tuple(events), path, data,
        np.full(path.shape, noise), np.full(n, theta_noise(clips)), end, end, np.zeros(n), correlation_time, slow_noise,
    )  # fmt: skip


def _starts(
    clip_set: ClipSet, noise: float, events: Sequence[Array], rest_sd: float
) -> tuple[Array, Array, Array, Array]:
    """Start, prior mean and sd of initial states (n, p), azimuths (n,); `rest_sd` [m] is that of balls at rest."""
    clips, n, first = clip_set.clips, len(clip_set.clips), len(STATE_STEPS)
    resting = first + 2 * (max((len(c.balls) for c in clips), default=1) - 1)
    p = resting + MOTION_SIZE * max((len(c.running) - 1 for c in clips if c.running), default=0)
    start, mean, sd, azimuth = np.zeros((n, p)), np.zeros((n, p)), np.full((n, p), rest_sd), np.zeros(n)
    sd[:, resting:] = 1.0  # of resting balls, for which nothing depends on it
    for k, clip in enumerate(clips):
        until = float(events[k][0]) if events[k].size else math.inf
        start[k, :first], mean[k, :first], sd[k, :first], azimuth[k] = shot_start(clip, clip_set, noise, until)
        for other, name in enumerate(clip.running[1:]):
            motion = slice(resting + MOTION_SIZE * other, resting + MOTION_SIZE * (other + 1))
            _, start[k, motion] = running_start(clip.balls[name])
            mean[k, motion] = start[k, motion]
            sd[k, first + 2 * other : first + 2 * other + 2] = np.inf
            sd[k, motion] = running_sd(float(np.hypot(*start[k, motion][:2])))[2:]
    return start, mean, sd, azimuth


def _measured(clip: Clip, clip_set: ClipSet, noise: float, azimuth: float) -> MeasuredShot:
    """The measurements of a shot, first the balls that move first; samples close to a nose are not trusted."""
    names = clip.order_of_balls
    seen = [clip.balls[name] for name in names]
    edge = np.array([clip_set.table.length / 2, clip_set.table.width / 2]) - clip_set.ball.radius - CLAMP_MARGIN_M
    trusted = [np.all(np.abs(o.xy) < edge, axis=1) for o in seen]
    if not clip.running:
        trusted[0][: free_from(seen[0], noise)] = False
    rest = np.array([
        running_start(o)[0] if name in clip.running else o.xy[: max(moving_from(o, noise), 1)].mean(axis=0)
        for name, o in zip(names[1:], seen[1:], strict=True)
    ]).reshape(-1, 2)  # fmt: skip
    stays = [bool(clip_set.table.to_pocket(o.xy[-1]) > POCKET_REACH * clip_set.ball.diameter) for o in seen]
    return MeasuredShot(
        [o.time for o in seen], [o.xy for o in seen], [o.theta for o in seen], trusted, rest, stays, azimuth,
        clip.session, not clip.running, moving=len(clip.first),
    )  # fmt: skip
