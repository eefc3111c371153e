"""Constants of the open cloth from segments between events: the start of every fit.

In: a model and a clip set. Out: an `OpenCloth`: constants with their covariance, and how well segments are followed.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.model_file import Model
from sysid.clips import ClipSet
from sysid.clips.segments import split_all
from sysid.estimation.problem import CAUCHY_SD, Array, shared_constants, values_of
from sysid.estimation.segment_problem import SegmentProblem, segment_problem
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint
from sysid.estimation.solver.least_squares import fit_each

UNSEEN_EVENT_RATIO = 25.0  # a segment that misses by more times the noise contains an undetected event
FOLLOWED_RATIO = 1.5  # largest median rms over noise at which the cloth counts as following the data
START_CAUCHY_SD = 10.0  # Cauchy's constant while start values are found
SCANNED_SEGMENTS = 100  # the longest ones, for start values
SCAN_FACTORS = (1.0, 0.25, 0.5, 2.0)  # of a constant's start value
SCAN_STEPS, SEGMENT_STATE_STEPS, FIRST_FIT_STEPS, LAST_FIT_STEPS = 4, 8, 5, 20
FINE_TOLERANCE, COARSE_TOLERANCE = 1e-5, 1e-4  # share of the loss, if the model follows the segments, or does not
MIN_SEGMENTS = 3
TOO_FEW = (
    "{} smooth paths of balls between impacts, where a fit takes {} or more: film more shots and longer free runs, or "
    "check the table's size"
)
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class OpenCloth:
    """Constants of the open cloth, as fitted to segments."""

    names: tuple[str, ...]
    bounds: Array  # (q, 2)
    solution: Solution
    ratio: float  # median rms of the segments over noise

    @property
    def known(self) -> dict[str, float]:
        """Constants that the segments determine, that is, those not at a bound."""
        known, values = np.isfinite(np.diag(self.solution.covariance)), self.solution.constants
        known &= (values > self.bounds[:, 0]) & (values < self.bounds[:, 1])
        return {n: float(v) for n, v, is_known in zip(self.names, values, known, strict=True) if is_known}


def cloth_constants(model: Model) -> tuple[str, ...]:
    """Constants that act on open cloth: of effects with forces, and the native cloth terms."""
    found = []
    for name in model.parameters():
        if name in model.sizes:
            continue
        owner, key = name.split(".")
        effect = next(e for e in model.stack() if e.name() == owner)
        native = effect is model.native and key in ("slide", "roll", "spin")
        if native or effect.slot == "cloth" or effect.opens("forces"):
            found.append(name)
    return tuple(found)


def fit_open_cloth(model: Model, clip_set: ClipSet, noise: float) -> OpenCloth:
    """Fit the constants of the open cloth to segments.

    Raises:
        BadInput: where there are too few segments.
    """
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, noise, clip_set.fps)
    if len(segments) < MIN_SEGMENTS:
        raise BadInput(TOO_FEW.format(len(segments), MIN_SEGMENTS))
    names = cloth_constants(model)
    problem = segment_problem(model, names, segments, noise)
    c = _scan(problem, model, names)
    shared = shared_constants(model, names)
    x = problem.start
    for iterations in (FIRST_FIT_STEPS, LAST_FIT_STEPS):
        x, _ = fit_each(problem.objective(START_CAUCHY_SD), x, c, SEGMENT_STATE_STEPS)
        ratio = ratios(problem, x, c)
        good = np.flatnonzero(ratio < UNSEEN_EVENT_RATIO)
        if good.size < MIN_SEGMENTS:
            raise BadInput(TOO_FEW.format(good.size, MIN_SEGMENTS))
        part = problem.only(good)
        cauchy_sd = CAUCHY_SD * max(1.0, float(np.sqrt(np.mean(ratio[good] ** 2))))
        followed = float(np.median(ratio[good])) <= FOLLOWED_RATIO
        rule = StoppingRule(iterations, tolerance=FINE_TOLERANCE if followed else COARSE_TOLERANCE)
        found = fit_joint(part.objective(cauchy_sd), x[good], c, shared, rule, f"{good.size} segments")
        c = found.constants
    x[good] = found.initial_states
    return OpenCloth(names, shared.bounds, found, float(np.median(ratios(problem, x, c))))


def _scan(problem: SegmentProblem, model: Model, names: Sequence[str]) -> Array:
    """Start values of the cloth's constants: the best of a coarse scan, one after another, over some long segments."""
    length = np.array([s.time[-1] - s.time[0] for s in problem.segments])
    part = problem.only(np.argsort(-length, kind="stable")[:SCANNED_SEGMENTS])
    c, best_cost = values_of(model, names), np.inf
    for k, name in enumerate(names):
        low, high = model.meta(name)["bounds"]
        start = c[k]
        for factor in SCAN_FACTORS:
            trial = c.copy()
            trial[k] = np.clip(start * factor, low, high)
            _, cost = fit_each(part.objective(START_CAUCHY_SD), part.start, trial, SCAN_STEPS)
            if cost.sum() < best_cost * (1 - 1e-3):
                best_cost, c = float(cost.sum()), trial
        log.info("starting from %s = %.4g", name, c[k])
    return c


def ratios(problem: SegmentProblem | ShotProblem, x: Array, c: Array) -> Array:
    """Rms residual per axis over noise of every segment or shot: (n,); infinite if no sample is trusted."""
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    count = np.isfinite(r).sum(axis=1)
    return np.where(count > 0, np.sqrt(np.nansum(r**2, axis=1) / np.maximum(count, 1)), np.inf)
