"""What speaks for something that a fit has more: its marginal likelihood, against nothing and against chance.

In: a `FitView` of a fit without it, and of one with it. Out: `Judged`, and the `Threshold` that a cause must pass.

A cause is judged by how much likelier the shots are with it, averaged over what it may be. It must be likelier than
nothing, which beforehand is as likely as all causes together; likelier than that each shot has a size of its own; and
what shots that are held out say against it is taken off.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np

from sysid.estimation.problem import Array, Index
from sysid.selection.evidence import Evidence, chi2_of_known
from sysid.selection.formula import EFFECT_NAME, SEPARATED_LOG_ODDS
from sysid.selection.free_forms import USUAL_SIZES, log_odds, mean_odds
from sysid.selection.signatures import Candidate
from sysid.selection.terms import Shape
from sysid.selection.view import FitView

ERROR_RATE = 0.05  # that is left to nothing, or to a cause that each shot has of its own, where a cause is added
PART_OF_WIDTH = 0.25  # usual size of a term's coefficient, of its width
V = TypeVar("V", bound=FitView)  # of windows or of whole shots
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Unknown:
    """What is known beforehand of a parameter."""

    name: str
    middle: float  # where it does nothing, or the middle of what it may be
    sd: float  # its usual size, or the standard deviation of what it may be
    sized: bool  # whether sizes smaller and larger than the usual one are as likely


def unknowns_of(one: Candidate, names: Sequence[str]) -> list[Unknown]:
    """Parameters of an effect that are among some constants."""
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
    """Coefficients of terms, and where their steps lie or over what they decay."""
    found = []
    for term in terms:
        found.append(Unknown(f"{EFFECT_NAME}.{term.name}", 0.0, PART_OF_WIDTH * term.width, True))
        if term.limits is not None and term.place_name is not None:
            low, high = term.limits
            name = f"{EFFECT_NAME}.{term.place_name}"
            found.append(Unknown(name, 0.5 * (low + high), (high - low) / math.sqrt(12.0), False))
    return found


@dataclass(frozen=True)
class Judged(Generic[V]):
    """A fit with something more, and what speaks for that."""

    view: V
    unknowns: tuple[Unknown, ...]  # what it has more
    log_odds: float  # of it over the fit without
    over_scatter: float  # log odds over values that each shot has of its own
    evidence: Evidence
    held: float  # gain of log likelihood in shots held out

    @property
    def in_all(self) -> float:
        """Log odds with what held-out shots say against it; what these say for it may be that they began elsewhere."""
        return self.log_odds + min(self.held, 0.0)


@dataclass(frozen=True)
class Threshold:
    """From where on a cause is sure but for an error rate.

    Beforehand all causes together are as likely as nothing, and each as likely as one that every shot has of its own.
    """

    count: int  # of causes that were scored
    error_rate: float

    @property
    def sure(self) -> float:
        """Log odds of what is sure."""
        return math.log((1.0 - self.error_rate) / self.error_rate)

    @property
    def least(self) -> float:
        """Log odds over nothing of a cause that is sure."""
        return math.log(self.count) + self.sure

    def is_passed(self, one: Judged[V]) -> bool:
        """Whether it is sure by all shots, those held out as well."""
        return one.in_all > self.least and self.is_sure(one)

    def is_sure(self, one: Judged[V]) -> bool:
        """Whether it is sure by the shots that are fitted."""
        return one.log_odds > self.least and one.over_scatter > self.sure


def judged(less: V, more: V, unknowns: Sequence[Unknown]) -> Judged[V]:
    """What speaks for a fit with some parameters more.

    With the likeliest values d away from the middle, information S and covariance C of what they may be, a gain of log
    likelihood counts less d' (C + S^-1)^-1 d / 2 + log det(1 + C S) / 2, averaged over the sizes that they may have.
    """
    gain, known = less.gain(more) / more.design_effect, _known(less, more)
    sized = [one for one in unknowns if one.sized]  # a place that is fitted is shared in any case
    alone = known + over_scatter(_away(more, sized), sized, *more.told_of(_rows(more, sized)))
    odds = gain + known + occam_of(more, unknowns)
    held = less.held_gain(more) / more.design_effect
    names = ", ".join(one.name for one in unknowns)
    log.info(
        "%s: log odds %.1f over nothing, %.1f over values of each shot's own, held out %.0f",
        names, odds, alone, held,
    )  # fmt: skip
    bic = 2.0 * gain - len(unknowns) * math.log(max(more.count / more.design_effect, 2.0))
    seen = Evidence(bic, 2.0 * gain, more.design_effect, odds)
    return Judged(more, tuple(unknowns), odds, alone, seen, held)


def judged_where_found(
    less: V, more: V, unknowns: Sequence[Unknown], threshold: Threshold, ranked: bool = False
) -> Judged[V]:
    """The same; held-out shots that alone decide are first searched for where they began.

    They decide where they speak against what the others are sure of, and if it is `ranked` by what they say, wherever
    that is much.
    """
    at = judged(less.beside(more), more, unknowns)
    decide = not threshold.is_passed(at) or (ranked and at.held < -SEPARATED_LOG_ODDS)
    if threshold.is_sure(at) and decide and (again := more.renewed().searched()) is not more:
        at = judged(less.beside(again), again, unknowns)
    return at


def _known(less: FitView, more: FitView) -> float:
    """By how much a second fit agrees better with what is known beside the clips, in log likelihood."""
    return 0.5 * (chi2_of_known(less.point) - chi2_of_known(more.point))


def likelier(one: V, first: Sequence[Unknown], two: V, second: Sequence[Unknown]) -> float:
    """Log of the marginal likelihood of a second fit over that of a first, neither of which need hold the other.

    Each has unknowns that the other need not have.
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
    """Of what parameters may be, for each of the n sizes that they may have: (n, k, k)."""
    sd, sized = np.array([one.sd for one in unknowns]), np.array([one.sized for one in unknowns])
    return np.array([np.diag(np.where(sized, size * sd, sd) ** 2) for size in USUAL_SIZES])


def occam_of(view: FitView, unknowns: Sequence[Unknown]) -> float:
    """What parameters lose by what they might have been, in log likelihood; see `judged`."""
    information = view.told_of(_rows(view, unknowns))[0].sum(axis=0)
    away, odds = _away(view, unknowns), []
    for covariance in covariances(unknowns):
        both = np.eye(len(away)) + covariance @ information
        lost = float(away @ information @ np.linalg.solve(both, away)) + float(np.linalg.slogdet(both)[1])
        odds.append(-0.5 * lost)
    return float(mean_odds(np.array(odds)))


def over_scatter(away: Array, unknowns: Sequence[Unknown], information: Array, gradient: Array) -> float:
    """Log odds of parameters that all shots share over those that each shot has of its own, of the same sizes.

    The losses of shots are quadratic in the parameters.

    Args:
        away: (k,) where they are likeliest, from their middles.
        unknowns: what is known of them beforehand.
        information: (n, k, k) of each shot.
        gradient: (n, k) of its loss, there.
    """
    pull = information @ away - gradient  # gradient where the parameters do nothing, downwards
    sizes = covariances(unknowns)
    own = log_odds(information, pull, sizes[:, None]).sum(axis=1)
    shared = log_odds(information.sum(axis=0), pull.sum(axis=0), sizes)
    return float(mean_odds(shared) - mean_odds(own))


def size_of(view: FitView, unknowns: Sequence[Unknown]) -> float:
    """What parameters are worth by their distance from where they do nothing, in log likelihood."""
    unknowns = [one for one in unknowns if one.sized]
    away = _away(view, unknowns)
    return 0.5 * float(away @ view.told_of(_rows(view, unknowns))[0].sum(axis=0) @ away)
