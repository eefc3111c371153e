"""Clips as least-squares problems: own unknowns and constants in, residuals in units of noise out.

Residuals are between what the camera reports and what the model says that it would; unknowns are true.
The own unknowns of a shot, or of a segment, are the moving ball's position (2) [m], velocity (2) [m/s] and surface
speed of its spin, R omega (3) [m/s], all in a frame turned into the direction of motion: along, across, up. A rolling
ball has R omega across equal to its speed. Those of a shot go on with how far each other ball lies from the mean of
where it was seen at rest (2 each) [m]: a twentieth of a millimetre turns a cut by more than what is to be found.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from models.effect import Effect
from models.engine.play import Layout, lacking
from models.hooks import hooks_of
from models.impacts import strike_rows
from models.model_file import Model
from models.observe import observed, undone
from models.shot import Shot, Table, Track
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips_check import POCKET_REACH
from sysid.residual_rows import ShotData, packed, residuals
from sysid.segments import CLAMPED, Segment, free_from, moving_from
from sysid.solve import Prior

Array = NDArray[np.float64]
Index = NDArray[np.int64]

UNKNOWNS = ("x", "y", "v_along", "v_across", "Rw_along", "Rw_across", "Rw_up")
STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5, 1e-4, 1e-4, 1e-4])  # finite differences, [m] and [m/s]
REST_STEP = 1e-6  # the same of a resting ball's place [m]
REST_SD = 2.0  # of the noise: how far it may lie from where it was seen, beside what its samples say
CUE_SD = {"speed": 0.05, "azimuth": 0.02, "offset": 0.002}  # how far a shot may be from its command
LIMIT_SPIN = 1.25  # R omega over v at the miscue limit: 5/2 of half a radius
TOLD = 8  # angles of a mark from which on they alone tell the sidespin


def by_events(model: Model) -> bool:
    """Whether the event engine plays a model; MuJoCo otherwise."""
    return model.engine == "events" and not lacking(model)


def is_varied(model: Model) -> bool:
    """Whether effects push balls along their way: then the steps of a play are chosen by their error."""
    return any(e.opens("forces") for e in model.stack())


def constant_steps(model: Model, names: Sequence[str]) -> Array:
    """Finite-difference steps of constants: 1e-5 of their bounds' width, (q,); a hundred times that where forces vary.

    There the steps of a play are chosen along the way, and a choice that changes is a tiny jump.
    """
    part = 1e-3 if is_varied(model) else 1e-5
    return np.array([part * np.subtract(*model.meta(n)["bounds"][::-1]) for n in names])


def constant_bounds(model: Model, names: Sequence[str]) -> Array:
    """(q, 2) bounds of constants."""
    return np.array([model.meta(n)["bounds"] for n in names])


def turn(azimuth: float) -> Array:
    """Rotation that takes (along, across) to table axes: (2, 2)."""
    c, s = np.cos(azimuth), np.sin(azimuth)
    return np.array([[c, -s], [s, c]])


@dataclass(frozen=True)
class SegmentProblem:
    """Segments between events, on open cloth without cushions."""

    model: Model
    names: tuple[str, ...]  # constants
    segments: tuple[Segment, ...]
    sigma: float
    start: Array  # (n, 7)
    azimuth: Array  # (n,)
    prior: Prior
    data: ShotData

    def only(self, rows: Index) -> SegmentProblem:
        """Some of the segments."""
        return dataclasses.replace(
            self, segments=tuple(self.segments[k] for k in rows), start=self.start[rows], azimuth=self.azimuth[rows],
            prior=Prior(self.prior.mean[rows], self.prior.sd[rows]), data=self.data.only(rows),
        )  # fmt: skip

    @cached_property
    def layout(self) -> Layout | None:
        """The model, laid out for the event engine; None where MuJoCo plays it."""
        return Layout(self.model, self.names) if by_events(self.model) else None

    def evaluate(self, x: Array, c: Array, which: Index) -> Array:
        """Residuals over sigma: (k, 2 m)."""
        radius = self.model.ball.radius
        if self.layout is not None:
            n, size = len(self.segments), 2 * max(len(s.time) for s in self.segments)
            sd = np.full(self.data.theta.shape, self.sigma)
            none = np.full(n, np.inf)
            return residuals(self.layout, self.data, sd, np.ones(n), none, x, c, which, size)
        shots = []
        for row, w in zip(x, which, strict=True):
            time = self.segments[w].time
            shots.append(
                _shot(
                    ("ball",), row, self.azimuth[w], radius, np.zeros((0, 2)), time - time[0], self.segments[w].order,
                    self.segments[w].before == "strike",
                )
            )  # fmt: skip
        values = {n: c[:, k] for k, n in enumerate(self.names)}
        out = np.full((len(x), 2 * max(len(s.time) for s in self.segments)), np.nan)
        begun = [float(self.segments[w].time[0]) for w in which]
        tracks = observed(self.model.with_values(values), shots, begun)
        for k, (track, w) in enumerate(zip(tracks, which, strict=True)):
            r = (track.position[:, 0] - self.segments[w].xy) / self.sigma
            out[k, : r.size] = r.ravel()
        return out


def open_table(table: Table) -> Table:
    """A table so large that nothing reaches its cushions."""
    return dataclasses.replace(table, length=1e3, width=1e3, pockets=False)


def segment_problem(model: Model, names: Sequence[str], segments: Sequence[Segment], sigma: float) -> SegmentProblem:
    """Set up segments with starting values: straight through the first samples, rolling."""
    open_cloth = dataclasses.replace(model, table=open_table(model.table))
    start, azimuth = np.zeros((len(segments), 7)), np.zeros(len(segments))
    for k, s in enumerate(segments):
        n = min(6, len(s.time))
        start[k], azimuth[k] = _straight(s.time[:n] - s.time[0], s.xy[:n], 1.0)
    sd = np.array([_running_sd(v) for v in start[:, 2]])
    n = len(segments)
    data = packed(
        [[s.time - s.time[0]] for s in segments], [[s.xy] for s in segments],
        [[np.full(len(s.time), np.nan)] for s in segments], [[np.ones(len(s.time), bool)] for s in segments],
        [np.zeros((0, 2))] * n, [[False]] * n, azimuth, [s.order for s in segments],
        [s.before == "strike" for s in segments], [float(s.time[0]) for s in segments],
    )  # fmt: skip
    return SegmentProblem(open_cloth, tuple(names), tuple(segments), sigma, start, azimuth, Prior(start, sd), data)


@dataclass(frozen=True)
class ShotProblem:
    """Whole shots, each up to its horizon."""

    model: Model
    names: tuple[str, ...]
    clips: tuple[Clip, ...]
    start: Array  # (n, p)
    azimuth: Array  # (n,)
    prior: Prior
    rest: tuple[Array, ...]  # of each clip: (nball - 1, 2) where the camera sees the others lie [m]
    staying: tuple[tuple[str, ...], ...]  # balls of each clip that end elsewhere than at a pocket
    trusted: tuple[dict[str, NDArray[np.bool_]], ...]  # samples to believe
    data: ShotData
    sd: Array  # (n, nball, m) of each sample's place [m]
    sd_theta: Array  # (n,) of a marked ball's angle [rad]
    horizon: Array  # (n,) [s]

    def only(self, rows: Index) -> ShotProblem:
        """Some of the shots."""
        few = [int(k) for k in rows]
        return dataclasses.replace(
            self, clips=tuple(self.clips[k] for k in few), start=self.start[few], azimuth=self.azimuth[few],
            prior=Prior(self.prior.mean[few], self.prior.sd[few]), rest=tuple(self.rest[k] for k in few),
            staying=tuple(self.staying[k] for k in few), trusted=tuple(self.trusted[k] for k in few),
            data=self.data.only(rows), sd=self.sd[few], sd_theta=self.sd_theta[few], horizon=self.horizon[few],
        )  # fmt: skip

    def until(self, horizon: Array) -> ShotProblem:
        """The same shots, up to other times."""
        return dataclasses.replace(self, horizon=horizon)

    @property
    def steps(self) -> Array:
        """Finite differences of the own unknowns: (p,)."""
        return np.concatenate([STEPS, np.full(self.start.shape[1] - len(STEPS), REST_STEP)])

    def balls(self, clip: int) -> tuple[str, ...]:
        """Names, the struck ball first."""
        c = self.clips[clip]
        return (c.struck, *[b for b in c.balls if b != c.struck])

    def shot(self, x: Array, clip: int, times: Array) -> Shot:
        """The shot that unknowns (p,) stand for; the others lie where they are reported, see `undone`."""
        others = self.rest[clip]
        rest = others + x[len(STEPS) : len(STEPS) + others.size].reshape(others.shape)
        return _shot(
            self.balls(clip), x, self.azimuth[clip], self.model.ball.radius, rest, times,
            self.clips[clip].order, not self.clips[clip].running, self.staying[clip],
        )  # fmt: skip

    def struck(self, x: Array, effect: Effect) -> Array:
        """Own unknowns (n, p) that begin as these do where an effect changes what the cue delivers."""
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

    def laid(self, values: Sequence[Mapping[str, Array]]) -> Array:
        """Numbers of every sample, given by ball, as `sd` has them: (n, nball, m); 1 beyond."""
        out = np.ones(self.data.theta.shape)
        for k, clip in enumerate(values):
            for i, name in enumerate(self.balls(k)):
                out[k, i, : len(clip[name])] = clip[name]
        return out

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


def _shot(
    names: tuple[str, ...], x: Array, azimuth: float, radius: float, rest: Array, times: Array, order: float,
    struck: bool, staying: tuple[str, ...] = (),
) -> Shot:  # fmt: skip
    n = len(names)
    q = turn(azimuth)
    position, velocity, spin = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros((n, 3))
    position[0], velocity[0] = x[:2], q @ x[2:4]
    spin[0, :2], spin[0, 2] = q @ x[4:6] / radius, x[6] / radius
    position[1:] = rest
    return Shot(names, position, velocity, spin, times, order=order, struck=struck, staying=staying)


def _line(time: Array, xy: Array) -> Array:
    """Position at time 0 and velocity of a straight line through samples: (2, 2) [m], [m/s]."""
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(time), time]), xy, rcond=None)
    return np.asarray(line)


def _straight(time: Array, xy: Array, roll: float) -> tuple[Array, float]:
    """Unknowns of a straight line through samples, and its azimuth."""
    line = _line(time, xy)
    speed = float(np.hypot(*line[1]))
    azimuth = float(np.arctan2(line[1, 1], line[1, 0]))
    return np.array([*line[0], speed, 0, 0, roll * speed, 0]), azimuth


def shot_problem(model: Model, names: Sequence[str], clip_set: ClipSet, sigma: float) -> ShotProblem:
    """Set up whole shots: starting values and their spread from the cue's command, or from the first samples."""
    n, own = len(clip_set.clips), len(STEPS)
    p = own + 2 * (max((len(c.balls) for c in clip_set.clips), default=1) - 1)
    start, mean, sd, azimuth = np.zeros((n, p)), np.zeros((n, p)), np.full((n, p), REST_SD * sigma), np.zeros(n)
    rest, trusted, staying = [], [], []
    edge = np.array([clip_set.table.length / 2, clip_set.table.width / 2]) - clip_set.ball.radius - CLAMPED
    for k, clip in enumerate(clip_set.clips):
        start[k, :own], mean[k, :own], sd[k, :own], azimuth[k] = _begin(clip, clip_set, sigma)
        others = [o for b, o in clip.balls.items() if b != clip.struck]
        rest.append(np.array([o.xy[: max(moving_from(o, sigma), 1)].mean(axis=0) for o in others]).reshape(-1, 2))
        believe = {b: np.all(np.abs(o.xy) < edge, axis=1) for b, o in clip.balls.items()}
        if not clip.running:
            believe[clip.struck][: free_from(clip.balls[clip.struck], sigma)] = False
        trusted.append(believe)
        ends = {b: clip_set.table.to_pocket(o.xy[-1]) for b, o in clip.balls.items()}
        staying.append(tuple(b for b, far in ends.items() if far > POCKET_REACH * clip_set.ball.diameter))
    end = np.array([max(o.time[-1] for o in c.balls.values()) for c in clip_set.clips])
    names_of = [(c.struck, *[b for b in c.balls if b != c.struck]) for c in clip_set.clips]
    balls = [[c.balls[b] for b in own] for c, own in zip(clip_set.clips, names_of, strict=True)]
    data = packed(
        [[o.time for o in own] for own in balls], [[o.xy for o in own] for own in balls],
        [[o.theta for o in own] for own in balls],
        [[t[b] for b in own] for t, own in zip(trusted, names_of, strict=True)], rest,
        [[b in s for b in own] for s, own in zip(staying, names_of, strict=True)], azimuth,
        [c.order for c in clip_set.clips], [not c.running for c in clip_set.clips], np.zeros(n).tolist(),
    )  # fmt: skip
    return ShotProblem(
        model, tuple(names), clip_set.clips, start, azimuth, Prior(mean, sd), tuple(rest), tuple(staying),
        tuple(trusted), data, np.full(data.theta.shape, sigma), np.full(n, theta_noise(clip_set.clips)), end,
    )  # fmt: skip


def _running_sd(speed: float) -> Array:
    """What is known of a ball on its way, which comes from an impact or a strike: little of its spin (7,)."""
    return np.array([np.inf] * 4 + [2 * speed + 0.05] * 3)


def _begin(clip: Clip, clip_set: ClipSet, sigma: float) -> tuple[Array, Array, Array, float]:
    """Start, mean and spread of a shot's unknowns, and its azimuth."""
    seen, radius = clip.balls[clip.struck], clip_set.ball.radius
    if clip.running:
        x, azimuth = _straight(seen.time[:6], seen.xy[:6], 1.0)
        return x, x.copy(), _running_sd(x[2]), azimuth
    low = free_from(seen, sigma)
    part = slice(low, low + 6)
    x, azimuth = _straight(seen.time[part], seen.xy[part], 0.5)
    marked = np.flatnonzero(np.isfinite(seen.theta))
    sd = np.full(7, np.inf)
    if marked.size > 3:
        few = marked[: max(4, marked.size // 10)]
        x[6] = radius * np.polyfit(seen.time[few], seen.theta[few], 1)[0]
    if clip.cue is not None:
        cue = clip.cue
        azimuth = cue.azimuth
        q = turn(azimuth).T
        line = _line(seen.time[part], seen.xy[part])
        v = q @ line[1]
        lever = 2.5 * cue.speed / radius
        x = np.array([*line[0], *v, lever * cue.side * np.sin(cue.elevation), lever * cue.height, lever * cue.side])
        across = CUE_SD["azimuth"] * cue.speed + 0.02
        spread = CUE_SD["offset"] * lever + 0.02
        mean = np.array([*line[0], cue.speed, 0.0, *x[4:]])
        sd[2:] = [CUE_SD["speed"] * cue.speed + 0.02, across, 0.05 * cue.speed + 0.02, spread, spread]
        return x, mean, sd, azimuth
    speed = x[2]
    wide = 0.6 * LIMIT_SPIN * speed + 0.02
    sd[4:] = [0.1 * speed + 0.02, wide, np.inf if marked.size > TOLD else wide]
    return x, x.copy(), sd, azimuth


def theta_noise(clips: Sequence[Clip]) -> float:
    """Noise of the marks' angles from their third differences [rad]; 1 where no ball is marked."""
    found = []
    for clip in clips:
        for seen in clip.balls.values():
            theta = seen.theta[np.isfinite(seen.theta)]
            if len(theta) > 8:
                found.append(np.diff(theta, 3))
    if not found:
        return 1.0
    return max(float(np.median(np.abs(np.concatenate(found))) / 0.6745 / np.sqrt(20)), 1e-4)
