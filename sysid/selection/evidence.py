"""One fit against another, and what a fit leaves beyond noise.

Two fits are compared at the same standard deviations, those of the better one, with the evidence discounted for
residuals that hang together.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import loss_soon
from sysid.estimation.initial_states import fit_states, shot_losses

LACKING_LOSS = 1.5  # times the loss that a few steps without an effect may leave, if it is to be doubted
MAX_LAG = 40  # samples over which residuals may hang together
LEAST_CORRELATION = 0.02  # at which they no longer do
CLIPPED_SD = 4.0  # as which larger residuals count in what is left
COMPARED_STEPS = 5  # of the initial states before two fits are compared


@dataclass(frozen=True)
class Evidence:
    """One fit against another."""

    delta_bic: float  # positive speaks for the second
    gain: float  # fall of the loss, doubled: of chi-square
    tau: float  # samples that count as one


def compare_fits(one: Point, two: Point, by: Point | None = None, tau: float | None = None) -> Evidence:
    """Evidence for `two` over `one`, at the same standard deviations and priors: those of `by`, or of the better one.

    `tau`: samples that count as one; found from the better one's residuals if not given.
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
        tau = correlation_time(better, rate) * spread
    more = two.constants.size - one.constants.size
    return Evidence((a - b) / tau - more * float(np.log(max(count / tau, 2))), a - b, tau)


def _chi2_of_known(at: Point) -> float:
    """Chi-square of constants against what is known of them beside the clips; an absent one stands at off."""
    values, total = dict(zip(at.names, at.constants.tolist(), strict=True)), 0.0
    for name, (mean, sd) in at.problem.known.items():
        value = values[name] if name in values else at.model.meta(name)["off"]
        total += ((value - mean) / sd) ** 2
    return float(total)


def correlation_time(at: Point, rate: float) -> float:
    """Samples that count as one, since residuals hang together: integrated autocorrelation, 1 for white noise."""
    r = at.residuals(at.problem.with_discrepancy(rate))
    found, weight = np.zeros(MAX_LAG), np.zeros(MAX_LAG)
    for _, _, xy in at.problem.by_ball(r):
        n = len(xy)
        for v in np.nan_to_num(np.clip(xy, -CLIPPED_SD, CLIPPED_SD)).T:
            for lag in range(min(MAX_LAG, n)):
                found[lag] += float(v[: n - lag] @ v[lag:])
                weight[lag] += n - lag
    rho = found / np.maximum(weight, 1)
    rho = rho / max(rho[0], 1e-12)
    negative = np.flatnonzero(rho < LEAST_CORRELATION)
    stop = int(negative[0]) if negative.size else MAX_LAG
    return float(max(1.0, 1.0 + 2.0 * rho[1:stop].sum()))


def left_over(at: Point) -> float:
    """What the residuals hold beyond noise: mean square of the clipped residuals over that of the noise, less one."""
    r = at.residuals()
    unknowns = sum(5 + 2 * len(clip.balls) for clip in at.problem.clips) + at.constants.size
    part = 1.0 - unknowns / max(int(np.isfinite(r).sum()), 1)
    return float(np.nanmean(np.minimum(r**2, CLIPPED_SD**2))) / part - 1.0


def taken_out(found: FittedModel, name: str) -> FittedModel:
    """What is left of a fit when an effect goes, nothing fitted."""
    keep = np.array([not n.startswith(name + ".") for n in found.names])
    model = found.problem.model
    model = dataclasses.replace(model, effects=tuple(e for e in model.effects if e.name() != name))
    problem = found.problem.with_model(model, [n for n, k in zip(found.names, keep, strict=True) if k])
    covariance = found.covariance[np.ix_(keep, keep)]
    return dataclasses.replace(found, problem=problem, constants=found.constants[keep], covariance=covariance)


def loss_without(found: FittedModel, name: str) -> float:
    """How many times the loss is larger a few steps after an effect was taken out."""
    point = taken_out(found, name)
    soon = loss_soon(point.weighted, point.initial_states, point.constants)
    return soon / float(shot_losses(found.weighted, found.initial_states, found.constants)[0].sum())
