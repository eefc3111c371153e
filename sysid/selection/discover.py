"""Discovery: fit, diagnose, add the missing effect, until nothing more is to be explained.

In: a `ClipSet` and a `Model` to start from. Out: a `DiscoveryResult`: the ladder of fits, one effect more on each step,
the screenings on the way, what stays unexplained, and the next shot to film.

Where whole shots are not followed, effects are first looked for in windows of one impact each (by_windows.py).
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from functools import partial

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel
from sysid.estimation.from_nothing import fit_from_nothing
from sysid.estimation.split import Split, in_any_case, split
from sysid.selection.by_windows import discover_by_windows, stability_by_windows
from sysid.selection.departures import without_departing
from sysid.selection.evidence import compare_fits, counted_as_one, holds
from sysid.selection.formula import EFFECT_NAME, SparseFormula, describe
from sysid.selection.judge import diagnose_fit
from sysid.selection.next_shot import propose_next
from sysid.selection.pruning import (
    Pruned,
    exchanged,
    fit_without,
    without_needless,
    without_unclear,
    without_undetermined,
    without_unsettled,
)
from sysid.selection.remainder import remainder
from sysid.selection.result import DiscoveryResult, Show
from sysid.selection.score import linearise
from sysid.selection.screening import candidates_for, is_enough
from sysid.selection.stability import stability_of

log = logging.getLogger(__name__)
Prune = Callable[[Split, FittedModel, tuple[str, ...]], Pruned]


def prune(parts: Split, found: DiscoveryResult, by: Prune = without_needless) -> DiscoveryResult:
    """The result without the effects that one of the functions of pruning.py drops.

    Beside what is not explained, `unexplained` is that of the fit without them.
    """
    now, verdict = by(parts, found.last, found.verdict)
    if verdict == found.verdict:
        return found
    if not verdict:  # the base that no effect has bent
        now = found.ladder[0]
    less = _ending_with(found, now, verdict)
    return less if found.unexplained is None else dataclasses.replace(less, unexplained=remainder(now))


def _ending_with(found: DiscoveryResult, now: FittedModel, verdict: tuple[str, ...]) -> DiscoveryResult:
    """The ladder with another last fit; before it stay the fits that have only effects of its verdict."""
    steps = [(s, v) for s, v in zip(found.ladder, found.verdicts, strict=True) if set(v) < set(verdict) or not v]
    steps = [*steps[: len(verdict)], (now, verdict)]
    return dataclasses.replace(
        found, ladder=tuple(s for s, _ in steps), verdicts=tuple(v for _, v in steps),
        pruned=(*found.pruned, *(v for v in found.verdict if v not in verdict)),
    )  # fmt: skip


def discover(clip_set: ClipSet, model: Model, show: Show = lambda found: None) -> DiscoveryResult:
    """Add effects until no candidate is named; then drop those that are no longer needed.

    Args:
        clip_set: every fifth clip is held out.
        model: what to start from; all its constants are fitted.
        show: called with the result so far, after each effect.
    """
    parts, _, model = split(clip_set, model)
    parts, at, now = fit_from_nothing(parts, model)
    found, formula = DiscoveryResult(parts, (now,), ((),), ()), None
    show(found)
    if parts.needs_windows(now):
        found, at, formula = discover_by_windows(found, at)
        if parts.training.is_long and not parts.follows(found.explained or found.last):
            if formula is None:
                found = dataclasses.replace(
                    found, unexplained=remainder(found.last), stability=stability_by_windows(found, at)
                )
            return _with_next_shot(found)
        found = dataclasses.replace(found, ladder=(*found.ladder[:-1], in_any_case(parts, found.last)))
        show(found)
    explained, found = found.explained, dataclasses.replace(found, explained=None)
    if formula is not None and explained is not None:
        seen = _by_whole_shots(found, show, in_any_case(parts, explained), formula)
        if seen.explained is not None:
            return _with_next_shot(seen)
        found = dataclasses.replace(found, unexplained=None)
    return _with_next_shot(_by_whole_shots(found, show, found.last))


def _with_next_shot(found: DiscoveryResult) -> DiscoveryResult:
    return dataclasses.replace(found, next_shot=propose_next(found.parts, found.last, found.rounds, found.verdict))


def _by_whole_shots(
    found: DiscoveryResult,
    show: Show,
    now: FittedModel,
    formula: SparseFormula | None = None,
    without: DiscoveryResult | None = None,
) -> DiscoveryResult:
    """Effects that whole shots name beside those that are in the result, or a formula for what none explains.

    Args:
        found: the result so far.
        show: see `discover`.
        now: the last fit, with the formula if there is one already.
        formula: that it has.
        without: the result before the formula; where that does not hold in the end, what was named beside it is
            judged anew from there, and no other formula is looked for.
    """
    parts, may_grow = found.parts, formula is not None or without is None
    while True:  # each round adds an effect or the formula, or sets shots aside
        diagnosis = diagnose_fit(parts, now, formula, may_grow)
        found = dataclasses.replace(found, rounds=(*found.rounds, diagnosis.screening))
        if diagnosis.screening.base is not now:
            now = diagnosis.screening.base
            if formula is None:
                found = dataclasses.replace(found, ladder=(*found.ladder[:-1], now))
        if diagnosis.formula is not None and diagnosis.fitted_formula is not None:
            without = found if formula is None else without
            formula, now = diagnosis.formula, diagnosis.fitted_formula.fitted
            found = dataclasses.replace(found, unexplained=describe(formula, now, diagnosis.fitted_formula.evidence))
            continue
        best = diagnosis.screening.best
        if best is None:
            fewer = without_departing(parts, found.ladder) if formula is None else None
            if fewer is None:
                break
            parts, ladder = fewer
            now, found = ladder[-1], dataclasses.replace(found, parts=parts, ladder=ladder)
            show(found)
            continue
        log.info("found %s", best.name)
        now = best.fitted
        found = found.with_step(now, (*found.verdict, best.name))
        if formula is None:
            show(found)
    if formula is not None:
        beside = _beside_formula(parts, found, now, formula)
        if beside.explained is None and without is not None:
            return _by_whole_shots(without, show, without.last, without=without)
        found = beside
    if found.unexplained is None:
        found = prune(parts, found)
        found = prune(parts, found, partial(exchanged, pairs=[pair for one in found.rounds for pair in one.tied]))
        found = dataclasses.replace(found, unexplained=remainder(found.last))
        if found.unexplained is not None:
            found = prune(parts, found, without_unclear)
            found = prune(parts, found, without_unsettled)
    if found.explained is None:
        last = found.last
        seen = linearise(last, [one for one in candidates_for(last.model) if one.name not in found.refuted])
        found = dataclasses.replace(found, stability=stability_of(last, found.verdict, seen, counted_as_one(last)))
    return found


def _beside_formula(parts: Split, found: DiscoveryResult, now: FittedModel, formula: SparseFormula) -> DiscoveryResult:
    """The result where a formula is in the last fit, `now`; the model file holds named effects only.

    Effects that were named before the formula may have stood in for it, or explain what it was found for: then they, or
    it, are dropped.
    """
    now, verdict = without_undetermined(parts, *without_needless(parts, now, found.verdict, least=0))
    plain = found.last if verdict == found.verdict else fit_without(parts, now, EFFECT_NAME)
    evidence = compare_fits(plain, now)
    found = _ending_with(found, plain, verdict)
    if not is_enough(evidence, found.rounds[-1].count) or not holds(plain, now):
        log.info("the formula is no longer needed, or does not hold on the clips held out")
        return dataclasses.replace(found, unexplained=None)
    described = describe(formula, now, evidence)
    described |= {"rms_m": now.rms, "held_out_rms_m": now.held_rms, "chi2_reduced": now.chi2}
    return dataclasses.replace(found, unexplained=described, explained=now)
