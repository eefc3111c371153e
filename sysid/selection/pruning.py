"""Effects that a fit does not need: they may have been named beside a fit in a false optimum.

In: clips (`Split`), their fit and its named effects. Out: the fit without those that are not needed, and the others.

Beside much that is not explained, any effect explains a little: it fits some part of what is missing. So one whose part
is small is not named there, even if its evidence alone would suffice; nor one on whose size the clips do not agree,
whose shape they do not determine at all, that follows held-out clips worse once the others are pruned, or with which
the fit no longer converges then.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from sysid.estimation.fitted import FittedModel
from sysid.estimation.split import Split, fit_on
from sysid.selection.evidence import (
    MAX_LOSS_RATIO,
    compare_fits,
    excess_variance,
    generalises,
    loss_ratio_without,
    remove_effect,
)
from sysid.selection.score import score_all
from sysid.selection.screening import MIN_DELTA_BIC, candidates_for, fit_candidate, ranking, warm_started

MIN_SHARE_OF_EXCESS = 0.02  # of the variance beyond noise, that an effect must explain where most is not explained
MIN_DISTANCE_SD = 3.0  # standard deviations of an effect that is named there from where it vanishes
log = logging.getLogger(__name__)
Pruned = tuple[FittedModel, tuple[str, ...]]  # a fit, and the effects that are named in it


def fit_without(parts: Split, found: FittedModel, name: str) -> FittedModel:
    """Fit again without an effect."""
    plain = fit_on(parts, remove_effect(found, name), found, f"without {name}")
    return warm_started(parts, plain, found, f"without {name}") or plain


def without_needless(parts: Split, now: FittedModel, verdict: tuple[str, ...], least: int = 1) -> Pruned:
    """The fit without those of the named effects whose evidence, beside the others, is gone; at least so many stay."""
    while len(verdict) > least:
        log.info("whether all of them are needed")
        name, ratio = _least_needed(now, verdict)
        if ratio > MAX_LOSS_RATIO:
            break
        less = fit_without(parts, now, name)
        if compare_fits(less, now).delta_bic > MIN_DELTA_BIC:
            break
        log.info("%s is not needed", name)
        now, verdict = less, _others(verdict, name)
    return now, verdict


def exchanged(parts: Split, now: FittedModel, verdict: tuple[str, ...], pairs: Sequence[tuple[str, str]]) -> Pruned:
    """The fit with another effect in place of a named one, where that ranks higher, or makes a third superfluous.

    Beside what was not explained yet, the clips may not have told them apart; and two effects may share what a single
    one explains.

    Args:
        parts: clips.
        now: their fit.
        verdict: the effects that are named in it.
        pairs: effects that the clips did not tell apart.
    """
    others = [(one, two) for a, b in pairs for one, two in ((a, b), (b, a)) if one in verdict and two not in verdict]
    for name, other in others:
        rest = remove_effect(now, name)
        rows = score_all(rest, [one for one in candidates_for(rest.model) if one.name == other]).rows
        if not rows:
            continue
        log.info("whether %s in place of %s explains more", other, name)
        swapped = fit_candidate(parts, rest, rows[0]).fitted
        swapped, kept = without_needless(parts, swapped, (*_others(verdict, name), other))
        rivals = [(0.0, now.constants.size, now.converged)]
        rivals.append((compare_fits(now, swapped).delta_bic, swapped.constants.size, swapped.converged))
        if ranking(rivals)[0] and generalises(now, swapped):
            return swapped, kept
    return now, verdict


def without_minor(parts: Split, now: FittedModel, verdict: tuple[str, ...]) -> Pruned:
    """The fit without those of the named effects that explain little of what is still unexplained, or not held out."""
    while verdict:
        name, _ = _least_needed(now, verdict)
        less = fit_without(parts, now, name)
        before, after = excess_variance(less), excess_variance(now)
        if before - after > MIN_SHARE_OF_EXCESS * before and generalises(less, now):
            break
        log.info("%s explains %.1f %% of what is unexplained", name, 100 * max(1 - after / before, 0.0))
        now, verdict = less, _others(verdict, name)
    return now, verdict


def without_unclear(parts: Split, now: FittedModel, verdict: tuple[str, ...]) -> Pruned:
    """The fit without those of the named effects that are undetermined or minor, judged anew after each that goes."""
    before = None
    while verdict != before:
        before = verdict
        now, verdict = without_minor(parts, *without_undetermined(parts, now, verdict))
    return now, verdict


def without_undetermined(parts: Split, now: FittedModel, verdict: tuple[str, ...]) -> Pruned:
    """The fit without those of the named effects whose size is within its own uncertainty over the clips."""
    while verdict and now.converged:
        distances = [distance_from_absence(now, name) for name in verdict]
        k = int(np.argmin(distances))
        if distances[k] >= MIN_DISTANCE_SD:
            break
        log.info("%s is %.1f standard deviations from none", verdict[k], distances[k])
        now, verdict = fit_without(parts, now, verdict[k]), _others(verdict, verdict[k])
    return now, verdict


def without_unsettled(parts: Split, now: FittedModel, verdict: tuple[str, ...]) -> Pruned:
    """The fit without the least needed of several effects where it converges so, and with it does not.

    A fit that does not converge gives no uncertainty, not even of the effects that are needed.
    """
    if now.converged or len(verdict) < 2:
        return now, verdict
    name, _ = _least_needed(now, verdict)
    less = fit_without(parts, now, name)
    if not less.converged:
        return now, verdict
    log.info("with %s the fit does not converge", name)
    return less, _others(verdict, name)


def distance_from_absence(found: FittedModel, name: str) -> float:
    """How far an effect is from where it vanishes, see `size_in_sd`; 0 where the clips do not determine its shape.

    A patch that may lie anywhere is any difference between two motions.
    """
    own = [n for n in found.names if n.startswith(name + ".")]
    shape, known = [n for n in own if found.model.meta(n)["off"] is None], _known(found)
    return 0.0 if shape and not known.intersection(shape) else size_in_sd(found, name)


def _known(found: FittedModel) -> set[str]:
    """Constants whose standard deviation is known."""
    return {n for n, variance in zip(found.names, np.diag(found.covariance), strict=True) if np.isfinite(variance)}


def size_in_sd(found: FittedModel, name: str) -> float:
    """How far the parameters of an effect are from where it vanishes [standard deviations]; inf where none is known.

    The root of Wald's statistic, less what chance adds to it where there are several parameters.
    """
    off, known = {n: found.model.meta(n)["off"] for n in found.names if n.startswith(name + ".")}, _known(found)
    rows = [k for k, n in enumerate(found.names) if off.get(n) is not None and n in known]
    if not rows:
        return float("inf")
    away = found.constants[rows] - np.array([off[found.names[k]] for k in rows])
    wald = float(away @ np.linalg.pinv(found.covariance[np.ix_(rows, rows)], hermitian=True) @ away)
    return float(np.sqrt(max(wald - (len(rows) - 1), 0.0)))


def _least_needed(now: FittedModel, verdict: tuple[str, ...]) -> tuple[str, float]:
    """The named effect whose removal raises the loss least, and the ratio of the losses."""
    ratios = [loss_ratio_without(now, name) for name in verdict]
    k = int(np.argmin(ratios))
    return verdict[k], ratios[k]


def _others(verdict: tuple[str, ...], name: str) -> tuple[str, ...]:
    return tuple(v for v in verdict if v != name)
