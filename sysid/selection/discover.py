"""Discovery: fit, find what is missing, add it, until nothing more is likely.

In: a `ClipSet` and a start `Model`. Out: a `DiscoveryResult`: the ladder of fits, each with one more effect, the rounds
of the search, unexplained structure, and the next shots to film.

Shots of many impacts may be followed only by biased constants, or not at all. So causes are first sought in windows of
one impact each, and in whole shots if these are then followed. Other shots are searched whole.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel
from sysid.estimation.from_nothing import fit_from_nothing, whole_shots
from sysid.estimation.solver.blas import on_one_blas_thread
from sysid.estimation.split import Split, split
from sysid.selection.departures import count_departing, without_departing
from sysid.selection.exchange import exchanged
from sysid.selection.fits.by_whole_shots import ByWholeShots
from sysid.selection.fits.by_windows import ByWindows
from sysid.selection.formulas.description import describe
from sysid.selection.formulas.formula import EFFECT_NAME
from sysid.selection.judgement import ERROR_RATE, V, judged, unknowns_of_terms
from sysid.selection.names import Found
from sysid.selection.next_shot import propose_next
from sysid.selection.remainder import remainder
from sysid.selection.result import DiscoveryResult, Show
from sysid.selection.scoring.signatures import at_sizes
from sysid.selection.screening import candidates_for
from sysid.selection.search import search
from sysid.selection.stability import stability_of

log = logging.getLogger(__name__)


@on_one_blas_thread
def discover(
    clip_set: ClipSet, model: Model, show: Show = lambda found: None, error_rate: float = ERROR_RATE
) -> DiscoveryResult:
    """Add missing causes until no further one is likely.

    Where a formula follows the training clips and not all held-out ones, causes are sought again with these among the
    training clips; that result is used if fewer shots depart.

    Args:
        clip_set: every fifth clip is held out.
        model: the start; all its constants are fitted.
        show: called with the result so far, after each effect.
        error_rate: accepted probability that an added cause is due to chance, or different in every shot.
    """
    parts, _, model = split(clip_set, model)
    result = _discovered(parts, model, show, error_rate)
    while result.explained is not None and (other := exchanged(result.parts, result.explained)) is not None:
        again = _discovered(other, model, show, error_rate)
        few, before = (count_departing(one.explained or one.last) for one in (again, result))
        if few >= before:
            break
        result = again
    return result


def _discovered(parts: Split, model: Model, show: Show, error_rate: float) -> DiscoveryResult:
    """The same for clips that are split."""
    parts, at, now = fit_from_nothing(parts, model, searching=False)
    result = DiscoveryResult(parts, (now,), ((),), ())
    show(result)
    whole = Found(ByWholeShots(parts, now))
    if parts.training.is_long:
        windows = ByWindows(at, now)
        result, found = _searched(result, Found(windows), error_rate)
        if found.view is not windows:
            windows = found.view.settled()
            now = whole_shots(parts, windows.at, searching=False)
        if not parts.follows(now):
            return _ended(result, found, windows, lambda view: whole_shots(parts, view.at), now, error_rate)
        view = ByWholeShots(parts, now)
        whole = Found(view, found.verdict, found.formula, found.dropped)
        if found.verdict and found.formula is None:
            result = result.with_step(view.now, found.verdict, found.dropped)
            show(result)
    while True:
        result, whole = _searched(result, whole, error_rate, show)
        if whole.formula is None and whole.verdict != result.verdict:  # named effects may be dropped again
            result = result.with_step(whole.view.now, whole.verdict, whole.dropped)
        fewer = without_departing(result.parts, result.ladder) if whole.formula is None else None
        if fewer is None:
            return _ended(result, whole, whole.view, lambda view: view.now, whole.view.now, error_rate)
        result = dataclasses.replace(result, parts=fewer[0], ladder=fewer[1])
        whole = dataclasses.replace(whole, view=ByWholeShots(result.parts, result.last))
        show(result)


def _searched(
    result: DiscoveryResult, found: Found[V], error_rate: float, show: Show | None = None
) -> tuple[DiscoveryResult, Found[V]]:
    """Run a search; returns its outcome and the result with its rounds, and with its fits if these are shown."""
    now = found
    for now, seen in search(found, error_rate):
        result = dataclasses.replace(result, rounds=(*result.rounds, seen))
        if show is not None and seen.best is not None and now.formula is None:
            result = result.with_step(now.view.fitted, now.verdict, now.dropped)
            show(result)
    return result, now


def _ended(
    result: DiscoveryResult, found: Found[V], view: V, played: Callable[[V], FittedModel], now: FittedModel,
    error_rate: float,
) -> DiscoveryResult:  # fmt: skip
    """The result with the last fit, its unexplained structure, and the next shots.

    The model file holds named effects only; if there is a formula, the last fit is the one without it.

    Args:
        result: with the rounds of the search.
        found: outcome of the search.
        view: the last fit.
        played: whole shots with such a fit.
        now: those with the last.
        error_rate: probability of confusion below which the next shots are to bring it.
    """
    verdict, formula = found.verdict, found.formula
    plain = view if formula is None else view.without(EFFECT_NAME).settled()
    last = now if formula is None else played(plain)
    if verdict or result.verdict:  # named effects may be dropped again
        result = result.with_step(last, verdict, found.dropped)
    if formula is not None:
        seen = judged(plain.beside(view), view, unknowns_of_terms(formula.terms)).evidence
        described = describe(formula, now, seen)
        described |= {"rms_m": now.rms, "held_out_rms_m": now.held_rms, "chi2_reduced": now.chi2}
        described["left"] = remainder(now)  # with the formula
        result = dataclasses.replace(result, unexplained=described, explained=now)
    else:
        others = [one for one in candidates_for(last.model) if one.name not in result.refuted]
        losses = plain.linearised(at_sizes(others))
        stability = stability_of(plain.point, verdict, losses, plain.design_effect, error_rate)
        result = dataclasses.replace(result, unexplained=remainder(last), stability=stability)
    shots = propose_next(result.parts, result.last, result.rounds, result.verdict, error_rate)
    return dataclasses.replace(result, next_shots=shots)
