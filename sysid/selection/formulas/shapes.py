"""Choice of the shape of an unknown function, by scores of all possible shapes.

In: families of shapes (families.py), and scores. Out: the likeliest of each family, with the places of its steps.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Sequence

import numpy as np

from models.analytic import factors as kinds
from sysid.selection.formulas.causes import Cause, cause_of, mean_odds, usual_values
from sysid.selection.formulas.families import PARTS_OF_RANGE
from sysid.selection.formulas.terms import Shape, effect_from_terms
from sysid.selection.scoring.score import Scores
from sysid.selection.scoring.signatures import Candidate, candidate

FINER_PARTS = 6  # of a part of a range: the finer grid of places around one of the first grid
MIN_PLACE_LOG_ODDS = 0.1  # least gain of log odds by another place, beyond rounding


def likeliest(
    families: Sequence[Sequence[Shape]], score: Callable[[Sequence[Candidate]], Scores]
) -> list[tuple[Shape, Cause]]:
    """The likeliest place or scale of each family of shapes, as shape and cause; the likeliest family first.

    The log odds of the cause are those of the family: averaged over its places.
    """
    terms = list(dict.fromkeys(term for family in families for shape in family for term in shape))
    scores = score(shape_candidates([(term,) for term in terms]))
    usual, name_of = usual_values(scores), {term: f"shape{k}" for k, term in enumerate(terms)}
    odds = {
        shape: cause_of(scores, usual, [name_of[term] for term in shape]) for family in families for shape in family
    }

    found = list[tuple[Shape, Cause]]()
    for family in families:
        best = max(family, key=lambda shape: odds[shape].log_odds)
        of_all = float(mean_odds(np.array([odds[shape].log_odds for shape in family])))
        found.append((best, dataclasses.replace(odds[best], log_odds=of_all)))
    return sorted(found, key=lambda one: -one[1].log_odds)


def at_likeliest_places(
    shape: Shape, cause: Cause, score: Callable[[Sequence[Candidate]], Scores]
) -> tuple[Shape, Cause]:
    """The shape with its steps and bends refined to the likeliest places; unchanged if none is likelier."""
    every = around(shape)
    if len(every) < 2:
        return shape, cause
    found = dict(likeliest([[one] for one in dict.fromkeys([shape, *every])], score))
    best = max(found, key=lambda one: found[one].log_odds)
    gain = found[best].log_odds - found[shape].log_odds
    return (best, found[best]) if gain > MIN_PLACE_LOG_ODDS else (shape, found[shape])


def around(shape: Shape) -> list[Shape]:
    """The shape with its steps, bends and where it begins to act (two at most) at finer places, to the neighbours."""
    moving = [k for k, term in enumerate(shape) if term.limits is not None and term.kind != kinds.DECAY]
    one_sided = shape[0].is_on_one_side
    if not 0 < len(moving) + one_sided <= 2:
        return [shape]
    found = [shape]
    for k in moving:
        places = _finer(shape[k].constants[1], shape[k].limits)
        moved = [shape[k].moved(place) for place in places]
        found = [(*one[:k], term, *one[k + 1 :]) for one in found for term in moved]
    found = [one for one in found if len(moving) < 2 or one[0].constants[1] < one[-1].constants[1]]
    if one_sided and shape[0].only is not None:
        places = _finer(shape[0].only.which, shape[0].only_limits)
        found = [tuple(term.acting_from(place) for term in one) for one in found for place in places]
    return found


def _finer(at: float, limits: tuple[float, float] | None) -> list[float]:
    """Places around one of the first grid, up to its neighbours."""
    low, high = limits or (at, at)
    spacing = (high - low) / PARTS_OF_RANGE
    places = [at + spacing * part / FINER_PARTS for part in range(-FINER_PARTS, FINER_PARTS + 1)]
    return [place for place in places if low < place < high]


def without_terms(every: Sequence[Shape], have: Collection[str]) -> list[Shape]:
    """Shapes without terms of these names."""
    return [shape for shape in every if not any(term.name in have for term in shape)]


def shape_candidates(every: Sequence[Shape]) -> list[Candidate]:
    """Each of these shapes as a candidate."""
    return [
        candidate(effect_from_terms(f"shape{k}", shape, [term.width / 10 for term in shape]))
        for k, shape in enumerate(every)
    ]


def shape_of(name: str, every: Sequence[Shape]) -> Shape:
    """The shape of a candidate."""
    return every[int(name.removeprefix("shape"))]
