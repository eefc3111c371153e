"""A sparse formula for structure that no effect of the catalogue explains.

In: a fit (`Point`). Out: a `SparseFormula`, and its description as result.json has it: place, dependence, size.

It grows by a term at a time. Terms (sysid/selection/terms.py) and unknown functions (free_forms.py) are scored like
candidates; the likeliest is added, as long as all of them together are likelier than nothing. The formula is then
fitted as an effect, and the next term is looked for beside it.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.errors import BadInput
from models.formula import MAX_TERMS
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array
from sysid.selection.effect_file import effect_source
from sysid.selection.evidence import Evidence
from sysid.selection.free_forms import Cause, blocks, causes, free_candidates, mean_odds, ranges
from sysid.selection.score import Candidate, Score, Scores, candidate
from sysid.selection.terms import (
    DEPENDENCES,
    QUANTITY_TEXTS,
    RESULT_REMEDY,
    Term,
    effect_from_terms,
    library,
    term_from_json,
)

SEPARATED_LOG_ODDS = math.log(20)  # "strong" evidence (Kass and Raftery 1995)
MAX_PART_OF_BOUNDS = 0.95  # of a term's bounds, that it begins with
EFFECT_NAME = "unexplained"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class SparseFormula:
    """A sparse formula, not yet fitted."""

    terms: tuple[Term, ...]  # what explains most first
    improvements: tuple[float, ...]  # predicted fall of chi-square by each, beside those before it
    values: Array  # (k,) coefficients of the linear model
    alike: tuple[tuple[str, ...], ...] = ()  # for each, what the clips did not tell it from, in words

    def placed(self, found: Point) -> SparseFormula:
        """The formula with steps where a fit that has it puts them."""
        at = dict(zip(found.names, found.constants.tolist(), strict=True))
        terms = tuple(t.moved(at[f"{EFFECT_NAME}.{t.place_name}"]) if t.limits else t for t in self.terms)
        return dataclasses.replace(self, terms=terms)

    def without(self, term: Term, fitted: Point) -> SparseFormula | None:
        """The formula without a term, as a fit that has it puts the others; None where there is no other."""
        keep = [k for k, one in enumerate(self.terms) if one.name != term.name]
        if not keep:
            return None
        at, placed = dict(zip(fitted.names, fitted.constants.tolist(), strict=True)), self.placed(fitted)
        return SparseFormula(
            tuple(placed.terms[k] for k in keep), tuple(self.improvements[k] for k in keep),
            np.array([at[f"{EFFECT_NAME}.{self.terms[k].name}"] for k in keep]),
            tuple(self.alike[k] for k in keep if k < len(self.alike)),
        )  # fmt: skip

    def candidate(self) -> Candidate:
        """The formula as an effect to fit."""
        return candidate(effect_from_terms(EFFECT_NAME, self.terms, self.values.tolist()))

    def score(self) -> Score:
        """The formula's predicted improvement, as that of a candidate."""
        return Score(self.candidate(), float(sum(self.improvements)), self.values, np.full(len(self.terms), np.inf))


@dataclass(frozen=True)
class Looked:
    """Everything that may be missing, scored beside a fit."""

    scores: Scores
    found: list[Cause]  # the likeliest first
    terms: list[Term]
    named: frozenset[str]  # those that are effects of the catalogue
    seen: dict[str, tuple[float, float]]  # ranges of variables

    def row(self, cause: Cause) -> Score:
        """The score of a cause; of an unknown function with its likeliest values."""
        row = _row_of(cause.name, self.scores)
        return row if cause.block is None else dataclasses.replace(row, values=row.candidate.off() + cause.mean)


def look(
    base: Point, score: Callable[[Sequence[Candidate]], Scores], formula: SparseFormula | None,
    named: Sequence[Candidate],
) -> Looked:  # fmt: skip
    """Effects, unknown functions and terms beside a fit.

    Args:
        base: the fit.
        score: of candidates beside it.
        formula: that it has.
        named: effects that it lacks.
    """
    clips, table = base.problem.clips, base.model.table
    seen = ranges(clips, table.length, table.width, base.model.ball.radius)
    balls = max(len(clip.balls) for clip in clips)
    free, terms = blocks(seen, balls), _others(library(table, balls), formula)
    log.info("scoring %d effects, %d functions and %d terms", len(named), len(free), len(terms))
    scores = score([*named, *free_candidates(free), *term_candidates(terms)])
    return Looked(scores, causes(scores, free), terms, frozenset(one.name for one in named), seen)


def grown(
    before: SparseFormula | None,
    base: Point,
    score: Callable[[Sequence[Candidate]], Scores],
    looked: Looked,
) -> SparseFormula | None:
    """A formula with one term more, for what a fit leaves; None where no function or term is likely.

    Args:
        before: the formula that the fit has.
        base: the fit.
        score: of candidates beside it.
        looked: what is likely beside it.
    """
    old = SparseFormula((), (), np.zeros(0)) if before is None else before.placed(base)
    found, terms = [cause for cause in looked.found if cause.name not in looked.named], looked.terms
    if len(old.terms) >= MAX_TERMS or found[0].log_odds <= 0.0:
        return None
    block = found[0].block
    if block is None:
        term, row = _term_of(found[0].name, terms), looked.row(found[0])
    else:
        families = [family for family in (_others(one, old) for one in block.shapes(looked.seen)) if family]
        if not families:
            return None
        term, row = _likeliest(families, score)
    log.info("likeliest is %s, with log odds of %.1f; as a term %s", found[0].name, found[0].log_odds, term.name)
    at = dict(zip(base.names, base.constants.tolist(), strict=True))
    values = [at[f"{EFFECT_NAME}.{one.name}"] for one in old.terms]
    value = float(np.clip(row.values[0], -MAX_PART_OF_BOUNDS * term.width, MAX_PART_OF_BOUNDS * term.width))
    gains = (*old.improvements, row.predicted_improvement)
    alike = (*old.alike, _alike(term, found, terms))
    return SparseFormula((*old.terms, term), gains, np.array([*values, value]), alike)


def _alike(term: Term, found: Sequence[Cause], terms: Sequence[Term]) -> tuple[str, ...]:
    """Other quantities, or other variables of the same, that are about as likely as the likeliest cause."""
    words = []
    for cause in found:
        if cause.log_odds < found[0].log_odds - SEPARATED_LOG_ODDS:
            break
        if cause.block is not None:
            quantity, on = cause.block.quantity, tuple(DEPENDENCES[v] for v in cause.block.variables)
        else:
            quantity, on = (other := _term_of(cause.name, terms)).quantity, other.depends_on
        if (quantity, on) != (term.quantity, term.depends_on):
            words.append(f"{QUANTITY_TEXTS[quantity].partition(' [')[0]} by {' and '.join(on)}")
    return tuple(dict.fromkeys(words))


def _likeliest(
    families: Sequence[Sequence[Term]], score: Callable[[Sequence[Candidate]], Scores]
) -> tuple[Term, Score]:  # fmt: skip
    """The likeliest place or scale of the likeliest family of terms, and its score."""
    terms = [term for family in families for term in family]
    scores = score(term_candidates(terms))
    odds = {_term_of(cause.name, terms): cause for cause in causes(scores)}
    best = max(families, key=lambda family: mean_odds(np.array([odds[term].log_odds for term in family])))
    term = max(best, key=lambda term: odds[term].log_odds)
    return term, _row_of(odds[term].name, scores)


def _others(terms: Sequence[Term], formula: SparseFormula | None) -> list[Term]:
    """Terms that a formula does not have yet."""
    have = set() if formula is None else {term.name for term in formula.terms}
    return [term for term in terms if term.name not in have]


def term_candidates(terms: Sequence[Term]) -> list[Candidate]:
    """Each of these terms as a candidate."""
    return [candidate(effect_from_terms(f"term{k}", (t,), (t.width / 10,))) for k, t in enumerate(terms)]


def _term_of(name: str, terms: Sequence[Term]) -> Term:
    """The term that a candidate has."""
    return terms[int(name.removeprefix("term"))]


def _row_of(name: str, scores: Scores) -> Score:
    """The score of a candidate."""
    return next(one for one in scores.rows if one.candidate.name == name)


def describe(found: SparseFormula, fitted: FittedModel | None, evidence: Evidence | None) -> dict[str, Any]:
    """The formula as `unexplained` of result.json has it: where, on what it depends, how large, its terms."""
    names = [f"{EFFECT_NAME}.{t.name}" for t in found.terms]
    if fitted is not None:
        found = found.placed(fitted)
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
             "depends_on": list(t.depends_on), "gain": g, **_place_of(t, fitted)}
            for t, v, s, g in zip(found.terms, values, sds, found.improvements, strict=True)
        ],
        "alike": [word for words in found.alike for word in words],
        **place,
    }  # fmt: skip


def _place_of(term: Term, fitted: FittedModel | None) -> dict[str, Any]:
    """Where a term's step lies, or over what it decays, as `at` of result.json."""
    if fitted is None or term.place_name is None:
        return {}
    at, sd = fitted.value(f"{EFFECT_NAME}.{term.place_name}")
    return {"at": at, "at_sd": sd if np.isfinite(sd) else None}


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
