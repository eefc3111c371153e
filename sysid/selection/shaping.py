"""Shapes that a fit lacks, compared with each other and with an effect.

In: a fit, and scores of functions and terms for it. Out: the likeliest shape that is accepted, and whether it explains
more than an effect.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Sequence
from typing import Generic, NamedTuple

from scipy.stats import binom

from sysid.selection.formulas.causes import causes
from sysid.selection.formulas.formula import MAX_FUNCTIONS, SEPARATED_LOG_ODDS, Looked, SparseFormula, grown
from sysid.selection.formulas.shapes import shape_candidates
from sysid.selection.formulas.terms import Shape
from sysid.selection.judgement import (
    ERROR_RATE,
    Judged,
    Threshold,
    Unknown,
    V,
    judged_where_found,
    likelier,
    unknowns_of_terms,
)
from sysid.selection.rivals import likeliest_first

NOT_FOUND = 0.05  # share of shots in a false optimum with the true model: one of 20 generated ones of a dozen impacts
log = logging.getLogger(__name__)


def unexplained_by(view: V, seen: Looked) -> Looked:
    """The functions and terms that are likely beside a fit's effect as well; see `outdoes`.

    The others have the law of the effect: none of their shapes could take its place.
    """
    ours = [one for one in seen.found if one.name not in seen.named][:MAX_FUNCTIONS]
    beside = causes(view.scores([seen.row(one).candidate for one in ours]), [one.block for one in ours if one.block])
    likely = {one.name: one.log_odds > 0.0 for one in beside}
    of_order = any(likely.values())  # whether functions of the order count as well: see `grown`
    kept = [one for one in seen.found if likely.get(one.name, of_order and one.is_of_order)]
    return dataclasses.replace(seen, found=kept)


class Shaped(NamedTuple, Generic[V]):
    """A fit with an additional shape."""

    view: V
    formula: SparseFormula
    shape: Shape


def likeliest_shape(
    view: V, less: V, seen: Looked, formula: SparseFormula | None, threshold: Threshold
) -> Shaped[V] | None:
    """The likeliest additional shape that is accepted, if any.

    Of shapes that the shots do not separate, the one with the fewest variables and terms is used. Where one leaves
    noise alone, larger ones of the same function are not fitted: one may still replace it, if it is likelier.

    Args:
        view: a fit without it, from which one with a term starts.
        less: the fit to compare it with.
        seen: scores of causes for it.
        formula: of the fit.
        threshold: that a shape must pass.
    """
    tried, explained = list[tuple[Judged[V], SparseFormula, Shape]](), set[tuple[str, tuple[str, ...]]]()
    for larger in sorted(grown(formula, view.point, seen), key=lambda one: len(one.terms)):
        shape = larger.terms[0 if formula is None else len(formula.terms) :]
        function = shape[0].quantity, shape[0].depends_on
        if function in explained:
            continue
        more = view.with_effect(larger.score())
        most = max((one.in_all for one, _, _ in tried), default=-math.inf)
        at = judged_where_found(less, more, unknowns_of_terms(shape), threshold, most)
        if threshold.is_passed(at):
            at = with_few_searched(at)
            tried.append((at, larger, shape))
            if at.view.leaves_noise and not less.leaves_noise:
                explained.add(function)
    if not tried:
        return None
    k, best, _ = likeliest_first([at for at, _, _ in tried], [len(shape[0].depends_on) for _, _, shape in tried])[0]
    _, larger, shape = tried[k]
    return Shaped(best.view, larger, shape)


def outdoes(view: V, shape: Shape, rival: Judged[V]) -> bool:
    """Whether a fit with a shape is likelier than one with an effect, and explains something in addition to it.

    A term that equals the law of the effect explains nothing in addition, whatever progress each fit has made. An
    effect with a parameter at a bound has left the law that it stands for: then it is enough to be likelier.
    """
    beside = causes(rival.view.scores(shape_candidates([shape])))[0].log_odds
    more = likelier(rival.view, rival.unknowns, view, unknowns_of_terms(shape))
    log.info("%s: log odds %.1f over the best effect, %.1f in addition to it", shape[0].group, more, beside)
    return more > SEPARATED_LOG_ODDS and (beside > 0.0 or is_at_bound(rival.view, rival.unknowns))


def is_at_bound(view: V, unknowns: Sequence[Unknown]) -> bool:
    """Whether a parameter of a cause has gone as far as it may, where the cause does not vanish."""
    values = dict(zip(view.names, view.point.constants, strict=True))
    about = {one.name: view.model.meta(one.name) for one in unknowns}
    return any(values[name] in meta["bounds"] and values[name] != meta["off"] for name, meta in about.items())


def with_few_searched(one: Judged[V]) -> Judged[V]:
    """A cause, with new initial states for the shots that its fit does not follow, if these are few and it is likelier.

    They are few if as many are not found by chance alone, although the model lacks nothing more.
    """
    view = one.view
    few = binom.isf(ERROR_RATE, len(view.point.problem.clips), NOT_FOUND)
    return dataclasses.replace(one, view=view.searched()) if view.follows_most and 0 < view.unfollowed <= few else one
