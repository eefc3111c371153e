"""What a fit lacks: one cause after another, named or not, as long as each is likelier than chance.

In: a `FitView` of a fit. Out: views with what it lacks added, and the rounds in which that was found.

Named effects, unknown functions and terms are scored beside the fit at once. A cause is added if it is sure but for an
error rate (judgement.py), first by its score, then by a fit. An unknown function is added as terms that have its shape,
if these explain more than the best named effect and this leaves more than noise. What the rest makes needless, by the
same rule, is dropped.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Generic

from sysid.selection.formula import (
    EFFECT_NAME,
    RIVAL_SHARE,
    SEPARATED_LOG_ODDS,
    UNNAMED,
    Looked,
    SparseFormula,
    grown,
    look,
    parameters_of,
    reshaped,
)
from sysid.selection.free_forms import causes
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
from sysid.selection.screening import FittedCandidate, Screening, candidates_for, confounded, tied
from sysid.selection.shapes import shape_candidates
from sysid.selection.signatures import candidate
from sysid.selection.terms import Shape

MAX_FITS, MAX_TRIALS = 3, 6  # candidates fitted in a round: at most, and as long as none is needed
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Round(Generic[V]):
    """What a fit lacks first."""

    screening: Screening
    view: V  # with it, or as it was
    formula: SparseFormula | None  # that the view has
    threshold: Threshold  # that it passed

    @property
    def name(self) -> str | None:
        """The effect that was added."""
        return self.screening.best.name if self.screening.best else None


def next_cause(view: V, formula: SparseFormula | None = None, error_rate: float = ERROR_RATE) -> Round[V]:
    """The likeliest cause beside a fit, added to it; the same fit where nothing is likely.

    A fit that lacks much may have bent constants so far that the scores of what is missing vanish. Where an unknown
    function or a term is likeliest, and sure, it is fitted first: what takes its place is looked for by the losses of
    the shots that it follows, and fitted from there.

    Args:
        view: the fit.
        formula: that it has.
        error_rate: of a cause that is added.
    """
    named = candidates_for(view.model)
    seen = look(view.point, view.scores, formula, named)
    threshold, first = Threshold(len(seen.found), error_rate), seen.found[0]
    if first.log_odds <= threshold.sure:
        return _added(view, view, view, seen, formula, threshold)
    less = view.continued()
    if first.name not in seen.named and first.log_odds > threshold.least:
        free = view.with_effect(seen.unnamed(first)).renewed().searched()
        start, gone = free.stripped(UNNAMED), {name for name in free.names if name.startswith(f"{UNNAMED}.")}
        there = look(start.point, partial(free.scores_without, gone), formula, named)
        found = _added(view, start, less.beside(start), there, formula, threshold)
        if found.view is not view:
            return found
    return _added(view, view, less, seen, formula, threshold)


def _added(view: V, start: V, less: V, seen: Looked, formula: SparseFormula | None, threshold: Threshold) -> Round[V]:
    """The likeliest cause of those that were seen, added.

    Args:
        view: the fit that lacks it.
        start: a fit from which those with a cause begin.
        less: the fit to compare them with.
        seen: what is likely beside the start.
        formula: that the fit has.
        threshold: that a cause must pass.
    """
    least = threshold.sure if start is view else max(threshold.sure, RIVAL_SHARE * seen.found[0].log_odds)
    rows = [seen.row(c) for c in seen.found if c.name in seen.named and c.log_odds > least]
    fits, good = list[FittedCandidate](), list[tuple[FittedCandidate, Judged[V]]]()
    for row in rows[:MAX_TRIALS]:
        if len(fits) >= MAX_FITS and good:
            break
        more = start.with_effect(row)
        at = judged_where_found(less, more, unknowns_of(row.candidate, more.names), threshold)
        fits.append(FittedCandidate(row, at.view.fitted, at.evidence, at.in_all > 0.0))
        if threshold.is_passed(at):
            good.append((fits[-1], at))
    good = ranked(good)
    best = good[0] if good else None
    rest = [one for one in fits if all(one.name != other.name for other, _ in good)]
    fits = [one for one, _ in good] + sorted(rest, key=lambda one: -one.evidence.log_odds)
    scores = seen.scores.only(seen.named)
    screening = Screening(
        view.fitted, scores, tuple(fits), confounded(scores), tied([one for one, _ in good]), view.windows,
        None if best is None else best[0],
    )  # fmt: skip
    if seen.found[0].log_odds > threshold.sure and (best is None or not best[1].view.leaves_noise):
        found = explained_by_shape(start, less, seen, formula, best and best[1], threshold)
        if found is not None:
            return Round(dataclasses.replace(screening, best=None), *found, threshold)
    return Round(screening, view if best is None else best[1].view, formula, threshold)


def ranked(good: Sequence[tuple[FittedCandidate, Judged[V]]]) -> list[tuple[FittedCandidate, Judged[V]]]:
    """Effects, the likeliest first, all at the errors of the best of them; those beside which it is sure come last.

    They were fitted at those of the model that lacks them all, which hide by how much they differ. Of those that the
    shots do not tell apart, the one with the fewest parameters is first.
    """
    order = sorted(good, key=lambda one: -one[1].log_odds)
    if not order:
        return []
    first = dataclasses.replace(order[0][1], view=order[0][1].view.renewed())
    fits = [(order[0][0], first, 0.0)]
    for one, at in order[1:]:
        at = dataclasses.replace(at, view=at.view.beside(first.view))
        more = likelier(first.view, first.unknowns, at.view, at.unknowns)
        log.info("%s over %s: log odds %.1f", one.name, order[0][0].name, more)
        fits.append((one, at, more))
    top = max(more for _, _, more in fits)

    def rank(fit: tuple[FittedCandidate, Judged[V], float]) -> tuple[bool, int, float]:
        separated = fit[2] <= top - SEPARATED_LOG_ODDS
        return separated, 0 if separated else len(fit[1].unknowns), -fit[2]

    found, fits = [], sorted(fits, key=rank)
    if fits[0][1] is not first:
        fits[0] = (fits[0][0], dataclasses.replace(fits[0][1], view=fits[0][1].view.renewed()), fits[0][2])
    for one, at, more in fits:
        seen = dataclasses.replace(
            one.evidence, log_odds=first.log_odds + more, delta_bic=order[0][0].evidence.delta_bic + 2.0 * more
        )
        found.append((dataclasses.replace(one, fitted=at.view.fitted, evidence=seen), at))
    return found


def explained_by_shape(
    view: V, less: V, seen: Looked, formula: SparseFormula | None, rival: Judged[V] | None, threshold: Threshold
) -> tuple[V, SparseFormula] | None:
    """A formula with one shape more, if that explains more than an effect, or something where there is none.

    Several shapes against one effect would win wherever much is missing, though more effects may explain that, too.
    Of shapes that the shots do not tell apart, the one of the fewest variables and terms is taken.

    Args:
        view: a fit without any of both, from which one with a term begins.
        less: the fit to compare it with.
        seen: what is likely beside it.
        formula: that it has already.
        rival: the fit with the effect.
        threshold: that a shape must pass.
    """
    tried = []
    for larger in grown(formula, view.point, seen):
        shape = larger.terms[0 if formula is None else len(formula.terms) :]
        more = view.with_effect(larger.score())
        at = judged_where_found(less, more, unknowns_of_terms(shape), threshold, ranked=True)
        if threshold.is_passed(at):
            tried.append((at, larger, shape))
        elif not tried:  # the likeliest
            break
    if not tried:
        return None
    least = max(one.in_all for one, _, _ in tried) - SEPARATED_LOG_ODDS
    alike = [one for one in tried if one[0].in_all > least]
    at, larger, shape = min(alike, key=lambda one: (len(one[2][0].depends_on), len(one[0].unknowns), -one[0].in_all))
    best = at.view.renewed()
    return (best, larger) if rival is None or outdoes(best, shape, rival) else None


def outdoes(view: V, shape: Shape, rival: Judged[V]) -> bool:
    """Whether a fit with a shape is likelier than one with an effect, and it explains something beside that.

    A term that is the law of the effect explains nothing beside it, however many steps each of the fits has come.
    """
    beside = causes(rival.view.scores(shape_candidates([shape])))[0].log_odds
    more = likelier(rival.view, rival.unknowns, view, unknowns_of_terms(shape))
    log.info("%s: log odds %.1f over the best effect, %.1f beside it", shape[0].group, more, beside)
    return beside > 0.0 and more > SEPARATED_LOG_ODDS


def without_needless(
    view: V, verdict: tuple[str, ...], formula: SparseFormula | None, threshold: Threshold, searching: bool = False
) -> tuple[V, tuple[str, ...], SparseFormula | None]:
    """The fit without effects and terms that are no longer likelier than chance beside the others, the least first.

    When `searching`, one stays if it is likelier than that shots begin elsewhere; the only one as well, if most shots
    are followed to the noise without it, so that it rests on a few.
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
        may_begin_elsewhere = searching and threshold.is_passed(at) and (count > 1 or less.leaves_noise)
        if may_begin_elsewhere and (again := less.searched()) is not less:
            less = again
            at = judged(less, view.beside(less), unknowns)
        if threshold.is_passed(at):
            break
        log.info("%s is not needed", part if isinstance(part, str) else part[0].group)
        view, formula, verdict = less, fewer, tuple(name for name in verdict if name != part)
    return view, verdict, formula


def with_likeliest_shapes(view: V, formula: SparseFormula) -> tuple[V, SparseFormula]:
    """The fit with another shape in place of each for which one is likelier, clearly if it has more terms.

    A shape is chosen first where much is missing, and a curve may then fit what is a line; what it misses would look
    like one cause more.
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


@dataclass(frozen=True)
class Found(Generic[V]):
    """What was found so far."""

    view: V
    verdict: tuple[str, ...] = ()  # effects
    formula: SparseFormula | None = None
    dropped: tuple[str, ...] = ()  # effects that were added and later dropped


def search(found: Found[V], error_rate: float = ERROR_RATE) -> Iterator[tuple[Found[V], Screening]]:
    """What a fit lacks, after each round in which a cause was looked for; the last found none that stays.

    What an earlier search found, in windows, say, is dropped as well where it is not sure in these shots. Where nothing
    more is likely, shots that miss are searched for where they began, and only what stays sure then is kept: what looks
    like a cause may be a shot that is said to begin elsewhere.
    """
    been, searched = [_what(found)], list[tuple[frozenset[str], frozenset[str]]]()
    while True:
        seen = next_cause(found.view, found.formula, error_rate)
        verdict = (*found.verdict, seen.name) if seen.name else found.verdict
        now = _needed(seen.view, found, verdict, seen.formula, seen.threshold)
        if _what(now) in been:  # nothing was added, or what was dropped
            if _what(found) in searched:
                yield found, seen.screening
                return
            searched.append(_what(found))
            view = found.view.searched()
            now = _needed(view, found, found.verdict, found.formula, seen.threshold, searching=True)
            if now.view is found.view:
                yield found, seen.screening
                return
            been.clear()
        found = now
        been.append(_what(found))
        yield found, seen.screening


def _needed(
    view: V, found: Found[V], verdict: tuple[str, ...], formula: SparseFormula | None, threshold: Threshold,
    searching: bool = False,
) -> Found[V]:  # fmt: skip
    """What was found, with another fit, without effects and terms that it does not need, in their likeliest shapes."""
    now, kept, formula = without_needless(view, verdict, formula, threshold, searching)
    if formula is not None:
        now, formula = with_likeliest_shapes(now, formula)
    gone = tuple(name for name in verdict if name not in kept)
    return Found(now if now is view else now.renewed(), kept, formula, (*found.dropped, *gone))


def _what(found: Found[V]) -> tuple[frozenset[str], frozenset[str]]:
    """The effects and terms of a fit."""
    return frozenset(found.verdict), frozenset(t.name for t in (found.formula.terms if found.formula else ()))
