"""Whole shots as a least-squares problem: initial states and constants in, residuals in units of their sd out.

Residuals are between what the camera reports and what the model says that it would; unknowns are true. The initial
state of a shot goes on, after that of the struck ball (sysid/estimation/problem.py), with how far each other ball lies
from the mean of where it was seen at rest (2 each) [m]: a twentieth of a millimetre turns a cut by more than what is to
be found.
"""

from __future__ import annotations

import dataclasses
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
from models.simulation.observe import observed, undone
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.plausibility import POCKET_REACH
from sysid.clips.segments import CLAMP_MARGIN_M, free_from, moving_from
from sysid.estimation.discrepancy import discrepancy_rate, events_and_paths
from sysid.estimation.least_squares import Prior
from sysid.estimation.problem import STATE_STEPS, Array, Index, by_events, shot_of, turn
from sysid.estimation.residual_rows import ShotData, packed, residuals
from sysid.estimation.start_values import shot_start, theta_noise

REST_STEP = 1e-6  # finite difference of a resting ball's place [m]
REST_SD = 2.0  # of the noise: how far it may lie from where it was seen, beside what its samples say
GROWING_RATE = 0.02  # discrepancy rate that is forgiven while the horizon grows
MAX_STAGES = 12  # horizons of a shot that grows from event to event
BEFORE_EVENT_S = 1e-3  # by which a horizon ends before an event
Item = TypeVar("Item")


@dataclass(frozen=True)
class ShotProblem:
    """Whole shots, each up to its horizon."""

    model: Model
    names: tuple[str, ...]  # of the constants
    clip_set: ClipSet
    noise: float  # one standard deviation per axis [m]
    known: Mapping[str, tuple[float, float]]  # of constants, beside the clips: mean and standard deviation
    start: Array  # (n, p)
    azimuth: Array  # (n,)
    prior: Prior
    rest: tuple[Array, ...]  # of each clip: (nball - 1, 2) where the camera sees the others lie [m]
    staying: tuple[tuple[str, ...], ...]  # balls of each clip that end elsewhere than at a pocket
    trusted: tuple[dict[str, NDArray[np.bool_]], ...]  # samples to believe
    events: tuple[Array, ...]  # times of the struck ball's events in each clip [s]
    path: Array  # (n, nball, m) path length of each sample, see sysid/estimation/discrepancy.py [m]
    data: ShotData
    sd: Array  # (n, nball, m) of each sample's place [m]
    sd_theta: Array  # (n,) of a marked ball's angle [rad]
    end: Array  # (n,) of each clip [s]
    horizon: Array  # (n,) up to which each is looked at [s]

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
        )  # fmt: skip

    def until(self, horizon: Array) -> ShotProblem:
        """The same shots, up to other times."""
        return dataclasses.replace(self, horizon=horizon)

    def with_model(self, model: Model, names: Sequence[str]) -> ShotProblem:
        """The same shots, played by another model with these constants to fit."""
        return dataclasses.replace(self, model=model, names=tuple(names))

    def with_discrepancy(self, rate: float) -> ShotProblem:
        """The same shots, with a model error that grows by `rate` along their paths: sd = hypot(noise, rate path)."""
        return dataclasses.replace(self, sd=np.hypot(self.noise, rate * self.path))

    @property
    def stages(self) -> int:
        """How many horizons there are from event to event; the last is the end of every shot."""
        return min(max((len(e) for e in self.events), default=0), MAX_STAGES) + 1

    def horizon_at(self, stage: int) -> Array:
        """Until when each shot is looked at in a stage, up to its next event: (n,) [s]; 0 before the first."""
        if stage < 0:
            return np.zeros_like(self.end)
        whole = stage >= self.stages - 1
        return np.array([
            end if whole or stage >= len(e) else min(float(e[stage]) - BEFORE_EVENT_S, float(end))
            for e, end in zip(self.events, self.end, strict=True)
        ])  # fmt: skip

    def growing(self, stage: int) -> ShotProblem:
        """The problem of a stage, with what is forgiven while the horizon grows."""
        return self.with_discrepancy(GROWING_RATE).until(self.horizon_at(stage))

    @property
    def steps(self) -> Array:
        """Finite differences of the initial state: (p,)."""
        return np.concatenate([STATE_STEPS, np.full(self.start.shape[1] - len(STATE_STEPS), REST_STEP)])

    def balls(self, clip: int) -> tuple[str, ...]:
        """Names, the struck ball first."""
        c = self.clips[clip]
        return (c.struck, *[b for b in c.balls if b != c.struck])

    def shot(self, x: Array, clip: int, times: Array) -> Shot:
        """The shot that an initial state (p,) stands for; the others lie where they are reported, see `undone`."""
        others = self.rest[clip]
        rest = others + x[len(STATE_STEPS) : len(STATE_STEPS) + others.size].reshape(others.shape)
        return shot_of(
            self.balls(clip), x, self.azimuth[clip], self.model.ball.radius, rest, times,
            self.clips[clip].order, not self.clips[clip].running, self.staying[clip],
        )  # fmt: skip

    def struck(self, x: Array, effect: Effect) -> Array:
        """Initial states (n, p) that begin as these do where an effect changes what the cue delivers."""
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

    def by_ball(self, residuals: Array) -> Iterator[tuple[int, str, Array]]:
        """Residuals (n, m), taken apart: number of the clip, ball, residuals of its places (samples, 2)."""
        for k, clip in enumerate(self.clips):
            at = 0
            for name in self.balls(k):
                n = len(clip.balls[name].time)
                yield k, name, residuals[k, at : at + 2 * n].reshape(n, 2)
                at += 3 * n

    def times(self, clip: int) -> Array:
        """Every time at which any ball was seen, up to the horizon."""
        seen = np.unique(np.concatenate([o.time for o in self.clips[clip].balls.values()]))
        return seen[seen <= self.horizon[clip] + 1e-9]

    def tracks(self, x: Array, c: Array, which: Index) -> list[Track]:
        """What the model says that the camera reports of these shots; constants (k, q)."""
        shots = [self.shot(row, w, self.times(w)) for row, w in zip(x, which, strict=True)]
        model = self.model.with_values({n: c[:, k] for k, n in enumerate(self.names)})
        return observed(model, undone(model, shots))

    @cached_property
    def layout(self) -> Layout | None:
        """The model, laid out for the event engine; None where MuJoCo plays it."""
        return Layout(self.model, self.names) if by_events(self.model) else None

    def evaluate(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over their standard deviation: (k, m)."""
        size = max(sum(3 * len(o.time) for o in clip.balls.values()) for clip in self.clips)
        if self.layout is not None:
            return residuals(self.layout, self.data, self.sd, self.sd_theta, self.horizon, x, c, which, size)
        out = np.full((len(x), size), np.nan)
        for k, (track, w) in enumerate(zip(self.tracks(x, c, which), which, strict=True)):
            at = 0
            for b, name in enumerate(track.names):
                seen = self.clips[w].balls[name]
                n = int(np.searchsorted(seen.time, self.horizon[w] + 1e-9, side="right"))
                r, angle = residual(track, b, seen, n)
                r = np.where(self.trusted[w][name][:n, None], r / self.sd[w, b, :n, None], np.nan)
                out[k, at : at + 2 * n] = r.ravel()
                out[k, at + 2 * n : at + 3 * n] = angle / self.sd_theta[w]
                at += 3 * len(seen.time)
        return out

    def discrepancy_rate(self, x: Array, c: Array, share: float = 0.5) -> float:
        """The model's error per path length at initial states (n, p) and constants (q,)."""
        in_metres = dataclasses.replace(self, sd=np.ones_like(self.sd))
        r = in_metres.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
        miss, path, ball, clip = [], [], 0, -1
        for k, _, xy in self.by_ball(r):
            ball, clip = (ball + 1, clip) if k == clip else (0, k)
            miss.append(xy.ravel())
            path.append(np.repeat(self.path[k, ball, : len(xy)], 2))
        return discrepancy_rate(np.concatenate(miss), np.concatenate(path), self.noise, share)


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
    # Where the mark began is unknown: the mean takes it out, as a free offset fitted beside the rest would.
    return path[index] - seen.xy[:n], angle - (angle[marked].mean() if marked.any() else 0.0)


def shot_problem(
    model: Model, names: Sequence[str], clip_set: ClipSet, noise: float,
    known: Mapping[str, tuple[float, float]] | None = None,
) -> ShotProblem:  # fmt: skip
    """Set up whole shots: starting values and their spread from the cue's command, or from the first samples."""
    clips, n, own = clip_set.clips, len(clip_set.clips), len(STATE_STEPS)
    p = own + 2 * (max((len(c.balls) for c in clips), default=1) - 1)
    start, mean, sd, azimuth = np.zeros((n, p)), np.zeros((n, p)), np.full((n, p), REST_SD * noise), np.zeros(n)
    rest, trusted, staying = [], [], []
    edge = np.array([clip_set.table.length / 2, clip_set.table.width / 2]) - clip_set.ball.radius - CLAMP_MARGIN_M
    for k, clip in enumerate(clips):
        start[k, :own], mean[k, :own], sd[k, :own], azimuth[k] = shot_start(clip, clip_set, noise)
        others = [o for b, o in clip.balls.items() if b != clip.struck]
        rest.append(np.array([o.xy[: max(moving_from(o, noise), 1)].mean(axis=0) for o in others]).reshape(-1, 2))
        believe = {b: np.all(np.abs(o.xy) < edge, axis=1) for b, o in clip.balls.items()}
        if not clip.running:
            believe[clip.struck][: free_from(clip.balls[clip.struck], noise)] = False
        trusted.append(believe)
        ends = {b: clip_set.table.to_pocket(o.xy[-1]) for b, o in clip.balls.items()}
        staying.append(tuple(b for b, far in ends.items() if far > POCKET_REACH * clip_set.ball.diameter))
    end = np.array([max(o.time[-1] for o in c.balls.values()) for c in clips])
    names_of = [(c.struck, *[b for b in c.balls if b != c.struck]) for c in clips]
    balls = [[c.balls[b] for b in own] for c, own in zip(clips, names_of, strict=True)]
    data = packed(
        [[o.time for o in own] for own in balls], [[o.xy for o in own] for own in balls],
        [[o.theta for o in own] for own in balls],
        [[t[b] for b in own] for t, own in zip(trusted, names_of, strict=True)], rest,
        [[b in s for b in own] for s, own in zip(staying, names_of, strict=True)], azimuth,
        [c.order for c in clips], [not c.running for c in clips], np.zeros(n).tolist(),
    )  # fmt: skip
    events, paths = events_and_paths(clip_set, noise)
    path = np.ones(data.theta.shape)
    for k, balls_of in enumerate(names_of):
        for i, name in enumerate(balls_of):
            path[k, i, : len(paths[k][name])] = paths[k][name]
    return ShotProblem(
        model, tuple(names), clip_set, noise, dict(known or {}), start, azimuth, Prior(mean, sd), tuple(rest),
        tuple(staying), tuple(trusted), tuple(events), path, data, np.full(path.shape, noise),
        np.full(n, theta_noise(clips)), end, end,
    )  # fmt: skip
