"""Diagnosis of a fit: a named effect is missing, or structure outside the catalogue, or nothing.

In: clips (`Split`) and their fit (`FittedModel`). Out: a `Diagnosis`.

Whole shots are screened, and a sparse formula (sysid/selection/formula.py) takes the place of an effect that explains
clearly less.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass

from sysid.estimation.fitted import FittedModel
from sysid.estimation.split import Split
from sysid.selection.departures import shared_cause
from sysid.selection.evidence import excess_variance, generalises
from sysid.selection.formula import SparseFormula, score_terms, select_terms
from sysid.selection.screening import (
    MAX_EXCESS_VARIANCE,
    FittedCandidate,
    Screening,
    candidates_for,
    fit_candidate,
    is_enough,
    screen,
)

MAX_TERM_ADVANTAGE = 3.0  # predicted improvement of the best term over that of an effect that is still fitted
MIN_TERM_ADVANTAGE = 1.2  # the same over that of the best named effect, for the formula to take its place
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


def diagnose_fit(parts: Split, now: FittedModel, formula: bool = True) -> Diagnosis:
    """Find the effect that a fit lacks or, where none explains the residuals, a formula.

    Args:
        parts: the clips.
        now: their fit.
        formula: whether to look for structure outside the catalogue; False where a formula is in the model already.
    """
    before = now
    searched: list[SparseFormula | None] = []  # the terms are scored once at most, and only where it is needed

    def outside(base: FittedModel) -> SparseFormula | None:
        if not searched:
            searched.append(select_terms(*score_terms(base)))
        return searched[0]

    def competing() -> float:
        found = outside(now) if formula else None
        return found.improvements[0] / MAX_TERM_ADVANTAGE if found else 0.0

    share = 0.0 if formula else MIN_SHARE_BESIDE_FORMULA
    seen = screen(parts, now, candidates_for(now.model), competing, share)
    best, now = seen.best, seen.base
    if not formula or excess_variance(best.fitted if best else now) <= MAX_EXCESS_VARIANCE:
        return Diagnosis(seen)
    structure = outside(now)
    if structure is None or (best is not None and not outdoes(parts, now, structure, best)):
        return Diagnosis(seen)
    log.info("a formula: %s", ", ".join(t.name for t in structure.terms))
    fitted = fit_candidate(parts, now, structure.score())
    if not is_enough(fitted.evidence, seen.count) or not generalises(now, fitted.fitted):
        return Diagnosis(seen)
    if excess_variance(fitted.fitted) > MAX_FORMULA_EXCESS and shared_cause(before) is not None:
        return Diagnosis(seen)
    return Diagnosis(seen, structure, fitted)


def outdoes(parts: Split, now: FittedModel, structure: SparseFormula, best: FittedCandidate) -> bool:
    """Whether the first term of a formula explains clearly more than the best named effect, predicted and fitted.

    Nor may it follow held-out clips worse.
    """
    if structure.improvements[0] <= MIN_TERM_ADVANTAGE * best.score.predicted_improvement:
        return False
    alone = fit_candidate(parts, now, structure.first().score())
    more = alone.evidence.delta_bic > MIN_TERM_ADVANTAGE * best.evidence.delta_bic
    return more and generalises(best.fitted, alone.fitted)
