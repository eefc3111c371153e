"""Evidence for one fit over another, and the variance beyond noise of a fit.

In: fits (`FittedModel`, or `Point`). Out: `Evidence`, and ratios of losses and variances.

Each fit has its own most likely discrepancies, so that likelihoods are compared. Residuals are correlated, so one in
tau of them counts, with tau the integrated autocorrelation time:
delta BIC = 2 (gain of log likelihood) / tau - (constants more) log(residuals / tau).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from sysid.clips.tracker.correlation import integrated_time
from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.problem import Array
from sysid.estimation.states.initial_states import fit_states, weighed_scores

MAX_LAG = 40  # largest lag of the autocorrelation [samples]
MIN_CORRELATION = 0.02  # correlation at which the sum of the autocorrelation stops
MAX_RESIDUAL_SD = 4.0  # clip limit of residuals
COMPARED_STEPS = 5  # iterations of the initial states before two fits are compared


@dataclass(frozen=True)
class Evidence:
    """Evidence for a fit over another."""

    delta_bic: float  # positive values favour the second
    improvement: float  # twice the gain of log likelihood
    tau: float  # number of residuals that count as an independent one
    log_odds: float = 0.0  # of the second over the first, by their marginal likelihoods


def compared_losses(one: Point, two: Point) -> tuple[Array, Array]:
    """Losses of the shots (n,) about two fits, each at its most likely discrepancies, with the better one's priors."""
    by = min((one, two), key=lambda s: s.discrepancy_rate)

    def cost(at: Point) -> Array:
        seen = dataclasses.replace(at.problem, prior=by.problem.prior)
        x = fit_states(seen.with_discrepancy(at.discrepancy_rate), at.initial_states, at.constants, COMPARED_STEPS)
        return weighed_scores(seen, x, at.constants, at.discrepancy_rate)[0]

    return cost(one), cost(two)


def counted_as_one(at: Point) -> float:
    """Number of residuals of a fit that count as an independent one of the expected size."""
    r = at.residuals(at.weighted)
    spread = max(1.0, (float(np.nanmedian(np.abs(r))) / 0.6745) ** 2)
    return max(correlation_time(at, at.discrepancy_rate), at.problem.correlation_time) * spread


def mean_squares(r: Array, limit: float = math.inf) -> tuple[Array, Array]:
    """Mean square of each shot's residuals (n, m), clipped at `limit`, and their number: (n,), (n,)."""
    counts = np.isfinite(r).sum(axis=1)
    return np.nansum(np.minimum(r**2, limit**2), axis=1) / np.maximum(counts, 1), counts


def chi2_of_known(at: Point) -> float:
    """Chi-square of constants against their priors; a constant that the model lacks counts at its off value.

    Sizes, which segments lack in both compared fits, are ignored.
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
    return integrated_time(rho / max(rho[0], 1e-12), MIN_CORRELATION)


def excess_variance(at: Point) -> float:
    """Variance of the clipped residuals over that of the noise, minus one: 0 if only noise is left."""
    r = at.residuals()
    unknowns = sum(5 + 2 * len(clip.balls) for clip in at.problem.clips) + at.constants.size
    part = 1.0 - unknowns / max(int(np.isfinite(r).sum()), 1)
    return float(np.nanmean(np.minimum(r**2, MAX_RESIDUAL_SD**2))) / part - 1.0


def remove_effect(found: FittedModel, name: str) -> FittedModel:
    """The fit without an effect and its constants; nothing is fitted again."""
    keep = np.array([not n.startswith(name + ".") for n in found.names])
    names = [n for n, k in zip(found.names, keep, strict=True) if k]
    problem = found.problem.with_model(found.problem.model.without(name), names)
    covariance = found.covariance[np.ix_(keep, keep)]
    return dataclasses.replace(found, problem=problem, constants=found.constants[keep], covariance=covariance)
