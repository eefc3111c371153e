"""A model brought to clips: fitted on some, tried on the others, compared with its rivals.

A stage is a model with its constants fitted to the training clips, the own unknowns of every shot, and the error left
on fitted and held-out clips. Two stages are compared at the same standard deviations, those of the better one, with
the evidence discounted for residuals that hang together.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.clock import stamp_scale
from sysid.commands import with_scatter
from sysid.evidence import Candidate, Point, Scores, score_all
from sysid.fit import FOLLOWS, error_rate, fit_segments, grow, subset, training_clips
from sysid.noise import position_noise
from sysid.own import ROBUST, Growth, with_error
from sysid.pieces import cut_up
from sysid.problem import Array, ShotProblem, shot_problem
from sysid.refine import (
    CLOSE,
    EARLY,
    FOLLOWED,
    STANDS_OUT,
    Refined,
    loss_soon,
    other_spins,
    refine,
    regrow,
    shot_costs,
    shot_losses,
    trusted_until,
)
from sysid.solve import fit_each
from sysid.spikes import set_aside

CLOCK = "clock_scale.factor"
LACKING = 1.5  # times the loss that a few steps without an effect may leave, if it is to be doubted
LAGS = 40  # samples over which residuals may hang together
LONG, SHORT = 40, 8  # steps of a fit that starts far from its optimum
NOISE = 0.5  # loss per residual of noise
CLIPPED = 4.0  # standard deviations, as which larger residuals count in what is left
Report = Callable[[str], None]


@dataclass(frozen=True)
class Clips:
    """A clip set, parted."""

    training: ClipSet
    held: ClipSet
    sigma: float  # noise of the camera [m]
    growth: Growth  # ways and events of the training shots
    held_growth: Growth | None  # and of the held-out ones
    known: Mapping[str, tuple[float, float]]  # of constants, beside the clips: mean and standard deviation
    spikes: int  # samples set aside
    cut: int = 0  # shots that were cut into pieces of one impact each; 0 where whole shots are fitted


@dataclass(frozen=True)
class Stage:
    """A model at its best on the training clips."""

    fit: Refined
    rms: float  # of the training clips, per axis [m]
    held_rms: float  # of the held-out clips; nan without any
    chi2: float  # reduced, of the training clips
    held_own: Array  # (n, p)

    @property
    def point(self) -> Point:
        """Where the fit arrived."""
        return self.fit.point

    @property
    def model(self) -> Model:
        """The model at its constants."""
        return self.fit.point.model

    @property
    def names(self) -> tuple[str, ...]:
        """The constants."""
        return self.fit.point.problem.names

    def value(self, name: str) -> tuple[float, float]:
        """A constant and its standard deviation."""
        k = self.names.index(name)
        return float(self.point.c[k]), float(np.sqrt(self.fit.joint.covariance[k, k]))


def part_clips(clip_set: ClipSet, model: Model, report: Report) -> tuple[Clips, Model]:
    """Every fifth clip held out, the rest for training, and the model with the constants of the open cloth.

    Long shots are cut into pieces where the model does not follow the open cloth.
    """
    sigma = position_noise(clip_set)
    clip_set, spikes = set_aside(clip_set, sigma)
    scale, sd = stamp_scale(clip_set)
    known = {CLOCK: (scale, sd)} if np.isfinite(sd) else {}
    rows = training_clips(clip_set)
    training, held = subset(clip_set, rows), subset(clip_set, [k for k in range(len(clip_set.clips)) if k not in rows])
    cloth, names, ratio = fit_segments(model, training, sigma, report)
    told = np.isfinite(np.diag(cloth.covariance))
    model = model.with_values({n: float(v) for n, v, t in zip(names, cloth.constants, told, strict=True) if t})
    growth = growth_of(model, training, sigma)
    cut = 0
    if ratio > FOLLOWS and np.median([len(e) for e in growth.events]) > EARLY:
        cut = len(clip_set.clips)
        training, held = cut_up(training, sigma), cut_up(held, sigma)
        report(f"{cut} shots cut into {len(training.clips) + len(held.clips)} pieces of one impact each")
        growth = growth_of(model, training, sigma)
    other = growth_of(model, held, sigma) if held.clips else None
    return Clips(training, held, sigma, growth, other, known, spikes, cut), model


def growth_of(model: Model, clip_set: ClipSet, sigma: float) -> Growth:
    """The horizons of clips as whole shots."""
    return Growth.of(shot_problem(model, (), clip_set, sigma), clip_set, sigma)


def begin(clip_set: ClipSet, model: Model, report: Report) -> tuple[Clips, Stage]:
    """The clips parted, and the model with every constant of its stack fitted to them."""
    clips, model = part_clips(clip_set, model, report)
    return clips, settle(clips, model, report, "base")


def settle(clips: Clips, model: Model, report: Report, what: str) -> Stage:
    """A model fitted anew: shots grown from their beginnings, from the constants that it has."""
    grown = grow(clips.training, model, tuple(model.parameters()), clips.sigma, report)
    point = Point(with_scatter(grown.growth.problem, grown.own), grown.own, grown.constants)
    rate = error_rate(grown.growth, point.x, point.c)
    for _ in range(2 if clips.cut else 1):
        if clips.cut:  # a piece that begins on the way knows nothing of its spin
            report(f"{what}, other spins")
            seen = with_error(point.problem, clips.sigma, rate, clips.growth.way)
            point = dataclasses.replace(point, x=other_spins(seen, np.arange(len(point.x)), point.x, point.c))
            rate = error_rate(clips.growth.at(point.problem), point.x, point.c)
        found = refine(point, clips.training, clips.growth, rate, report, what, clips.known, FOLLOWED)
        point, rate = found.point, found.rate
    return stage(clips, found, None)


def stage(clips: Clips, found: Refined, before: Stage | None) -> Stage:
    """What a fit leaves on fitted and held-out clips; `before` knows nearly right unknowns of the latter."""
    r = found.point.residuals()
    rms = clips.sigma * float(np.sqrt(np.nanmean(r**2)))
    freedom = max(int(np.isfinite(r).sum()) - found.point.x.size - found.point.c.size, 1)
    held_rms, own = np.nan, np.zeros((0, 0))
    if clips.held_growth is not None:
        own, held_rms = _held(clips, clips.held_growth, found, before)
    return Stage(found, rms, held_rms, float(np.nansum(r**2)) / freedom, own)


def _held(clips: Clips, growth: Growth, found: Refined, before: Stage | None) -> tuple[Array, float]:
    point = found.point
    problem = dataclasses.replace(growth.problem, model=point.problem.model, names=point.problem.names)
    n = len(problem.clips)
    here = growth.at(problem)
    follows = found.rate < FOLLOWED  # what does not follow its own clips need not be at its best on others
    if before is None:
        x = problem.start.copy()
        for number in range(here.stages):
            x = here.own(x, point.c, number)
    else:
        x = before.held_own
    seen = with_error(problem, clips.sigma, found.rate, growth.way)
    x, _ = fit_each(seen.evaluate, x, point.c, problem.steps, problem.prior, ROBUST, LONG if follows else SHORT)
    astray = np.flatnonzero(shot_costs(problem, x, point.c) > STANDS_OUT * NOISE)
    if clips.cut and before is None:
        x = other_spins(seen, astray, x, point.c)
    elif astray.size and follows:
        x, _ = regrow(seen, clips.held, clips.sigma, astray, x, point.c)
        if found.rate < CLOSE:
            x = other_spins(seen, astray, x, point.c)
    x, _ = fit_each(problem.evaluate, x, point.c, problem.steps, problem.prior, ROBUST, LONG if follows else SHORT)
    r = problem.evaluate(x, np.tile(point.c, (n, 1)), np.arange(n))
    return x, clips.sigma * float(np.sqrt(np.nanmean(r**2)))


def followed(clips: Clips, found: Stage) -> bool:
    """Whether whole shots are followed closely enough to say what acts on them between impacts."""
    return not clips.cut and found.fit.rate <= FOLLOWED


def left_over(clips: Clips, found: Stage) -> float:
    """What the residuals hold beyond noise: mean square of the clipped residuals over that of the noise, less one."""
    r = found.point.residuals()
    seen = np.isfinite(r)
    own = sum(5 + 2 * len(clip.balls) for clip in found.point.problem.clips)
    part = 1.0 - (own + found.point.c.size) / max(int(seen.sum()), 1)
    return float(np.nanmean(np.minimum(r**2, CLIPPED**2))) / part - 1.0


def problem_at(clips: Clips, point: Point, rate: float) -> ShotProblem:
    """A point's problem with the model error of a rate, up to where the shots tell something."""
    seen = with_error(point.problem, clips.sigma, rate, clips.growth.way)
    return seen.until(trusted_until(clips.growth, rate))


def scores_at(clips: Clips, found: Stage, candidates: Sequence[Candidate], quick: bool = False) -> Scores:
    """What candidates promise where a fit has arrived, at its error per way."""
    point = dataclasses.replace(found.point, problem=problem_at(clips, found.point, found.fit.rate))
    return score_all(point, candidates, clips.known, quick=quick)


def correlation_time(clips: Clips, point: Point, rate: float) -> float:
    """Samples that count as one, since residuals hang together: integrated autocorrelation, 1 for white noise."""
    r = point.residuals(problem_at(clips, point, rate))
    found, weight = np.zeros(LAGS), np.zeros(LAGS)
    for _, _, xy in point.problem.by_ball(r):
        n = len(xy)
        for v in np.nan_to_num(np.clip(xy, -CLIPPED, CLIPPED)).T:
            for lag in range(min(LAGS, n)):
                found[lag] += float(v[: n - lag] @ v[lag:])
                weight[lag] += n - lag
    rho = found / np.maximum(weight, 1)
    rho = rho / max(rho[0], 1e-12)
    negative = np.flatnonzero(rho < 0.02)
    stop = int(negative[0]) if negative.size else LAGS
    return float(max(1.0, 1.0 + 2.0 * rho[1:stop].sum()))


def _beside(clips: Clips, found: Stage) -> float:
    """Chi-square of constants against what is known of them beside the clips; an absent one stands at off."""
    total = 0.0
    for name, (mean, sd) in clips.known.items():
        value = found.value(name)[0] if name in found.names else found.model.meta(name)["off"]
        total += ((value - mean) / sd) ** 2
    return float(total)


def taken_out(found: Stage, name: str) -> Point:
    """The point that is left when an effect goes, nothing fitted."""
    keep = np.array([not n.startswith(name + ".") for n in found.names])
    problem = found.point.problem
    model = dataclasses.replace(problem.model, effects=tuple(e for e in problem.model.effects if e.name() != name))
    names = tuple(n for n, k in zip(found.names, keep, strict=True) if k)
    return Point(dataclasses.replace(problem, model=model, names=names), found.point.x, found.point.c[keep])


def missed(clips: Clips, found: Stage, name: str) -> float:
    """How many times the loss is larger a few steps after an effect was taken out."""
    seen = problem_at(clips, found.point, found.fit.rate)
    point = taken_out(found, name)
    soon = loss_soon(problem_at(clips, point, found.fit.rate), point.x, point.c, clips.known)
    return soon / float(shot_losses(seen, found.point.x, found.point.c)[0].sum())


@dataclass(frozen=True)
class Evidence:
    """One stage against another."""

    delta_bic: float  # positive speaks for the second
    gain: float  # fall of the loss, doubled: of chi-square
    tau: float  # samples that count as one


def weighed_like(point: Point, by: Stage) -> Point:
    """A point of a fit, what is known of its own unknowns taken from another: scatter of commands differs by fit."""
    return dataclasses.replace(point, problem=dataclasses.replace(point.problem, prior=by.point.problem.prior))


def compare_stages(clips: Clips, one: Stage, two: Stage, by: Stage | None = None, tau: float | None = None) -> Evidence:
    """Evidence for `two` over `one`, at the same standard deviations and priors: those of `by`, or of the better one.

    `tau`: samples that count as one; found from the better one's residuals if not given.
    """
    by = min((one, two), key=lambda s: s.fit.rate) if by is None else by
    rate = by.fit.rate

    def cost(s: Stage) -> tuple[float, int]:
        seen = problem_at(clips, weighed_like(s.point, by), rate)
        x, _ = fit_each(seen.evaluate, s.point.x, s.point.c, seen.steps, seen.prior, ROBUST, 5)
        total, count = shot_losses(seen, x, s.point.c)
        return 2 * float(total.sum()) + _beside(clips, s), int(count.sum())

    (a, count), (b, _) = cost(one), cost(two)
    if tau is None:
        better = two if b < a else one
        r = better.point.residuals(problem_at(clips, better.point, rate))
        spread = max(1.0, (float(np.nanmedian(np.abs(r))) / 0.6745) ** 2)
        tau = correlation_time(clips, better.point, rate) * spread
    more = two.point.c.size - one.point.c.size
    return Evidence((a - b) / tau - more * float(np.log(max(count / tau, 2))), a - b, tau)
