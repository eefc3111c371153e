"""A sparse formula for structure that no effect of the catalogue explains.

In: a fit (`Point`). Out: a `SparseFormula`, and its description as result.json has it: place, dependence, size.

Every term of the library (sysid/selection/terms.py) is scored like a candidate. Terms are selected by forward
selection: at each step the one with the largest predicted improvement beside those selected already, as long as that
is large enough. The formula is then fitted as an effect.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.errors import BadInput
from models.formula import MAX_TERMS
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array
from sysid.selection import score
from sysid.selection.effect_file import effect_source
from sysid.selection.evidence import Evidence
from sysid.selection.score import Candidate, Score, Scores, candidate, score_all
from sysid.selection.terms import QUANTITY_TEXTS, RESULT_REMEDY, Term, effect_from_terms, library, term_from_json

MIN_TERM_IMPROVEMENT = 40.0  # predicted fall of chi-square, for a term to be selected
MIN_IMPROVEMENT_PER_RESIDUAL = 2e-3  # the same of the first term, per residual
MIN_IMPROVEMENT_OF_FIRST = 0.04  # the same of every further term, over that of the first
MIN_INFORMATION_LEFT = 1e-3  # of a term, beside those selected: below it they imitate it
EFFECT_NAME = "unexplained"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SparseFormula:
    """A sparse formula, not yet fitted."""

    terms: tuple[Term, ...]  # what explains most first
    improvements: tuple[float, ...]  # predicted fall of chi-square by each, beside those before it
    values: Array  # (k,) coefficients of the linear model

    def first(self) -> SparseFormula:
        """The term that explains most, alone."""
        return SparseFormula(self.terms[:1], self.improvements[:1], self.values[:1])

    def candidate(self) -> Candidate:
        """The formula as an effect to fit."""
        return candidate(effect_from_terms(EFFECT_NAME, self.terms, self.values.tolist()))

    def score(self) -> Score:
        """The formula's predicted improvement, as that of a candidate."""
        return Score(self.candidate(), float(sum(self.improvements)), self.values, np.full(len(self.terms), np.inf))


def term_candidates(base: Point) -> tuple[list[Term], list[Candidate]]:
    """All terms of the library for the clips of a fit, and each as a candidate."""
    most = max((len(c.balls) for c in base.problem.clips), default=1)
    terms = library(base.model.table, most)
    log.info("looking for structure outside the catalogue: %d terms", len(terms))
    return terms, term_candidates_of(terms)


def term_candidates_of(terms: Sequence[Term]) -> list[Candidate]:
    """Each of these terms as a candidate."""
    return [candidate(effect_from_terms(f"term{k}", (t,), (t.width / 10,))) for k, t in enumerate(terms)]


def score_terms(base: Point) -> tuple[list[Term], Scores]:
    """All terms of the library, and their scores at a fit."""
    terms, candidates = term_candidates(base)
    return terms, score_all(base, candidates, quick=True)


def select_terms(terms: Sequence[Term], scores: Scores) -> SparseFormula | None:
    """Forward selection of terms; None where not even one explains enough."""
    information, gradient, marginal = scores.schur_information, scores.gradient, scores.marginal_information
    rows = np.array([scores.blocks[f"term{k}"].start for k in range(len(terms))])
    alone = np.diag(information)[rows]
    lost = alone <= score.MIN_INFORMATION_LEFT * np.maximum(marginal[rows], 1e-300)
    chosen: list[int] = []
    improvements: list[float] = []
    for _ in range(MAX_TERMS):
        size = np.diag(information)[rows]
        distinct = (size > MIN_INFORMATION_LEFT * alone) & ~lost
        improvement = np.where(distinct, gradient[rows] ** 2 / np.where(distinct, size, 1.0), 0.0)
        improvement[chosen] = 0.0
        best = int(np.argmax(improvement))
        relative = MIN_IMPROVEMENT_OF_FIRST * improvements[0] if chosen else MIN_IMPROVEMENT_PER_RESIDUAL * scores.count
        if improvement[best] < max(MIN_TERM_IMPROVEMENT, relative):
            break
        chosen.append(best)
        improvements.append(float(improvement[best]))
        # Schur complement: the selected term is projected off all others.
        k = rows[best]
        lever = information[:, k] / information[k, k]
        gradient = gradient - lever * gradient[k]
        information = information - np.outer(lever, information[k, :])
    if not chosen:
        return None
    at = rows[chosen]
    block = scores.schur_information[np.ix_(at, at)]
    values = -np.linalg.lstsq(block, scores.gradient[at], rcond=1e-10)[0] * scores.probe[at]
    width = np.array([terms[k].width for k in chosen])
    values = np.clip(values, -0.95 * width, 0.95 * width)
    return SparseFormula(tuple(terms[k] for k in chosen), tuple(improvements), values)


def describe(found: SparseFormula, fitted: FittedModel | None, evidence: Evidence | None) -> dict[str, Any]:
    """The formula as `unexplained` of result.json has it: where, on what it depends, how large, its terms."""
    names = [f"{EFFECT_NAME}.{t.name}" for t in found.terms]
    if fitted is not None:
        values, sds = zip(*(fitted.value(n) for n in names), strict=True)
    else:
        values, sds = tuple(found.values), tuple([float("nan")] * len(names))
    first = found.terms[0]
    depends = list(dict.fromkeys(word for t in found.terms for word in t.depends_on))
    places = [(t.place, g) for t, g in zip(found.terms, found.improvements, strict=True) if t.place is not None]
    where = first.where
    place: dict[str, Any] = {}
    if first.place is not None:
        weight = np.array([g for _, g in places])
        centre = weight @ np.array([p for p, _ in places]) / weight.sum()
        where = f"on the cloth around x = {centre[0]:.2f} m, y = {centre[1]:.2f} m"
        place["place_m"] = [float(v) for v in centre]
    form = "; ".join(
        f"{QUANTITY_TEXTS[t.quantity]}: {v:+.4g} * ({t.factor})" for t, v in zip(found.terms, values, strict=True)
    )
    return {
        "where": where, "depends_on": depends, "size": float(values[0]), "unit": first.unit,
        "what": QUANTITY_TEXTS[first.quantity], "form": form,
        "delta_bic": float(evidence.delta_bic) if evidence else float(sum(found.improvements)),
        "terms": [
            {"name": t.name, "door": t.quantity, "factor": t.factor, "unit": t.unit, "width": t.width,
             "value": float(v), "sd": float(s) if np.isfinite(s) else None, "where": t.where,
             "depends_on": list(t.depends_on), "gain": g}
            for t, v, s, g in zip(found.terms, values, sds, found.improvements, strict=True)
        ],
        **place,
    }  # fmt: skip


def source_from(name: str, described: dict[str, Any], origin: str) -> str:
    """The effect file for a formula as `describe` returns it, of terms that the library has.

    Raises:
        BadInput: for anything else.
    """
    entries, what, where = (described.get(key) for key in ("terms", "what", "where"))
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_TERMS:
        raise BadInput(f"what is unexplained has no list of 1 to {MAX_TERMS} terms; {RESULT_REMEDY}")
    terms, values = zip(*(term_from_json(entry) for entry in entries), strict=True)
    if len({t.name for t in terms}) < len(terms):
        raise BadInput(f"what is unexplained has a term twice; {RESULT_REMEDY}")
    if not isinstance(what, str) or not isinstance(where, str):
        raise BadInput(f"what is unexplained has no text for what and where; {RESULT_REMEDY}")
    return effect_source(name, terms, values, f"SparseFormula found in clips: {what}, {where}.", origin)
