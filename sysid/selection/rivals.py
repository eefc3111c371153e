"""Rival causes, judged one by one against a fit without them, compared with each other.

In: `Judged` causes. Out: the same, the likeliest first.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Iterator, Sequence

from sysid.selection.formulas.formula import SEPARATED_LOG_ODDS
from sysid.selection.judgement import Judged, V, likelier
from sysid.selection.screening import FittedCandidate

log = logging.getLogger(__name__)


def ranked(good: Sequence[tuple[FittedCandidate, Judged[V]]]) -> list[tuple[FittedCandidate, Judged[V]]]:
    """Fitted effects, the likeliest first, with their evidence; clearly inferior ones come last."""
    found = list[tuple[FittedCandidate, Judged[V]]]()
    for k, at, more in likeliest_first([at for _, at in good], [0] * len(good)):
        first = max((at for _, at in good), key=lambda at: at.in_all)
        bic = first.evidence.delta_bic + 2.0 * more
        seen = dataclasses.replace(at.evidence, log_odds=first.log_odds + more, delta_bic=bic)
        found.append((dataclasses.replace(good[k][0], fitted=at.view.fitted, evidence=seen), at))
    return found


def likeliest_first(good: Sequence[Judged[V]], variables: Sequence[int]) -> list[tuple[int, Judged[V], float]]:
    """Rival causes, the likeliest first; clearly inferior ones come last.

    Each was judged against a fit without it that began from its own initial states: they are compared with each other.
    The errors of the model that lacks them all hide how they differ, so that those that these do not separate are
    compared again at the errors of the best. Of causes that the shots do not separate, the one with the fewest
    variables comes first, then the one with the fewest parameters.

    Args:
        good: the judged causes.
        variables: number of variables that each depends on.

    Returns:
        The place of each in `good`, its evidence, and its log odds over the one with the most evidence against nothing.
    """
    if not good:
        return []
    fits = list(_compared(max(good, key=lambda at: at.in_all), good))
    k = max(range(len(good)), key=lambda k: fits[k][1])
    at, most = fits[k]
    best = dataclasses.replace(at, view=at.view.renewed())
    alike = [n for n in range(len(good)) if n != k and fits[n][1] > most - SEPARATED_LOG_ODDS]
    fits[k] = best, most
    for n, (at, more) in zip(alike, _compared(best, [fits[n][0] for n in alike]), strict=True):
        fits[n] = at, most + more
    top = max(more for _, more in fits)

    def rank(k: int) -> tuple[bool, int, int, float]:
        at, more = fits[k]
        separated = more <= top - SEPARATED_LOG_ODDS
        return separated, 0 if separated else variables[k], 0 if separated else len(at.unknowns), -more

    order = sorted(range(len(good)), key=rank)
    at, more = fits[order[0]]
    if at is not best:
        fits[order[0]] = dataclasses.replace(at, view=at.view.renewed()), more
    return [(k, *fits[k]) for k in order]


def _compared(first: Judged[V], rivals: Sequence[Judged[V]]) -> Iterator[tuple[Judged[V], float]]:
    """Rivals at the errors of a fitted cause, and their log odds over it."""
    for one in rivals:
        if one is first:
            yield first, 0.0
        else:
            at = dataclasses.replace(one, view=one.view.beside(first.view))
            more = likelier(first.view, first.unknowns, at.view, at.unknowns) + min(at.held, 0.0) - min(first.held, 0.0)
            log.info("%s over %s: log odds %.1f", at.names, first.names, more)
            yield at, more
