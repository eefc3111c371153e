"""Search for what a fit lacks: adds one cause after another, as long as each is likelier than chance.

In: a `FitView` of a fit. Out: views with the missing causes, and the rounds of the search.

Named effects, unknown functions and terms are scored together. A cause is added if it is accepted at an error rate
(judgement.py), first by its score, then by a fit. An unknown function is added as terms of its shape, if these explain
more than the best named effect and that effect leaves more than noise. Causes that become redundant, by the same rule,
are dropped.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic

from sysid.selection.centring import centred
from sysid.selection.formulas.causes import Cause
from sysid.selection.formulas.formula import (
    EFFECT_NAME,
    RIVAL_SHARE,
    SEPARATED_LOG_ODDS,
    UNNAMED_EFFECT,
    Looked,
    SparseFormula,
    look,
    parameters_of,
    reshaped,
)
from sysid.selection.formulas.terms import Shape
from sysid.selection.judgement import (
    ERROR_RATE,
    Judged,
    Threshold,
    Unknown,
    V,
    judged,
    judged_where_found,
    likelier,
    size_of,
    unknowns_of,
    unknowns_of_terms,
)
from sysid.selection.names import Found, as_fitted, with_likelier_name
from sysid.selection.rivals import ranked
from sysid.selection.scoring.score import Score
from sysid.selection.scoring.signatures import candidate
from sysid.selection.screening import FittedCandidate, Screening, candidates_for, confounded, tied
from sysid.selection.shaping import Shaped, is_at_bound, likeliest_shape, outdoes, unexplained_by, with_few_searched

_What = tuple[frozenset[str], frozenset[str]]  # effects and terms of a fit
MAX_FITS, MAX_TRIALS = 3, 6  # candidates fitted in a round: usually at most, and while none is accepted
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Round(Generic[V]):
    """The result of one step of the search."""

    screening: Screening
    view: V  # with the cause, or unchanged
    formula: SparseFormula | None  # of the view
    threshold: Threshold  # that the cause passed

    @property
    def name(self) -> str | None:
        """The effect that was added."""
        return self.screening.best.name if self.screening.best else None

    @property
    def shape(self) -> Shape:
        """The last shape of the formula."""
        return self.formula.groups[-1] if self.formula else ()


def next_cause(
    view: V, formula: SparseFormula | None = None, error_rate: float = ERROR_RATE, *, joint: bool = False
) -> Round[V]:
    """Add the likeliest cause to a fit; the same fit if nothing is likely.

    A fit that lacks much may have constants so biased that the scores of the missing causes vanish. If an unknown
    function or a term is likeliest, or the likeliest effects are refused or leave more than noise, it is fitted as
    well; its replacement is then sought with the losses of the shots that this fit follows, and fitted from there. What
    replaces it must explain more than the effects that are likely for the fit without the function, unless it leaves
    noise alone.

    If something is likelier than chance, and no cause is accepted, the cause may act for one ball, table or player
    only, and depend there on anything else. Such functions, which are many, are scored last.

    Args:
        view: the fit.
        formula: of the fit.
        error_rate: of an added cause.
        joint: whether functions of a ball, table or player and another variable are scored, too.
    """
    named = candidates_for(view.model)
    seen = look(view.point, view.scores, formula, () if joint else named, joint=joint)
    threshold, first = Threshold(len(seen.found), error_rate), seen.found[0]
    if first.log_odds <= threshold.sure:
        return _with_shape(view, view, view, seen, formula, _effects(view, view, view, seen, threshold))
    less = view.continued()
    effects = _effects(view, view, less, seen, threshold) if first.name in seen.named else None
    function = next((one for one in seen.found if one.name not in seen.named), None)
    if function and function.log_odds > threshold.least and _may_outdo(function, first, effects):
        unnamed = seen.unnamed(function)
        free = view.with_effect(unnamed).renewed().searched()
        if function.block is not None:
            free = centred(free, UNNAMED_EFFECT, function.block)
        start = free.stripped(UNNAMED_EFFECT)
        gone = {name for name in free.names if name.startswith(f"{UNNAMED_EFFECT}.")}
        there = look(start.point, partial(free.scores_without, gone), formula, named, joint=joint)
        beside, shaped = less.beside(start), None
        if there.found[0].name not in there.named and there.found[0].log_odds > threshold.sure:
            shaped = likeliest_shape(start, beside, there, formula, threshold)
            if shaped is not None and shaped.view.leaves_noise and not view.leaves_noise:
                return Round(_screening(view, there, ()), shaped.view, shaped.formula, threshold)
        instead = _effects(view, start, beside, there, threshold)
        found = _with_shape(view, start, beside, there, formula, instead, shaped)
        if found.view is not view:
            if found.view.leaves_noise or (found.name is not None and effects is None):
                return found
            effects = effects or _effects(view, view, less, seen, threshold)
            if effects.best is None or _outdoes(found, instead, effects.best):
                return found
    effects = effects or _effects(view, view, less, seen, threshold)
    found = _with_shape(view, view, less, seen, formula, effects)
    if found.view is view and not joint:
        more = next_cause(view, formula, error_rate, joint=True)
        return found if more.view is view else more
    return found


def _may_outdo(function: Cause, first: Cause, effects: _Effects[V] | None) -> bool:
    """Whether an unknown function may explain more than the likeliest effects, which have been fitted, if any."""
    if effects is None or effects.best is None:
        return True
    return not effects.best.view.leaves_noise and function.log_odds > RIVAL_SHARE * first.log_odds


def _outdoes(found: Round[V], instead: _Effects[V], rival: Judged[V]) -> bool:
    """Whether the cause of a round, one of the effects or a shape instead, is likelier than an effect."""
    if found.name is None or instead.best is None:
        return outdoes(found.view, found.shape, rival)
    return likelier(rival.view, rival.unknowns, instead.best.view, instead.best.unknowns) > 0.0


@dataclass(frozen=True)
class _Effects(Generic[V]):
    """The effects that were fitted in a round."""

    screening: Screening
    best: Judged[V] | None  # of those that passed
    threshold: Threshold


def _effects(view: V, start: V, less: V, seen: Looked, threshold: Threshold) -> _Effects[V]:
    """Fit the likeliest of the scored effects.

    Args:
        view: the fit that lacks it.
        start: a fit from which those with a cause start.
        less: the fit to compare these with.
        seen: scores of causes at the start.
        threshold: that a cause must pass.
    """
    least = threshold.sure if start is view else max(threshold.sure, RIVAL_SHARE * seen.found[0].log_odds)
    tried, enough = list[tuple[Score, Judged[V]]](), RIVAL_SHARE * seen.found[0].log_odds
    for one in [one for one in seen.found if one.name in seen.named and one.log_odds > least][:MAX_TRIALS]:
        good = [at for _, at in tried if threshold.is_passed(at)]
        explained = len(tried) > 1 and one.log_odds < enough and any(at.view.leaves_noise for at in good)
        if good and (len(tried) >= MAX_FITS or explained):  # the second is the margin over the next best
            break
        row = seen.row(one)
        more = start.with_effect(row)
        tried.append((row, judged_where_found(less, more, unknowns_of(row.candidate, more.names), threshold)))
    found = ranked([(as_fitted(row, at), at) for row, at in tried if threshold.is_passed(at)])
    if found:
        likeliest = with_few_searched(found[0][1])
        found[0] = dataclasses.replace(found[0][0], fitted=likeliest.view.fitted), likeliest
    fits = [one for one, _ in found]
    rest = [as_fitted(row, at, threshold) for row, at in tried if all(row is not one.score for one in fits)]
    rest = sorted(rest, key=lambda one: -one.evidence.log_odds)
    return _Effects(_screening(view, seen, (*fits, *rest), fits), found[0][1] if found else None, threshold)


def _screening(
    view: V, seen: Looked, fits: tuple[FittedCandidate, ...], good: Sequence[FittedCandidate] = ()
) -> Screening:
    """The scored effects and those that were fitted, of which `good` are accepted, the likeliest first."""
    scores = seen.scores.only(seen.named)
    best = good[0] if good else None
    return Screening(view.fitted, scores, fits, confounded(scores), tied(good), view.windows, best)


def _with_shape(
    view: V, start: V, less: V, seen: Looked, formula: SparseFormula | None, effects: _Effects[V],
    shaped: Shaped[V] | None = None,
) -> Round[V]:  # fmt: skip
    """Add the likeliest effect, or a shape if that explains more of what the effect leaves; see `_effects`.

    Several shapes against one effect would win whenever much is missing, although more effects might explain it as
    well. The shape is given if it is known.
    """
    best, threshold = effects.best, effects.threshold
    if seen.found[0].log_odds > threshold.sure and (best is None or not best.view.leaves_noise):
        if shaped is None:
            if best is not None and not is_at_bound(best.view, best.unknowns):
                seen = unexplained_by(best.view, seen)
            if seen.found and seen.found[0].log_odds > threshold.sure:
                shaped = likeliest_shape(start, less, seen, formula, threshold)
        if shaped is not None and (best is None or outdoes(shaped.view, shaped.shape, best)):
            return Round(dataclasses.replace(effects.screening, best=None), shaped.view, shaped.formula, threshold)
    return Round(effects.screening, view if best is None else best.view, formula, threshold)


def without_needless(
    view: V, verdict: tuple[str, ...], formula: SparseFormula | None, threshold: Threshold, searching: bool = False
) -> tuple[V, tuple[str, ...], SparseFormula | None]:
    """Drop effects and terms that, given the others, are no longer likelier than chance, the least likely first.

    With `searching`, a cause stays only if it is likelier than other initial states of shots; a single cause is tested
    like this only if most shots are followed to the noise without it, so that it rests on a few.
    """
    while (count := len(verdict) + (0 if formula is None else len(formula.groups))) > (0 if searching else 1):
        parts: list[tuple[str | Shape, list[Unknown]]] = []
        for name in verdict:
            kind = next(type(one) for one in view.model.effects if one.name() == name)
            parts.append((name, unknowns_of(candidate(kind), view.names)))
        parts += [(group, unknowns_of_terms(group)) for group in (() if formula is None else formula.groups)]
        part, unknowns = min(parts, key=lambda one: size_of(view, one[1]))
        less, fewer = view, formula
        if isinstance(part, str):
            less = view.without(part)
        else:
            fewer = formula.without(part, view.point) if formula is not None else None
            less = view.without(EFFECT_NAME) if fewer is None else view.with_effect(fewer.score())
        at = judged(less, view.beside(less), unknowns)
        may_begin_elsewhere = searching and threshold.is_passed(at) and (count > 1 or less.follows_most)
        if may_begin_elsewhere and (again := less.searched()) is not less:
            less = again
            at = judged(less, view.beside(less), unknowns)
        if threshold.is_passed(at):
            break
        log.info("%s is not needed", part if isinstance(part, str) else part[0].group)
        view, formula, verdict = less, fewer, tuple(name for name in verdict if name != part)
    return view, verdict, formula


def with_likeliest_shapes(view: V, formula: SparseFormula) -> tuple[V, SparseFormula]:
    """Replace shapes by likelier ones; clearly likelier ones if they have more terms.

    A shape is chosen while much is missing, when a curve may fit what is really a line; the difference would look like
    a further cause.
    """
    for name in [group[0].group for group in formula.groups]:
        group = next(one for one in formula.groups if one[0].group == name)
        other = reshaped(formula, group, view.point, partial(view.scores_without, parameters_of(group)))
        if other is not None:
            more, shape = view.with_effect(other.score()), other.groups[-1]
            least = SEPARATED_LOG_ODDS if len(shape) > len(group) else 0.0
            if likelier(view, unknowns_of_terms(group), more, unknowns_of_terms(shape)) > least:
                view, formula = more, other
    return view, formula


def search(found: Found[V], error_rate: float = ERROR_RATE) -> Iterator[tuple[Found[V], Screening]]:
    """Search for what a fit lacks; yields the state after each round, the last of which adds nothing.

    Causes of an earlier search, for example in windows, are dropped as well if these shots do not support them. With
    each cause that is added, the few shots that are still not followed are given new initial states, if likelier: a
    wrong one looks like a further cause. When nothing more is likely this is done once more, and causes that are no
    longer accepted are dropped. In the end each cause is compared with the effects of the catalogue.
    """
    been, searched, read = [_what(found)], list[_What](), list[_What]()
    while True:
        seen, now = next_cause(found.view, found.formula, error_rate), found
        if seen.view is not found.view:
            verdict = (*found.verdict, seen.name) if seen.name else found.verdict
            now = _needed(seen.view.searched(every=True), found, verdict, seen.formula, seen.threshold)
        if _what(now) in been:  # nothing was added, or a dropped cause was added again
            now = found
            if _what(found) not in searched:
                searched.append(_what(found))
                now = _needed(
                    found.view.searched(), found, found.verdict, found.formula, seen.threshold, searching=True
                )
                if now.view is not found.view:
                    been.clear()
            if now.view is found.view and _what(found) not in read:
                read.append(_what(found))
                if instead := with_likelier_name(found):
                    now, fit = instead
                    seen = dataclasses.replace(
                        seen, screening=dataclasses.replace(seen.screening, fits=(fit,), best=fit)
                    )
            if now.view is found.view:
                yield found, seen.screening
                return
        found = now
        been.append(_what(found))
        yield found, seen.screening


def _needed(
    view: V, found: Found[V], verdict: tuple[str, ...], formula: SparseFormula | None, threshold: Threshold,
    searching: bool = False,
) -> Found[V]:  # fmt: skip
    """The state with another fit, without redundant effects and terms, and with the likeliest shapes."""
    now, kept, formula = without_needless(view, verdict, formula, threshold, searching)
    if formula is not None:
        now, formula = with_likeliest_shapes(now, formula)
    gone = tuple(name for name in verdict if name not in kept)
    return Found(now if now is view else now.renewed(), kept, formula, (*found.dropped, *gone))


def _what(found: Found[V]) -> _What:
    """The effects and terms of a fit."""
    return frozenset(found.verdict), frozenset(t.name for t in (found.formula.terms if found.formula else ()))
