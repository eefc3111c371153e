"""The state of a search for causes, and its causes compared with every effect of the catalogue.

In: a `Found`. Out: the same with a likelier name in place of a cause.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Generic

from sysid.selection.formulas.causes import causes
from sysid.selection.formulas.formula import (
    EFFECT_NAME,
    RIVAL_SHARE,
    SEPARATED_LOG_ODDS,
    SparseFormula,
    parameters_of,
)
from sysid.selection.formulas.shapes import shape_candidates
from sysid.selection.judgement import Judged, Threshold, Unknown, V, judged, likelier, unknowns_of, unknowns_of_terms
from sysid.selection.scoring.score import Score, Scores
from sysid.selection.scoring.signatures import at_sizes, candidate
from sysid.selection.screening import FittedCandidate, candidates_for

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Found(Generic[V]):
    """The state of a search."""

    view: V
    verdict: tuple[str, ...] = ()  # effects
    formula: SparseFormula | None = None
    dropped: tuple[str, ...] = ()  # effects that were added and later dropped


def with_likelier_name(found: Found[V]) -> tuple[Found[V], FittedCandidate] | None:
    """The state with an effect of the catalogue in place of a cause, and its fit; None if there is none.

    In place of another effect it must be clearly likelier; of a shape, not clearly less likely: a shape is chosen where
    the fit of the effect had not found its end. Scores are those of the last fit without the cause.
    """
    view, formula, every = found.view, found.formula, at_sizes(candidates_for(found.view.model))
    for name in found.verdict:
        own = candidate(next(type(one) for one in view.model.effects if one.name() == name))
        scores = view.scores_without({one for one in view.names if one.startswith(f"{name}.")}, [*every, own])
        if row := _likeliest(scores, name, lambda odds: odds + SEPARATED_LOG_ODDS):
            more = view.stripped(name).with_effect(row).renewed()
            if _over(view, unknowns_of(own, view.names), more, row) > SEPARATED_LOG_ODDS:
                kept = tuple(row.candidate.name if one == name else one for one in found.verdict)
                now = dataclasses.replace(found, view=more, verdict=kept, dropped=(*found.dropped, name))
                return now, _fitted(view.without(name), more, row)
    if formula is None:
        return None
    for group, placed in zip(formula.groups, formula.placed(view.point).groups, strict=True):
        own = shape_candidates([placed])[0]
        scores = view.scores_without(parameters_of(group), [*every, own])
        if row := _likeliest(scores, own.name, lambda odds: RIVAL_SHARE * odds):
            fewer = formula.without(group, view.point)
            start = view.stripped(EFFECT_NAME) if fewer is None else view.with_effect(fewer.score())
            more = start.with_effect(row).renewed()
            if _over(view, unknowns_of_terms(group), more, row) > -SEPARATED_LOG_ODDS:
                verdict = (*found.verdict, row.candidate.name)
                now = dataclasses.replace(found, view=more, verdict=verdict, formula=fewer)
                return now, _fitted(view.without(EFFECT_NAME) if fewer is None else start, more, row)
    return None


def _over(view: V, unknowns: Sequence[Unknown], more: V, row: Score) -> float:
    """Log odds of a fit with an effect over one with another cause, whose unknowns are given, in its place."""
    odds = likelier(view, unknowns, more, unknowns_of(row.candidate, more.names))
    log.info("%s in place of %s: log odds %.1f", row.candidate.name, unknowns[0].name, odds)
    return odds


def _fitted(less: V, more: V, row: Score) -> FittedCandidate:
    """An effect that was fitted, with its evidence over a fit without it."""
    return as_fitted(row, judged(less.beside(more), more, unknowns_of(row.candidate, more.names)))


def as_fitted(row: Score, at: Judged[V], threshold: Threshold | None = None) -> FittedCandidate:
    """A candidate with its fit and evidence, and, for the threshold that it did not pass, the clip that it rests on."""
    clip = at.view.point.problem.clips[at.shot].file if threshold is not None and threshold.rests_on_one(at) else ""
    return FittedCandidate(row, at.view.fitted, at.evidence, at.in_all > 0.0, clip)


def _likeliest(scores: Scores, than: str, least: Callable[[float], float]) -> Score | None:
    """The score of the likeliest candidate beside a given one, if its log odds exceed the least for those of that."""
    odds = {one.name: one.log_odds for one in causes(scores)}
    best = max((name for name in odds if name != than), key=odds.__getitem__, default=than)
    if best == than or odds[best] <= least(odds[than]):
        return None
    return next(one for one in scores.rows if one.candidate.name == best)
