"""A sparse formula for structure that no effect of the catalogue explains.

In: a fit (`Point`). Out: a `SparseFormula`, and its description as result.json has it: place, dependence, size.

It grows by one shape at a time: a term, or a group of terms. Terms (terms.py) and unknown functions (free_forms.py) are
scored like candidates; the likeliest is added, as long as all of them together are likelier than nothing. The formula
is then fitted as an effect, and the next shape is sought.
"""

from __future__ import annotations

import dataclasses
import itertools
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.formula import MAX_TERMS
from models.variables import SESSION_VARIABLES
from sysid.estimation.fitted import Point
from sysid.estimation.problem import Array
from sysid.selection.formulas.causes import Cause, causes
from sysid.selection.formulas.families import shapes_as
from sysid.selection.formulas.free_forms import Block, Span, blocks, counts_of, free_candidates, ranges
from sysid.selection.formulas.shapes import at_likeliest_places, likeliest, shape_candidates, shape_of, without_terms
from sysid.selection.formulas.terms import (
    QUANTITY_TEXTS,
    VARIABLE_NAMES,
    Shape,
    Term,
    beside_functions,
    effect_from_terms,
)
from sysid.selection.scoring.score import Score, Scores
from sysid.selection.scoring.signatures import Candidate, at_sizes, candidate

SEPARATED_LOG_ODDS = math.log(20)  # "strong" evidence (Kass and Raftery 1995)
RIVAL_SHARE = 0.5  # predicted log odds of a rival over the likeliest cause's, at least; right to a factor of two
MAX_FUNCTIONS = 6  # most functions whose shapes are scored
MAX_RIVALS = 3  # most functions that are fitted, and shapes of the likeliest of them
MAX_PART_OF_BOUNDS = 0.95  # largest start value of a term, over its bounds
EFFECT_NAME = "unexplained"
UNNAMED_EFFECT = "unnamed"  # name of the effect that fits an unknown cause before its shape is known
OF_SESSIONS = {VARIABLE_NAMES[name] for name in SESSION_VARIABLES}
log = logging.getLogger(__name__)


def coefficients_of(fit: Point) -> dict[str, float]:
    """Values of a formula's parameters in a fit, by their names in the formula."""
    return {
        name.removeprefix(f"{EFFECT_NAME}."): value
        for name, value in zip(fit.names, fit.constants.tolist(), strict=True)
        if name.startswith(f"{EFFECT_NAME}.")
    }


@dataclass(frozen=True)
class SparseFormula:
    """A sparse formula, not yet fitted."""

    terms: tuple[Term, ...]  # the most important first
    improvements: tuple[float, ...]  # predicted fall of chi-square by each, given those before it
    values: Array  # (k,) coefficients of the linear model
    alike: tuple[tuple[str, ...], ...] = ()  # for each, alternatives that the clips do not separate from it, in words
    constants: Mapping[str, float] = field(default_factory=dict)  # of the fit, by name, that go with these coefficients

    def placed(self, found: Point) -> SparseFormula:
        """The formula with its steps at their fitted places."""
        at = coefficients_of(found)
        return dataclasses.replace(self, terms=tuple(term.placed(at) for term in self.terms))

    @property
    def groups(self) -> list[Shape]:
        """Its terms, grouped by curve."""
        return [tuple(group) for _, group in itertools.groupby(self.terms, lambda term: term.group)]

    def without(self, group: Shape, fitted: Point) -> SparseFormula | None:
        """The formula without some terms, the others at their fitted values; None if no other is left."""
        keep = [k for k, one in enumerate(self.terms) if one not in group]
        if not keep:
            return None
        at, placed = coefficients_of(fitted), self.placed(fitted)
        return SparseFormula(
            tuple(placed.terms[k] for k in keep), tuple(self.improvements[k] for k in keep),
            np.array([at[self.terms[k].name] for k in keep]),
            tuple(self.alike[k] for k in keep if k < len(self.alike)),
        )  # fmt: skip

    def with_shape(self, shape: Shape, cause: Cause, alike: tuple[str, ...], base: Point) -> SparseFormula:
        """The formula with an additional shape from a cause, and its own terms at their fitted values."""
        at = coefficients_of(base)
        values = [at[one.name] for one in self.terms]
        most = MAX_PART_OF_BOUNDS * np.array([term.width for term in shape])
        return SparseFormula(
            (*self.terms, *shape), (*self.improvements, *[cause.gain / len(shape)] * len(shape)),
            np.concatenate([values, np.clip(cause.mean, -most, most)]), (*self.alike, *[alike] * len(shape)),
            cause.constants,
        )  # fmt: skip

    def candidate(self) -> Candidate:
        """The formula as an effect to fit."""
        return candidate(effect_from_terms(EFFECT_NAME, self.terms, self.values.tolist()))

    def score(self) -> Score:
        """The formula's predicted improvement, as a candidate's score."""
        sd = np.full(len(self.terms), np.inf)
        return Score(self.candidate(), float(sum(self.improvements)), self.values, sd, self.constants)


@dataclass(frozen=True)
class Looked:
    """Scores of everything that a fit may lack."""

    scores: Scores
    found: list[Cause]  # the likeliest first
    terms: list[Shape]  # with one term each
    named: frozenset[str]  # names of the effects of the catalogue
    score: Callable[[Sequence[Candidate]], Scores]  # scores further candidates
    seen: dict[str, Span]  # ranges of variables

    def row(self, cause: Cause) -> Score:
        """The score of a cause."""
        return _row_of(cause.name, self.scores)

    def unnamed(self, cause: Cause) -> Score:
        """The score of an unknown function or a term at its likeliest values, as an effect named UNNAMED_EFFECT."""
        if cause.block is not None:
            one = candidate(cause.block.effect(UNNAMED_EFFECT))
        else:
            shape = shape_of(cause.name, self.terms)
            one = candidate(effect_from_terms(UNNAMED_EFFECT, shape, [term.width / 10 for term in shape]))
        return dataclasses.replace(
            self.row(cause), candidate=one, values=one.off() + cause.mean, constants=cause.constants
        )


def look(
    base: Point, score: Callable[[Sequence[Candidate]], Scores], formula: SparseFormula | None,
    named: Sequence[Candidate], *, joint: bool = False,
) -> Looked:  # fmt: skip
    """Score effects, unknown functions and terms for a fit.

    Args:
        base: the fit.
        score: scores candidates for the fit.
        formula: of the fit.
        named: effects that the fit lacks.
        joint: see `blocks`.
    """
    seen, counts, free = _functions(base, formula, joint)
    terms = without_terms([(term,) for term in beside_functions(base.model.table, counts)], _names_in(formula))
    log.info("scoring %d effects, %d functions and %d terms", len(named), len(free), len(terms))
    scores = score([*at_sizes(named), *free_candidates(free), *shape_candidates(terms)])
    found = causes(scores, free)
    log.info("likeliest: %s", ", ".join(f"{one.name} ({one.log_odds:.1f})" for one in found[:MAX_FUNCTIONS]))
    return Looked(scores, found, terms, frozenset(one.name for one in named), score, seen)


def _functions(
    base: Point, formula: SparseFormula | None, joint: bool
) -> tuple[dict[str, Span], dict[str, int], list[Block]]:
    """Ranges of the variables in a fit's clips, the numbers of counted things, and all blocks beside a formula."""
    clips, table = base.problem.clips, base.model.table
    seen, counts = ranges(clips, table.length, table.width, base.model.ball.radius), counts_of(clips)
    known = formula.placed(base).groups if formula else ()
    return seen, counts, blocks(seen, counts, known, joint=joint)


def grown(before: SparseFormula | None, base: Point, looked: Looked) -> list[SparseFormula]:
    """Formulas with an additional shape for the remaining structure; empty if nothing unnamed is likely.

    Returns a few shapes of the function that has the likeliest, and one of each similarly likely function. Scores are
    evaluated at a fit that may be biased without them, so that only fits can decide.

    Also empty if a function of the clips' order, a value for each shot, is as likely as one of the balls' motion: the
    clips then show that the quantity differs between shots, but not on what it depends.

    Args:
        before: the formula of the fit.
        base: the fit.
        looked: scores of what it may lack.
    """
    old = SparseFormula((), (), np.zeros(0)) if before is None else before.placed(base)
    found, terms = [cause for cause in looked.found if cause.name not in looked.named], looked.terms
    if found[0].log_odds <= 0.0:
        return []
    each = list[list[tuple[Shape, Cause]]]()  # the likeliest shapes of every function
    for one in found[:MAX_FUNCTIONS]:
        if one.log_odds < RIVAL_SHARE * found[0].log_odds:
            break
        if one.block is None:
            each.append([(shape_of(one.name, terms), one)])
        elif families := _lacking(one.block.shapes(looked.seen), old):
            each.append(likeliest(families, looked.score))
    each = [[one for one in few if len(old.terms) + len(one[0]) <= MAX_TERMS] for few in each]
    each = sorted([few for few in each if few], key=lambda few: -few[0][1].log_odds)[:MAX_RIVALS]
    rivals = [one for k, few in enumerate(each) for one in few[: 1 if k else MAX_RIVALS]]
    rivals = [at_likeliest_places(shape, cause, looked.score) for shape, cause in rivals]
    if not rivals:
        return []
    shape = rivals[0][0]
    quantity, on = shape[0].quantity, shape[0].depends_on
    own = [
        one.log_odds for one in found
        if one.block is not None and one.block.quantity == quantity and one.is_of_order
    ]  # fmt: skip
    if not OF_SESSIONS & set(on) and max(own, default=-math.inf) > found[0].log_odds - SEPARATED_LOG_ODDS:
        log.info("%s may equally differ from clip to clip", quantity)
        return []
    names = ", ".join(term.name for term in shape)
    log.info("likeliest is %s, with log odds of %.1f; as terms %s", found[0].name, found[0].log_odds, names)
    return [old.with_shape(shape, cause, _alike(shape, found, terms), base) for shape, cause in rivals]


def reshaped(
    found: SparseFormula, group: Shape, base: Point, score: Callable[[Sequence[Candidate]], Scores]
) -> SparseFormula | None:
    """The formula with one shape replaced by another of the same variables; None if none is likelier.

    Args:
        found: the formula.
        group: the shape.
        base: the fit with the formula.
        score: scores candidates for that fit without this shape.
    """
    old = found.without(group, base) or SparseFormula((), (), np.zeros(0))
    own = tuple(term.placed(coefficients_of(base)) for term in group)
    families = _families_of(own, found, base)
    if families is None:
        return None
    shape, cause = at_likeliest_places(*likeliest([*_lacking(families, old), [own]], score)[0], score)
    if shape == own or len(old.terms) + len(shape) > MAX_TERMS:
        return None
    factors = ", ".join(term.factor for term in shape)
    log.info("likelier than %s of %s: %s", group[0].group, group[0].quantity, factors)
    first = found.terms.index(group[0])
    return old.with_shape(shape, cause, found.alike[first] if first < len(found.alike) else (), base)


def _families_of(group: Shape, found: SparseFormula, base: Point) -> list[list[Shape]] | None:
    """Families of shapes to which one belongs; None if it is no shape of a function."""
    seen, _, free = _functions(base, found, joint=True)
    variable = group[0].variable
    alike = shapes_as(group[0], *seen[variable]) if group[0].is_on_one_side and variable in seen else []
    names = [term.name for term in group]
    for block in [one for one in free if one.quantity == group[0].quantity and not one.known]:
        families = block.shapes(seen)
        if any(names == [term.name for term in shape] for family in families for shape in family):
            return [*alike, *families]
    return alike or None


def _alike(shape: Shape, found: Sequence[Cause], terms: Sequence[Shape]) -> tuple[str, ...]:
    """Other quantities, or other variables, that are about as likely as the likeliest cause."""
    words = []
    for cause in found:
        if cause.log_odds < found[0].log_odds - SEPARATED_LOG_ODDS:
            break
        if cause.block is not None:
            quantity, on = cause.block.quantity, tuple(VARIABLE_NAMES[v] for v in cause.block.variables)
        else:
            (other,) = shape_of(cause.name, terms)
            quantity, on = other.quantity, other.depends_on
        if (quantity, on) != (shape[0].quantity, shape[0].depends_on):
            words.append(f"{QUANTITY_TEXTS[quantity].partition(' [')[0]} by {' and '.join(on)}")
    return tuple(dict.fromkeys(words))


def _names_in(formula: SparseFormula | None) -> set[str]:
    """Names of its terms."""
    return set() if formula is None else {term.name for term in formula.terms}


def _lacking(families: Sequence[Sequence[Shape]], formula: SparseFormula) -> list[list[Shape]]:
    """Families of shapes without a term in the formula."""
    return [few for family in families if (few := without_terms(family, _names_in(formula)))]


def _row_of(name: str, scores: Scores) -> Score:
    """The score of a candidate."""
    return next(one for one in scores.rows if one.candidate.name == name)


def parameters_of(shape: Shape) -> set[str]:
    """Names of the terms' parameters in a fit."""
    places = {place.name for term in shape for place in term.places}
    return {f"{EFFECT_NAME}.{name}" for name in {term.name for term in shape} | places}
