"""Diagnosis of a fit: a named effect is missing, or structure outside the catalogue, or nothing.

In: clips (`Split`) and their fit (`FittedModel`). Out: a `Diagnosis`.

Whole shots are screened, and a term of a sparse formula (sysid/selection/formula.py) takes the place of an effect that
explains less.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from sysid.estimation.fitted import FittedModel
from sysid.estimation.split import Split
from sysid.selection.departures import shared_cause
from sysid.selection.evidence import compare_fits, counted_as_one, excess_variance, generalises, remove_effect
from sysid.selection.formula import EFFECT_NAME, SparseFormula, grown
from sysid.selection.score import Candidate, Scores, linearise, scores_of
from sysid.selection.screening import (
    MAX_EXCESS_VARIANCE,
    MIN_DELTA_BIC,
    FittedCandidate,
    Screening,
    candidates_for,
    fit_candidate,
    is_enough,
    screen,
)

MIN_SHARE_BESIDE_FORMULA = (
    0.05  # of chi-square beyond noise, that an effect beside a formula must be predicted to explain
)
MAX_FORMULA_EXCESS = 0.1  # variance beyond noise that a formula may leave where only a few shots depart, of one cause
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Diagnosis:
    """The outcome of one diagnosis."""

    screening: Screening
    formula: SparseFormula | None = None  # of structure that no effect explains
    fitted_formula: FittedCandidate | None = None  # the same, fitted

    @property
    def name(self) -> str | None:
        """The effect to name."""
        best = self.screening.best
        return best.name if best is not None and self.formula is None else None


def diagnose_fit(
    parts: Split, now: FittedModel, formula: SparseFormula | None = None, may_grow: bool = True
) -> Diagnosis:
    """Find the effect that a fit lacks or, where none explains the residuals, a formula with one term more.

    Args:
        parts: the clips.
        now: their fit.
        formula: that it has already.
        may_grow: whether to look for a term.
    """
    before, share = now, 0.0 if formula is None else MIN_SHARE_BESIDE_FORMULA
    seen = screen(parts, now, candidates_for(now.model), share)
    best, now = seen.best, seen.base
    if excess_variance(best.fitted if best else now) <= MAX_EXCESS_VARIANCE:
        return Diagnosis(seen)
    larger = grown(formula, now, partial(_scored, now)) if may_grow else None
    if larger is None:
        return Diagnosis(seen)
    bare = now if formula is None else remove_effect(now, EFFECT_NAME)
    fitted = fit_candidate(parts, bare, larger.score())
    fitted = dataclasses.replace(fitted, evidence=compare_fits(now, fitted.fitted))
    if best is not None and not outdoes(best, fitted):
        return Diagnosis(seen)
    if not fitted.converged or not is_enough(fitted.evidence, seen.count) or not generalises(now, fitted.fitted):
        return Diagnosis(seen)
    if excess_variance(fitted.fitted) > MAX_FORMULA_EXCESS and shared_cause(before) is not None:
        return Diagnosis(seen)
    return Diagnosis(seen, larger, fitted)


def _scored(now: FittedModel, candidates: Sequence[Candidate]) -> Scores:
    """Scores of candidates beside a fit, its residuals as many as are independent."""
    return scores_of(now, linearise(now, candidates, quick=True), counted_as_one(now))


def outdoes(best: FittedCandidate, fitted: FittedCandidate) -> bool:
    """Whether the evidence for a formula separates it from the best named effect, and held-out clips agree."""
    more = compare_fits(best.fitted, fitted.fitted).delta_bic > MIN_DELTA_BIC
    return more and generalises(best.fitted, fitted.fitted)
