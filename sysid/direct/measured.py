"""The robust mean of many values of a constant, each from one segment or event.

In: `Single` values y_k +- s_k. Out: a `Measured`: mean, standard deviation, and warnings.

Values are taken to scatter by tau beyond their own errors (random effects). The mean, and tau, are Huber's: weights
1 / (s_k^2 + tau^2), reduced beyond 2.5 standard deviations, with tau such that the clipped squares sum to their
expectation for n values (proposal 2; without the clip it is the tau of Paule and Mandel). The same regression with
further columns shows whether values change with speed, or with the heading of the ball. Left out: that two values of
one clip may share an error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri, stdtr

from sysid.direct.slide_roll import Array

HUBER_SD = 2.5  # standard deviations beyond which a value counts less
EXPECTED_CLIPPED_SQUARE = 0.97756  # mean of min(z^2, HUBER_SD^2) of a normal z
OUTLIER_SD = 5.0  # standard deviations beyond which a value is left out
SIGNIFICANT_SD = 3.5  # least significance of a reported dependence
DISAGREEING_CHI2 = 3.0  # reduced chi-square from which the user is warned that values disagree
MIN_VALUES = 3  # with fewer values the user is warned
MIN_VALUES_FOR_SPEED, MIN_SPEED_RANGE_M_S = 6, 0.15  # fewest values and range that test a change with speed
MIN_VALUES_FOR_HEADING = 8  # fewest values to test a change with heading


@dataclass(frozen=True)
class Single:
    """A value of a constant, from one segment or event."""

    clip: str  # its file
    ball: str
    time: float  # [s]
    value: float
    sd: float  # one standard deviation
    speed: float = math.nan  # at which it holds [m/s]
    heading: float = math.nan  # of the ball [rad]
    slope: float = math.nan  # its change with speed inside this segment, per m/s
    slope_sd: float = math.nan


@dataclass(frozen=True)
class Kind:
    """The kind of a measurement: constant, method, units and remedy."""

    name: str  # of the constant in the model, or a description if the model has none
    unit: str
    of: str  # "segments", "rebounds", ...
    method: str  # in a few words
    remedy: str  # the clips that would determine it
    divisor: float = 1.0  # of the singles
    effect: str = ""  # the effect that a model needs if the constant changes with speed
    slope_unit: str = ""  # of the singles, per m/s
    headings: bool = False  # whether a change with the ball's heading is tested [m/s^2]


@dataclass(frozen=True)
class Measured:
    """A measured constant: value and standard deviation, None if the clips do not determine it."""

    kind: Kind
    value: float | None
    sd: float | None
    count: int = 0  # of the singles
    singles: tuple[Single, ...] = ()
    chi2: float = math.nan  # of the singles by their own errors, per degree of freedom
    scatter: float = math.nan  # tau: standard deviation of the singles beyond their own errors
    speed: float = math.nan  # at which the value holds [m/s]
    slope: float = math.nan  # change with speed [kind.slope_unit]
    slope_sd: float = math.nan
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True)
class Measurements:
    """All constants of a clip set."""

    clips: int
    noise: float  # of a position, per axis [m]
    spikes: int  # samples left out as outliers
    all: tuple[Measured, ...]


def significance(value: float, sd: float, freedom: int) -> float:
    """The normal deviate that is as unlikely as Student's t = value / sd with these degrees of freedom."""
    tail = float(stdtr(freedom, -abs(value) / sd)) if freedom > 0 and sd > 0 else 0.5
    return min(float(-ndtri(tail)), 99.0) if tail > 0 else 99.0


def regress(y: Array, s: Array, columns: Array) -> tuple[Array, Array, float]:
    """Robust regression of values y +- s (n,) on columns (n, p): coefficients (p,), their covariance, tau."""
    n, p = columns.shape

    def fit(tau: float) -> tuple[Array, Array, float]:
        value: Array
        plain = weight = 1.0 / (s**2 + tau**2)
        for _ in range(30):
            root = np.sqrt(weight)
            value = np.asarray(np.linalg.lstsq(columns * root[:, None], y * root, rcond=None)[0])
            z = np.abs(y - columns @ value) * np.sqrt(plain)
            before, weight = weight, plain * np.minimum(1.0, HUBER_SD / np.maximum(z, 1e-12))
            if np.allclose(before, weight, rtol=1e-6, atol=0.0):
                break
        return value, weight, float(np.sum(np.minimum(z, HUBER_SD) ** 2))

    tau, expected = 0.0, EXPECTED_CLIPPED_SQUARE * (n - p)
    value, weight, total = fit(tau)
    if n > p and total > expected:
        low, high = 0.0, float(np.ptp(y) + s.max())
        for _ in range(40):
            tau = 0.5 * (low + high)
            value, weight, total = fit(tau)
            low, high = (tau, high) if total > expected else (low, tau)
    return value, np.asarray(np.linalg.pinv(columns.T @ (columns * weight[:, None]))), tau


def combine(kind: Kind, singles: Sequence[Single], notes: Sequence[str] = ()) -> Measured:
    """The robust mean of many values, with warnings for the user."""
    if not singles:
        return Measured(kind, None, None, warnings=(f"not determined by these clips: {kind.remedy}", *notes))
    y, s = np.array([k.value for k in singles]), np.array([k.sd for k in singles])
    first, _, tau = regress(y, s, np.ones((len(y), 1)))
    near = np.abs(y - first[0]) <= OUTLIER_SD * np.hypot(s, tau)  # others are no such event, or have a wrong angle
    y, s, used = y[near], s[near], [k for k, good in zip(singles, near, strict=True) if good]
    n, ones, weight = len(y), np.ones((len(y), 1)), 1.0 / (s**2 + tau**2)
    v, heading = np.array([k.speed for k in used]), np.array([k.heading for k in used])
    seen = np.isfinite(v)
    middle = float(np.average(v[seen], weights=weight[seen])) if seen.any() else math.nan
    by_heading, by_speed = ones[:, :0], ones[:, :0]
    if kind.headings and n >= MIN_VALUES_FOR_HEADING:
        by_heading = np.column_stack([np.cos(heading), np.sin(heading)])
    between = bool(kind.effect) and seen.sum() >= MIN_VALUES_FOR_SPEED and np.ptp(v[seen]) > MIN_SPEED_RANGE_M_S
    if between:
        by_speed = np.where(seen, v - middle, 0.0)[:, None]
    columns = np.concatenate([ones, by_heading, by_speed], axis=1)
    value, cov, _ = regress(y, s, columns)
    freedom = n - columns.shape[1]
    warnings = [f"only {n} {kind.of if n > 1 else kind.of.removesuffix('s')}"] if n < MIN_VALUES else []
    slope, slope_sd, sds = _slope(used, [(float(value[-1]), math.sqrt(cov[-1, -1]), freedom)] if between else [])
    if by_heading.size:
        warning = _heading_warning(value[1:3], cov[1:3, 1:3], freedom)
        warnings += [warning] if warning else []
        by_heading = by_heading if warning else ones[:, :0]
    if sds > SIGNIFICANT_SD:
        warnings.append(
            f"varies with speed by {slope:+.2g} +- {slope_sd:.1g} {kind.slope_unit} ({sds:.0f} sd):"
            f" the fit should have {kind.effect}"
        )
    columns = np.concatenate([ones, by_heading, by_speed if sds > SIGNIFICANT_SD else ones[:, :0]], axis=1)
    value, cov, tau = regress(y, s, columns)
    freedom = n - columns.shape[1]
    plain = np.linalg.lstsq(columns / s[:, None], y / s, rcond=None)[0]
    chi2 = float(np.sum(((y - columns @ plain) / s) ** 2)) / freedom if freedom else math.nan
    if n > 2 and chi2 > DISAGREEING_CHI2:
        warnings.append(f"{kind.of} differ by more than their errors (chi2 {chi2:.1f}): the sd is increased")
    if n < len(singles):
        warnings.append(f"{len(singles) - n} of {len(singles)} {kind.of} are outliers and left out")
    mean, sd = float(value[0]) / kind.divisor, math.sqrt(cov[0, 0]) / kind.divisor
    figures = (chi2, tau / kind.divisor, middle, slope, slope_sd)
    return Measured(kind, mean, sd, n, tuple(used), *figures, (*warnings, *notes))


def _heading_warning(amplitude: Array, cov: Array, freedom: int) -> str | None:
    """A warning if values vary with the heading, with cosine and sine (2,); None if that is not significant."""
    size = float(np.hypot(*amplitude))
    sd = math.sqrt(amplitude @ cov @ amplitude) / size
    if significance(size, sd, freedom) <= SIGNIFICANT_SD + 0.5:  # the direction is free, too
        return None
    toward = math.degrees(math.atan2(-amplitude[1], -amplitude[0]))
    return (
        f"varies with heading by {size:.4f} +- {sd:.4f} m/s^2, balls are pushed towards {toward:.0f} deg:"
        " the fit should have table_tilt or cloth_nap"
    )


def _slope(singles: Sequence[Single], found: list[tuple[float, float, int]]) -> tuple[float, float, float]:
    """Change with speed, its sd, and their ratio, combined from changes between values and within segments."""
    inside = np.array([(k.slope, k.slope_sd) for k in singles if math.isfinite(k.slope_sd)]).reshape(-1, 2)
    if len(inside) >= MIN_VALUES:
        mean, cov, _ = regress(inside[:, 0], inside[:, 1], np.ones((len(inside), 1)))
        found = [*found, (float(mean[0]), math.sqrt(cov[0, 0]), len(inside) - 1)]
    if not found:
        return math.nan, math.nan, 0.0
    weight = np.array([sd**-2.0 for _, sd, _ in found])
    value, sd = float(np.average([b for b, _, _ in found], weights=weight)), float(weight.sum() ** -0.5)
    return value, sd, significance(value, sd, sum(freedom for *_, freedom in found))
