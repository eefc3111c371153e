"""Judgement of additional causes: their marginal likelihood against nothing, and against chance.

In: a `FitView` of a fit without it, and of one with it. Out: `Judged`, and the `Threshold` that a cause must pass.

A cause is judged by the likelihood ratio of the shots with and without it, averaged over its prior. It must be likelier
than nothing, which a priori is as likely as all causes together; it must be likelier than a separate size for each
shot, and than that one shot departs for a reason of its own; and evidence against it from held-out shots is subtracted.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sysid.estimation.problem import Array, Index
from sysid.selection.fits.view import FitView, ShotLosses
from sysid.selection.formulas.causes import USUAL_SIZES, log_odds, mean_odds
from sysid.selection.formulas.formula import EFFECT_NAME, SEPARATED_LOG_ODDS
from sysid.selection.formulas.terms import Shape
from sysid.selection.scoring.evidence import Evidence, chi2_of_known
from sysid.selection.scoring.signatures import Candidate

ERROR_RATE = 0.05  # probability that an added cause is due to nothing, or to a size of each shot's own
PART_OF_WIDTH = 0.25  # usual size of a term's coefficient, over its width
V = TypeVar("V", bound=FitView)  # a view of windows or of whole shots
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unknown:
    """The prior of a parameter."""

    name: str
    middle: float  # value at which it does nothing, or the middle of its range
    sd: float  # its usual size, or the standard deviation of its range
    sized: bool  # whether smaller and larger sizes than the usual one are equally likely


def unknowns_of(one: Candidate, names: Sequence[str]) -> list[Unknown]:
    """The parameters of an effect among some constants, as unknowns."""
    found = []
    for key, meta in one.effect.parameters().items():
        if (name := f"{one.name}.{key}") in names:
            low, high = meta["bounds"]
            if meta["off"] is None:
                found.append(Unknown(name, 0.5 * (low + high), (high - low) / math.sqrt(12.0), False))
            else:
                usual = abs(float(getattr(one.effect, key)) - meta["off"])
                found.append(Unknown(name, meta["off"], usual, True))
    return found


def unknowns_of_terms(terms: Shape) -> list[Unknown]:
    """Coefficients of terms, with the places of their steps or their decay scales, as unknowns."""
    found = []
    for term in terms:
        found.append(Unknown(f"{EFFECT_NAME}.{term.name}", 0.0, PART_OF_WIDTH * term.width, True))
        for place in term.places:
            low, high = place.bounds
            name = f"{EFFECT_NAME}.{place.name}"
            found.append(Unknown(name, 0.5 * (low + high), (high - low) / math.sqrt(12.0), False))
    return found


@dataclass(frozen=True)
class Judged(Generic[V]):
    """A fit with an additional cause, and the evidence for it."""

    view: V
    unknowns: tuple[Unknown, ...]  # parameters of the additional cause
    log_odds: float  # of the fit over that without the cause
    over_scatter: float  # log odds over separate values for each shot
    over_one: float  # log odds over one shot's departing for a reason of its own, with what held-out shots gain
    shot: int  # number of that shot
    evidence: Evidence
    held: float  # gain of log likelihood in held-out shots

    @property
    def names(self) -> str:
        """The parameters, for a message."""
        return ", ".join(one.name for one in self.unknowns)

    @property
    def in_all(self) -> float:
        """Log odds including held-out evidence against it; evidence for it may be due to their initial states."""
        return self.log_odds + min(self.held, 0.0)


@dataclass(frozen=True)
class Threshold:
    """The threshold at which a cause is accepted, for an error rate.

    A priori all causes together are as likely as nothing, and each is as likely as separate values for every shot, and
    as that any one shot departs.
    """

    count: int  # number of scored causes
    error_rate: float

    @property
    def sure(self) -> float:
        """Log odds of the error rate."""
        return math.log((1.0 - self.error_rate) / self.error_rate)

    @property
    def least(self) -> float:
        """Least log odds over nothing of an accepted cause."""
        return math.log(self.count) + self.sure

    def is_passed(self, one: Judged[V]) -> bool:
        """Whether a cause is accepted by all shots, including held-out ones."""
        return one.in_all > self.least and self.is_sure(one)

    def is_sure(self, one: Judged[V]) -> bool:
        """Whether a cause is accepted by the fitted shots."""
        return one.log_odds > self.least and min(one.over_scatter, one.over_one) > self.sure

    def rests_on_one(self, one: Judged[V]) -> bool:
        """Whether a cause is accepted but for one shot that may depart for a reason of its own."""
        return one.in_all > self.least and one.over_scatter > self.sure >= one.over_one


def judged(less: V, more: V, unknowns: Sequence[Unknown]) -> Judged[V]:
    """The evidence for a fit with additional parameters.

    With the likeliest values d away from the middle, information S and prior covariance C, the gain of log likelihood
    is reduced by d' (C + S^-1)^-1 d / 2 + log det(1 + C S) / 2, averaged over the prior of sizes.
    """
    effect, known, held = more.design_effect, _known(less, more), less.held_gain(more) / more.design_effect
    before, after = less.losses_beside(more)
    gain = float((before - after).sum()) / effect
    sized = [one for one in unknowns if one.sized]  # all shots share a fitted place in any case
    alone = known + over_scatter(_away(more, sized), sized, *more.told_of(_rows(more, sized)))
    odds = gain + known + occam_of(more, unknowns)
    without = over_one_shot(
        ShotLosses(before, *less.shots), ShotLosses(after, *more.shots), effect,
        known + occam_without_each(more, unknowns),
    )  # fmt: skip
    one = float(without.min()) + max(held, 0.0)
    names = ", ".join(one.name for one in unknowns)
    log.info(
        "%s: log odds %.1f over nothing, %.1f over separate values for each shot, %.1f over one shot's, held out %.0f",
        names, odds, alone, one, held,
    )  # fmt: skip
    bic = 2.0 * gain - len(unknowns) * math.log(max(more.count / effect, 2.0))
    seen = Evidence(bic, 2.0 * gain, effect, odds)
    return Judged(more, tuple(unknowns), odds, alone, one, int(without.argmin()), seen, held)


def judged_where_found(
    less: V, more: V, unknowns: Sequence[Unknown], threshold: Threshold, over: float | None = None
) -> Judged[V]:
    """The evidence; if held-out shots alone decide, their initial states are searched first.

    They decide if they contradict what the others accept, and, where a rank among rivals is asked for, if their
    evidence is large; but not if a rival has log odds `over` those by the fitted shots, which a search does not change.
    """
    at = judged(less.beside(more), more, unknowns)
    decide = not threshold.is_passed(at) or (over is not None and at.held < -SEPARATED_LOG_ODDS)
    may = threshold.is_sure(at) and at.log_odds > (-math.inf if over is None else over)
    if may and decide and (again := more.renewed().searched()) is not more:
        at = judged(less.beside(again), again, unknowns)
    return at


def _known(less: FitView, more: FitView) -> float:
    """Gain of a second fit in log likelihood of the priors of constants."""
    return 0.5 * (chi2_of_known(less.point) - chi2_of_known(more.point))


def likelier(one: V, first: Sequence[Unknown], two: V, second: Sequence[Unknown]) -> float:
    """Log ratio of the marginal likelihoods of two fits, the second over the first, which need not be nested.

    Each may have unknowns that the other lacks.
    """
    one, two = one.beside(two), two.beside(one)
    gain = one.gain(two)
    better = two if gain > 0 else one
    return gain / better.design_effect + _known(one, two) + occam_of(two, second) - occam_of(one, first)


def _rows(view: FitView, unknowns: Sequence[Unknown]) -> Index:
    return np.array([view.names.index(one.name) for one in unknowns])


def _away(view: FitView, unknowns: Sequence[Unknown]) -> Array:
    """Parameters (k,) as distances from their middles."""
    return np.asarray(view.point.constants[_rows(view, unknowns)] - np.array([one.middle for one in unknowns]))


def covariances(unknowns: Sequence[Unknown]) -> Array:
    """Prior covariance of parameters, for each of n sizes: (n, k, k)."""
    sd, sized = np.array([one.sd for one in unknowns]), np.array([one.sized for one in unknowns])
    return np.array([np.diag(np.where(sized, size * sd, sd) ** 2) for size in USUAL_SIZES])


def occam_of(view: FitView, unknowns: Sequence[Unknown]) -> float:
    """The Occam penalty of parameters, in log likelihood; see `judged`."""
    return _occam(_away(view, unknowns), unknowns, view.told_of(_rows(view, unknowns))[0].sum(axis=0))


def occam_without_each(view: FitView, unknowns: Sequence[Unknown]) -> Array:
    """The same by all other shots, for each that is left out: (n,)."""
    information = view.told_of(_rows(view, unknowns))[0]
    away, total = _away(view, unknowns), information.sum(axis=0)
    return np.array([_occam(away, unknowns, total - one) for one in information])


def _occam(away: Array, unknowns: Sequence[Unknown], information: Array) -> float:
    """The penalty of parameters (k,) away from their middles, of which shots have this information (k, k)."""
    odds = []
    for covariance in covariances(unknowns):
        both = np.eye(len(away)) + covariance @ information
        lost = float(away @ information @ np.linalg.solve(both, away)) + float(np.linalg.slogdet(both)[1])
        odds.append(-0.5 * lost)
    return float(mean_odds(np.array(odds)))


def over_scatter(away: Array, unknowns: Sequence[Unknown], information: Array, gradient: Array) -> float:
    """Log odds of shared parameters over separate ones for each shot, with the same prior sizes.

    The losses of shots are quadratic in the parameters.

    Args:
        away: (k,) likeliest values, relative to the middles.
        unknowns: their priors.
        information: (n, k, k) of each shot.
        gradient: (n, k) of its loss at these values.
    """
    pull = information @ away - gradient  # downward gradient where the parameters do nothing
    sizes = covariances(unknowns)
    own = log_odds(information, pull, sizes[:, None]).sum(axis=1)
    shared = log_odds(information.sum(axis=0), pull.sum(axis=0), sizes)
    return float(mean_odds(shared) - mean_odds(own))


def over_one_shot(less: ShotLosses, more: ShotLosses, design_effect: float, occam: Array) -> Array:
    """Log odds of a cause over each shot's departing for a reason of its own, which would explain it as well: (n,).

    Without the shot, the others must still show the cause, with the constants that they have alone: a shot with a wrong
    clock, say, bends these, and what bends them back for all others looks like a cause. That it departs is a priori as
    likely for each shot.

    Args:
        less: losses about the fit without the cause.
        more: and with it.
        design_effect: by which shots tell less than as many independent residuals.
        occam: (n,) log likelihood that the cause's parameters cost by all shots but one.
    """
    gain = (less.without_each() - more.without_each()) / design_effect
    return np.asarray(gain + occam + math.log(len(gain)))


def size_of(view: FitView, unknowns: Sequence[Unknown]) -> float:
    """Gain of log likelihood by parameters at a distance from where they do nothing."""
    unknowns = [one for one in unknowns if one.sized]
    away = _away(view, unknowns)
    return 0.5 * float(away @ view.told_of(_rows(view, unknowns))[0].sum(axis=0) @ away)
