"""Evidence for one fit over another, and the variance that a fit leaves beyond noise.

In: fits (`FittedModel`, or `Point`). Out: `Evidence`, and ratios of losses and variances.

Both fits are compared at the same standard deviations, those of the better one. Residuals are correlated, so chi-square
counts one in tau of them, the integrated autocorrelation time:
delta BIC = (fall of chi-square) / tau - (constants more) log(residuals / tau).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import loss_soon
from sysid.estimation.initial_states import fit_states, shot_losses

MAX_LOSS_RATIO = 1.5  # of the loss a few iterations after an effect was removed, if the effect is to be doubted
MAX_LAG = 40  # samples, of the autocorrelation
MIN_CORRELATION = 0.02  # at which the sum of the autocorrelation stops
MAX_RESIDUAL_SD = 4.0  # at which residuals are clipped
COMPARED_STEPS = 5  # iterations of the initial states before two fits are compared


@dataclass(frozen=True)
class Evidence:
    """Evidence for a fit over another."""

    delta_bic: float  # positive speaks for the second
    improvement: float  # fall of chi-square
    tau: float  # integrated autocorrelation time of the residuals [samples]


def compare_fits(one: Point, two: Point, by: Point | None = None, tau: float | None = None) -> Evidence:
    """Evidence for `two` over `one`, at the same standard deviations and priors: those of `by`, or of the better one.

    `tau`: autocorrelation time [samples]; computed from the better one's residuals if not given.
    """
    by = min((one, two), key=lambda s: s.discrepancy_rate) if by is None else by
    rate = by.discrepancy_rate

    def cost(at: Point) -> tuple[float, int]:
        seen = dataclasses.replace(at.problem, prior=by.problem.prior).with_discrepancy(rate)
        x = fit_states(seen, at.initial_states, at.constants, COMPARED_STEPS)
        total, count = shot_losses(seen, x, at.constants)
        return 2 * float(total.sum()) + _chi2_of_known(at), int(count.sum())

    (a, count), (b, _) = cost(one), cost(two)
    if tau is None:
        better = two if b < a else one
        r = better.residuals(better.problem.with_discrepancy(rate))
        spread = max(1.0, (float(np.nanmedian(np.abs(r))) / 0.6745) ** 2)
        tau = max(correlation_time(better, rate), better.problem.correlation_time) * spread
    more = two.constants.size - one.constants.size
    return Evidence((a - b) / tau - more * float(np.log(max(count / tau, 2))), a - b, tau)


def _chi2_of_known(at: Point) -> float:
    """Chi-square of constants against prior knowledge of them; one that the model lacks counts at its off value.

    Sizes, which segments lack in both fits that are compared, have none and count nothing.
    """
    values, total = dict(zip(at.names, at.constants.tolist(), strict=True)), 0.0
    for name, (mean, sd) in at.problem.known.items():
        value = values[name] if name in values else at.model.meta(name)["off"]
        total += 0.0 if value is None else ((value - mean) / sd) ** 2
    return float(total)


def correlation_time(at: Point, rate: float) -> float:
    """Integrated autocorrelation time of the residuals [samples]: 1 for white noise."""
    r = at.residuals(at.problem.with_discrepancy(rate))
    found, weight = np.zeros(MAX_LAG), np.zeros(MAX_LAG)
    for _, _, xy in at.problem.by_ball(r):
        n = len(xy)
        for v in np.nan_to_num(np.clip(xy, -MAX_RESIDUAL_SD, MAX_RESIDUAL_SD)).T:
            for lag in range(min(MAX_LAG, n)):
                found[lag] += float(v[: n - lag] @ v[lag:])
                weight[lag] += n - lag
    rho = found / np.maximum(weight, 1)
    rho = rho / max(rho[0], 1e-12)
    negative = np.flatnonzero(rho < MIN_CORRELATION)
    stop = int(negative[0]) if negative.size else MAX_LAG
    return float(max(1.0, 1.0 + 2.0 * rho[1:stop].sum()))


def excess_variance(at: Point) -> float:
    """Variance of the clipped residuals over that of the noise, less one: 0 for a fit that leaves only noise."""
    r = at.residuals()
    unknowns = sum(5 + 2 * len(clip.balls) for clip in at.problem.clips) + at.constants.size
    part = 1.0 - unknowns / max(int(np.isfinite(r).sum()), 1)
    return float(np.nanmean(np.minimum(r**2, MAX_RESIDUAL_SD**2))) / part - 1.0


def remove_effect(found: FittedModel, name: str) -> FittedModel:
    """The fit without an effect and its constants; nothing is fitted again."""
    keep = np.array([not n.startswith(name + ".") for n in found.names])
    model = found.problem.model
    model = dataclasses.replace(model, effects=tuple(e for e in model.effects if e.name() != name))
    problem = found.problem.with_model(model, [n for n, k in zip(found.names, keep, strict=True) if k])
    covariance = found.covariance[np.ix_(keep, keep)]
    return dataclasses.replace(found, problem=problem, constants=found.constants[keep], covariance=covariance)


def loss_ratio_without(found: FittedModel, name: str) -> float:
    """Loss a few iterations after an effect was removed, over the loss with it."""
    point = remove_effect(found, name)
    soon = loss_soon(point.weighted, point.initial_states, point.constants)
    return soon / float(shot_losses(found.weighted, found.initial_states, found.constants)[0].sum())
