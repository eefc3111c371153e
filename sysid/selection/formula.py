"""Structure that no effect of the catalogue explains: where it is, on what it depends, how large, and a sparse formula.

Every term of the library (sysid/selection/terms.py) is scored like a candidate, beside all that is active. Terms are
taken one after another, each for what it explains beside those taken, while the evidence pays for it; the formula is
then fitted.
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
from sysid.selection.evidence import Evidence
from sysid.selection.score import Candidate, Score, Scores, candidate, score_all
from sysid.selection.terms import DOORS, REMEDY, Term, effect_of, known, library, source

REMAINS = 40.0  # fall of chi-square that a term must promise before structure is told
SHARE = 2e-3  # and that, per residual
PAYS = 0.04  # of what the first term explains: the least that a further one must
DISTINCT = 1e-3  # of a term's own information that must be left beside the active ones
NAME = "unexplained"
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Structure:
    """A sparse formula, not yet fitted."""

    terms: tuple[Term, ...]  # what explains most first
    gains: tuple[float, ...]  # fall of chi-square of each beside those before it
    values: Array  # coefficients that the linear model promises

    def candidate(self) -> Candidate:
        """The formula as an effect to fit."""
        return candidate(effect_of(NAME, self.terms, self.values.tolist()))

    def score(self) -> Score:
        """The formula's promise, in the form of a candidate's."""
        return Score(self.candidate(), float(sum(self.gains)), self.values, np.full(len(self.terms), np.inf))


def scores_of_terms(base: Point) -> tuple[list[Term], Scores]:
    """Every term beside what is active."""
    most = max((len(c.balls) for c in base.problem.clips), default=1)
    terms = library(base.model.table, most)
    log.info("looking for structure outside the catalogue: %d terms", len(terms))
    candidates = [candidate(effect_of(f"term{k}", (t,), (t.width / 10,))) for k, t in enumerate(terms)]
    return terms, score_all(base, candidates, quick=True)


def select(terms: Sequence[Term], scores: Scores) -> Structure | None:
    """Terms that explain what is left, one after another; None where nothing is."""
    left, pull, own = scores.schur_information.copy(), scores.gradient.copy(), scores.marginal_information
    rows = np.array([scores.blocks[f"term{k}"].start for k in range(len(terms))])
    chosen: list[int] = []
    gains: list[float] = []
    for _ in range(MAX_TERMS):
        size = np.diag(left)[rows]
        fine = size > DISTINCT * np.maximum(own[rows], 1e-300)
        gain = np.where(fine, pull[rows] ** 2 / np.where(fine, size, 1.0), 0.0)
        gain[chosen] = 0.0
        best = int(np.argmax(gain))
        enough = max(REMAINS, SHARE * scores.count) if not chosen else max(REMAINS, PAYS * gains[0])
        if gain[best] < enough:
            break
        chosen.append(best)
        gains.append(float(gain[best]))
        k = rows[best]
        lever = left[:, k] / left[k, k]
        pull = pull - lever * pull[k]
        left = left - np.outer(lever, left[k, :])
    if not chosen:
        return None
    at = rows[chosen]
    block = scores.schur_information[np.ix_(at, at)]
    values = -np.linalg.lstsq(block, scores.gradient[at], rcond=1e-10)[0] * scores.probe[at]
    width = np.array([terms[k].width for k in chosen])
    return Structure(tuple(terms[k] for k in chosen), tuple(gains), np.clip(values, -0.95 * width, 0.95 * width))


def describe(found: Structure, fitted: FittedModel | None, evidence: Evidence | None) -> dict[str, Any]:
    """What is told of it: where, on what it depends, how large, the formula, as result.json has it."""
    names = [f"{NAME}.{t.name}" for t in found.terms]
    if fitted is not None:
        values, sds = zip(*(fitted.value(n) for n in names), strict=True)
    else:
        values, sds = tuple(found.values), tuple([float("nan")] * len(names))
    first = found.terms[0]
    depends = list(dict.fromkeys(word for t in found.terms for word in t.depends_on))
    places = [(t.place, g) for t, g in zip(found.terms, found.gains, strict=True) if t.place is not None]
    where = first.where
    told: dict[str, Any] = {}
    if first.place is not None:
        weight = np.array([g for _, g in places])
        centre = weight @ np.array([p for p, _ in places]) / weight.sum()
        where = f"on the cloth around x = {centre[0]:.2f} m, y = {centre[1]:.2f} m"
        told["place_m"] = [float(v) for v in centre]
    form = "; ".join(f"{DOORS[t.door]}: {v:+.4g} * ({t.factor})" for t, v in zip(found.terms, values, strict=True))
    return {
        "where": where, "depends_on": depends, "size": float(values[0]), "unit": first.unit,
        "what": DOORS[first.door], "form": form,
        "delta_bic": float(evidence.delta_bic) if evidence else float(sum(found.gains)),
        "terms": [
            {"name": t.name, "door": t.door, "factor": t.factor, "unit": t.unit, "width": t.width,
             "value": float(v), "sd": float(s) if np.isfinite(s) else None, "where": t.where,
             "depends_on": list(t.depends_on), "gain": g}
            for t, v, s, g in zip(found.terms, values, sds, found.gains, strict=True)
        ],
        **told,
    }  # fmt: skip


def source_from(name: str, told: dict[str, Any], origin: str) -> str:
    """The effect file for a formula that `describe` told, of terms that the library has.

    Raises:
        BadInput: for anything else.
    """
    entries, what, where = (told.get(key) for key in ("terms", "what", "where"))
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_TERMS:
        raise BadInput(f"what is unexplained has no list of 1 to {MAX_TERMS} terms; {REMEDY}")
    terms, values = zip(*(known(entry) for entry in entries), strict=True)
    if len({t.name for t in terms}) < len(terms):
        raise BadInput(f"what is unexplained has a term twice; {REMEDY}")
    if not isinstance(what, str) or not isinstance(where, str):
        raise BadInput(f"what is unexplained does not say what and where; {REMEDY}")
    return source(name, terms, values, f"Structure found in clips: {what}, {where}.", origin)
