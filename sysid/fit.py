"""Constants of a model from clips, with their uncertainty.

Segments between events first: they give what acts on open cloth. Then whole shots, whose horizon grows from event to
event with the constants fitted along, so that each impact is met with constants that are already nearly right. Every
fifth clip is held out. Where the model cannot follow the shots to the noise, the error left is described as growing
with the way travelled, sd = hypot(sigma, rate way), constants of the cloth stay as the segments gave them (a long shot
would bend them to make up for what is missing elsewhere), and uncertainties cover what the first events say as well.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm

from models.errors import BadInput
from models.model_file import Estimate, Model
from sysid.clips import ClipSet
from sysid.noise import position_noise
from sysid.own import ROBUST, Growth, with_error
from sysid.problem import (
    STEPS,
    Array,
    SegmentProblem,
    ShotProblem,
    constant_bounds,
    constant_steps,
    segment_problem,
    shot_problem,
)
from sysid.segments import split_all
from sysid.solve import Joint, fit_each, fit_joint
from sysid.spikes import set_aside

HOLD_OUT = 5  # every fifth clip
MISCUT = 25.0  # a segment that misses by so many sigma holds an event that was not seen
FOLLOWS = 1.5  # median rms over noise up to which the cloth is taken to follow the data
SEGMENT_ROBUST = 10.0  # Cauchy's constant while start values are found
EARLY = 2  # events up to which the derivatives of a shot that is not followed are believed
FOLLOWED = 1e-3  # error per way up to which whole shots count as followed
ROUGH = 0.25  # of a standard deviation: a step still wanted that is too small to matter
SCANNED = 100  # segments for start values
LEAST_SEGMENTS = 3
TOO_FEW = "only {} smooth segments between events; film longer free runs, or check the table's size"
Report = Callable[[str], None]


@dataclass(frozen=True)
class Fit:
    """What a fit found."""

    model: Model  # with values and estimates
    covariance: Array  # (q, q) of the constants, in the order of `names`
    names: tuple[str, ...]
    converged: bool
    segment_ratio: float  # median rms of the segments over noise
    error_rate: float  # model error per way travelled: the middle half of the training residuals
    band_rate: float  # the same for 95 % of them, of which some shots go astray
    training: tuple[int, ...]  # clips whose data gave the constants
    own: Array  # (n, p) own unknowns of those clips


def training_clips(clip_set: ClipSet) -> list[int]:
    """Clips that may give constants: all but every fifth."""
    return [k for k in range(len(clip_set.clips)) if len(clip_set.clips) < HOLD_OUT or k % HOLD_OUT != HOLD_OUT - 1]


def subset(clip_set: ClipSet, rows: Sequence[int]) -> ClipSet:
    """Some clips of a set."""
    return dataclasses.replace(clip_set, clips=tuple(clip_set.clips[k] for k in rows))


def values_of(model: Model, names: Sequence[str]) -> Array:
    """Constants as a vector."""
    known = model.parameters()
    return np.array([float(known[n]) for n in names])


def cloth_constants(model: Model) -> tuple[str, ...]:
    """Constants that act on open cloth: of effects with forces, and the native cloth terms."""
    found = []
    for name in model.parameters():
        owner, key = name.split(".")
        effect = next(e for e in model.stack() if e.name() == owner)
        native = effect is model.native and key in ("slide", "roll", "spin")
        if native or effect.slot == "cloth" or effect.opens("forces"):
            found.append(name)
    return tuple(found)


def fit_segments(model: Model, clip_set: ClipSet, sigma: float, report: Report) -> tuple[Joint, tuple[str, ...], float]:
    """Constants of the open cloth from segments, and the median rms over noise that is left."""
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps)
    if len(segments) < LEAST_SEGMENTS:
        raise BadInput(TOO_FEW.format(len(segments)))
    names = cloth_constants(model)
    problem = segment_problem(model, names, segments, sigma)
    c = _scan(problem, model, names, values_of(model, names), report)
    steps, bounds = constant_steps(model, names), constant_bounds(model, names)
    good = np.arange(len(segments))
    x = problem.start
    for last in (False, True):
        x, _ = fit_each(problem.evaluate, x, c, STEPS, problem.prior, SEGMENT_ROBUST, 8)
        ratio = ratios(problem, x, c)
        good = np.flatnonzero(ratio < MISCUT)
        if good.size < LEAST_SEGMENTS:
            raise BadInput(TOO_FEW.format(good.size))
        part = problem.only(good)
        robust = ROBUST * max(1.0, float(np.sqrt(np.mean(ratio[good] ** 2))))
        joint = fit_joint(
            part.evaluate, x[good], c, STEPS, steps, part.prior, bounds, robust, 20 if last else 5,
            report=_steps_of(report, f"{good.size} segments"),
        )  # fmt: skip
        c = joint.constants
    x[good] = joint.own
    return joint, names, float(np.median(ratios(problem, x, c)))


def _steps_of(report: Report, what: str) -> Callable[[int, float, Array], None]:
    return lambda step, cost, _constants: report(f"{what}, step {step}: loss {cost:.0f}")


def _scan(problem: SegmentProblem, model: Model, names: Sequence[str], c: Array, report: Report) -> Array:
    """Start values of the cloth's constants: the best of a coarse scan, one after another, over some long segments."""
    length = np.array([s.time[-1] - s.time[0] for s in problem.segments])
    part = problem.only(np.argsort(-length, kind="stable")[:SCANNED])
    best_cost = np.inf
    for k, name in enumerate(names):
        low, high = model.meta(name)["bounds"]
        start = c[k]
        for factor in (1.0, 0.25, 0.5, 2.0):
            trial = c.copy()
            trial[k] = np.clip(start * factor, low, high)
            _, cost = fit_each(part.evaluate, part.start, trial, STEPS, part.prior, SEGMENT_ROBUST, 4)
            if cost.sum() < best_cost * (1 - 1e-3):
                best_cost, c = float(cost.sum()), trial
        report(f"starting from {name} = {c[k]:.4g}")
    return c


def ratios(problem: SegmentProblem | ShotProblem, x: Array, c: Array) -> Array:
    """Rms residual per axis over noise of every segment or shot: (n,); infinite where no sample is trusted."""
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    count = np.isfinite(r).sum(axis=1)
    return np.where(count > 0, np.sqrt(np.nansum(r**2, axis=1) / np.maximum(count, 1)), np.inf)


def error_rate(growth: Growth, x: Array, c: Array, share: float = 0.5) -> float:
    """Model error per way with which a share of |residual| / sd lies where Gaussian noise has it; 0 if noise does."""
    n = len(x)
    metres = with_error(growth.problem, 1.0, 0.0, growth.way).evaluate(x, np.tile(c, (n, 1)), np.arange(n))
    parts = [(xy.ravel(), np.repeat(growth.way[k][b], 2)) for k, b, xy in growth.problem.by_ball(metres)]
    off, way = (np.concatenate(part) for part in zip(*parts, strict=True))
    use = np.isfinite(off) & (way > 0)
    if not use.any():
        return 0.0
    miss, far = np.abs(off[use]), way[use]
    low, high = 0.0, 1.0
    for _ in range(40):
        middle = 0.5 * (low + high)
        if np.quantile(miss / np.hypot(growth.sigma, middle * far), share) > norm.ppf(0.5 + share / 2):
            low = middle
        else:
            high = middle
    return low if low > 1e-9 else 0.0


def fit(clip_set: ClipSet, model: Model, report: Report = lambda line: None, command: str = "sysid fit") -> Fit:
    """Fit every constant of the model's stack to the training clips."""
    sigma = position_noise(clip_set)
    clip_set, _ = set_aside(clip_set, sigma)
    rows = training_clips(clip_set)
    training = subset(clip_set, rows)
    cloth, cloth_names, ratio = fit_segments(model, training, sigma, report)
    known = np.isfinite(np.diag(cloth.covariance))
    model = model.with_values({n: float(v) for n, v, k in zip(cloth_names, cloth.constants, known, strict=True) if k})
    follows = ratio <= FOLLOWS
    held = () if follows else tuple(n for n, k in zip(cloth_names, known, strict=True) if k)
    names = tuple(n for n in model.parameters() if n not in held)
    joint, rate, band = _grow(training, model, names, sigma, report)
    cov, all_names = _together(joint, names, cloth, cloth_names, held)
    # A constant of which these clips say nothing keeps the value it came with.
    told = np.isfinite(np.diag(joint.covariance))
    values = {n: float(v) for n, v, t in zip(names, joint.constants, told, strict=True) if t}
    converged = joint.converged and (cloth.converged or follows)
    source = f"{command}, {len(rows)} clips" + ("" if converged else ", NOT converged")
    estimates = dict(model.estimates)
    for name, variance in zip(all_names, np.diag(cov), strict=True):
        sd = float(np.sqrt(variance)) if converged else float("nan")
        where = source + (" (segments)" if name in held else "")
        estimates[name] = Estimate(sd, where if np.isfinite(variance) else f"{where}: these clips do not tell")
    fitted = model.with_values(values)
    summary = {
        "command": command, "clips": [c.file for c in training.clips], "converged": converged,
        "noise_m": sigma, "segment_ratio": ratio, "error_rate": rate, "band_rate": band, "names": list(all_names),
        "correlation": _correlation(cov),
    }  # fmt: skip
    fitted = dataclasses.replace(fitted, estimates=estimates, fitted=summary)
    return Fit(fitted, cov, all_names, converged, ratio, rate, band, tuple(rows), joint.own)


@dataclass(frozen=True)
class Grown:
    """Whole shots grown to their ends, constants fitted along the way."""

    growth: Growth  # of the problem, with every constant's name
    own: Array  # (n, p)
    early: Array  # (n, p) own unknowns as the first events gave them
    constants: Array  # (q,)


def grow(training: ClipSet, model: Model, names: tuple[str, ...], sigma: float, report: Report) -> Grown:
    """Grow shots from event to event with the constants `names`, from the model's values."""
    problem = shot_problem(model, names, training, sigma)
    growth = Growth.of(problem, training, sigma)
    c = values_of(model, names)
    x = problem.start.copy()
    early = x
    for stage in range(growth.stages):
        x = growth.own(x, c, stage)
        if stage and np.sum(growth.horizon(stage) > growth.horizon(stage - 1)) > 3:
            seen = growth.grown.until(growth.horizon(stage))
            joint = joint_fit(seen, x, c, report, f"up to event {stage + 1}", 6, 2)
            x, c = joint.own, joint.constants
        if stage <= EARLY:
            early = x
        report(f"whole shots up to event {stage + 1} of {growth.stages}")
    return Grown(growth, x, early, c)


def joint_fit(
    seen: ShotProblem, x: Array, c: Array, report: Report, what: str, iterations: int = 15, own: int = 3
) -> Joint:
    """Every constant of a problem and the own unknowns of its shots, together."""
    steps, bounds = constant_steps(seen.model, seen.names), constant_bounds(seen.model, seen.names)
    return fit_joint(
        seen.evaluate,
        x,
        c,
        seen.steps,
        steps,
        seen.prior,
        bounds,
        ROBUST,
        iterations,
        own,
        report=_steps_of(report, what),
    )


def _grow(
    training: ClipSet, model: Model, names: tuple[str, ...], sigma: float, report: Report
) -> tuple[Joint, float, float]:
    grown = grow(training, model, names, sigma, report)
    growth, x, c = grown.growth, grown.own, grown.constants
    problem = growth.problem
    rate = error_rate(growth, x, c)
    for _ in range(2):
        joint = joint_fit(with_error(problem, sigma, rate, growth.way), x, c, report, "whole shots together")
        x, c = joint.own, joint.constants
        new = error_rate(growth, x, c)
        settled = abs(new - rate) < 0.1 * rate + 1e-4
        if settled:
            break
        rate = new
    if rate > FOLLOWED:
        seen = with_error(problem, sigma, rate, growth.way).until(growth.horizon(EARLY))
        first = joint_fit(seen, grown.early, c, report, f"up to event {EARLY + 1} together")
        joint = _widened(first, joint)
    return joint, rate, error_rate(growth, joint.own, joint.constants, 0.95)


def _widened(first: Joint, whole: Joint) -> Joint:
    """The joint fit of whole shots that are not followed to the noise, with an uncertainty to believe.

    Beyond some impacts a shot is chaotic and its derivatives claim far too much, so the uncertainty is that of the
    first events, widened by how far the constants of the first events lie from those of whole shots, and by the steps
    both fits still wanted. Such a loss is too rough to step down to its last digit: the fit has converged if those
    steps are small against that uncertainty.
    """
    sd = np.sqrt(np.diag(first.covariance))
    wanted = [np.linalg.pinv(j.information.sum(axis=0)) @ j.score.sum(axis=0) for j in (first, whole)]
    wide = np.sqrt(sd**2 + (first.constants - whole.constants) ** 2 + wanted[0] ** 2 + wanted[1] ** 2)
    told = np.isfinite(wide)  # a constant of which the first events say nothing has no uncertainty to compare with
    arrived = all(bool(np.all(np.abs(w[told]) < ROUGH * wide[told])) for w in wanted)
    covariance = np.asarray(first.covariance * np.outer(wide / sd, wide / sd))
    return dataclasses.replace(whole, covariance=covariance, converged=arrived)


def _together(
    joint: Joint, names: Sequence[str], cloth: Joint, cloth_names: Sequence[str], held: Sequence[str]
) -> tuple[Array, tuple[str, ...]]:
    """One covariance for constants from shots and from segments, which are taken as independent."""
    order = (*names, *held)
    out = np.zeros((len(order), len(order)))
    out[: len(names), : len(names)] = joint.covariance
    rows = [list(cloth_names).index(n) for n in held]
    out[len(names) :, len(names) :] = cloth.covariance[np.ix_(rows, rows)]
    return out, order


def _correlation(cov: Array) -> list[list[float]]:
    sd = np.sqrt(np.diag(cov))
    with np.errstate(invalid="ignore", divide="ignore"):
        table = cov / np.outer(sd, sd)
    return [[float(np.round(v, 3)) for v in row] for row in table]
