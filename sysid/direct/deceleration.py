"""Constant deceleration of a path length, or of an angle, to a stop.

In: samples of the path length or angle. Out: a `Deceleration`: s = s0 + v t - 1/2 a t^2 until the stop, and how a
changes with speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from sysid.direct.slide_roll import Array

MIN_MOVING_SAMPLES = 6  # fewest samples for a deceleration
MIN_PATH_M = 0.05  # shortest path
MAX_ITERATIONS = 40


@dataclass(frozen=True)
class Deceleration:
    """The fitted deceleration of a path length [m] or an angle [rad]."""

    speed: float  # at the first sample
    rate: float  # of the deceleration
    sd: float
    at: float  # speed at which the rate holds
    slope: float  # of the rate with speed
    slope_sd: float
    chi2: float  # reduced, that slope included; 1 where the noise was not given


def fit_deceleration(t: Array, s: Array, sigma: float | None, tolerance: float) -> Deceleration | None:
    """Fit a path length or angle s (n,) at t (n,) [s] by Gauss-Newton steps; None where it does not decelerate.

    Args:
        t: times [s].
        s: path length [m], or angle [rad].
        sigma: its noise; None to take that of the residuals.
        tolerance: distance from the last value within which the ball may be at rest.
    """
    t = t - t[0]
    moving = np.flatnonzero(np.abs(s - np.median(s[-5:])) > tolerance)
    n = int(moving[-1]) + 1 if moving.size else 0
    if n < MIN_MOVING_SAMPLES:
        return None
    half, v, s0 = (float(k) for k in np.polyfit(t[:n], s[:n], 2))
    a = max(-2 * half, 0.02 * abs(v) / float(t[n - 1]))
    for _ in range(MAX_ITERATIONS):
        if not v > 0:
            return None
        u = np.minimum(t, v / a)  # time in motion; at its end the velocity is 0, so that the end adds no derivative
        residual = s - (s0 + v * u - 0.5 * a * u**2)
        columns = np.column_stack([np.ones_like(u), u, -0.5 * u**2, a * u**3 / 6 - v * u**2 / 2])
        step = np.linalg.lstsq(columns[:, :3], residual, rcond=None)[0]
        step *= min(1.0, 0.5 * a / max(abs(step[2]), 1e-12))
        s0, v, a = s0 + float(step[0]), v + float(step[1]), a + float(step[2])
        if abs(step[2]) < 1e-7 * a:
            break
    if a * t[-1] < 1e-3 * v:
        return None
    more = np.linalg.lstsq(columns, residual, rcond=None)[0]
    square = float(np.sum((residual - columns @ more) ** 2)) / max(len(t) - 4, 1)
    chi2 = 1.0 if sigma is None else square / sigma**2
    noise = square if sigma is None else max(square, sigma**2)
    three, four = (np.linalg.pinv(columns[:, :k].T @ columns[:, :k]) * noise for k in (3, 4))
    at = -float(four[2, 3] / four[3, 3])
    return Deceleration(v, a, math.sqrt(three[2, 2]), at, float(more[3]), math.sqrt(four[3, 3]), chi2)


def path_length(xy: Array) -> tuple[Array, float] | None:
    """Path length along a smooth path (n, 2): (n,) [m], and its heading [rad]; None if it is short."""
    chord = xy[-1] - xy[0]
    length = math.hypot(*chord)
    if length < MIN_PATH_M:
        return None
    e = chord / length
    x, y = (xy - xy[0]) @ e, (xy - xy[0]) @ np.array([-e[1], e[0]])
    grid = np.linspace(x.min(), x.max(), 400)
    pace = np.hypot(1.0, np.polynomial.Polynomial.fit(x, y, 3).deriv()(grid))
    total = np.concatenate([[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * np.diff(grid))])
    return np.interp(x, grid, total), math.atan2(e[1], e[0])
