"""A slide and the roll after it, fitted to the positions of one ball.

In: samples of a segment and the noise per axis. Out: a `SlideRoll`: parameters and their covariance.

    sliding  r = r0 + v0 t + 1/2 (d / T) t^2   until T = |d| / (mu_s g),
    rolling  even deceleration mu_r g along the path until the ball stops.

d is the change of velocity while sliding, -2/7 of the slip at the start. A constant acceleration across the path while
rolling is fitted, too: the slope of the table, or the nap.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.clips.segments import Segment

Array = NDArray[np.float64]
ParameterPrior = tuple[Array, Array]  # mean and sd (9,) of the parameters: inf if unknown, 0 if held

# Parameters: r0 (2) [m], v0 (2) [m/s], d (2) [m/s], ln(mu_s g), ln(mu_r g), acceleration across the path [m/s^2].
LN_SLIDE, LN_ROLL = 6, 7
WIDE_PRIOR: ParameterPrior = (
    np.array([0, 0, 0, 0, 0, 0, math.log(2.0), math.log(0.12), 0.0]),
    np.array([np.inf, np.inf, np.inf, np.inf, 3.0, 3.0, 1.0, 0.7, 0.03]),
)
DIFFERENCE_STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5, 1e-5, 1e-5, 1e-4, 1e-4, 1e-5])  # for derivatives
FIRST_SPAN_S = 0.8  # beginning of a segment that is searched for a slide first
TRIED_SLIDE_SHARES = np.array([0.03, 0.06, 0.12, 0.2, 0.3, 0.45, 0.7, 1.0])  # durations of a slide over the time seen
MAX_FIT_STEPS = 60
MAX_LOG_STEP = 0.7  # longest step of the logarithms of the frictions


def positions(p: Array, t: Array) -> Array:
    """Positions (k, n, 2) [m] at times t (n,) [s] of balls with parameters p (k, 9) that start at t = 0."""
    r0, v0, d = p[:, None, 0:2], p[:, None, 2:4], p[:, None, 4:6]
    slide, roll, across = np.exp(p[:, 6:7]), np.exp(p[:, 7:8]), p[:, 8:9, None]
    size = np.sqrt(np.sum(d**2, axis=2) + 1e-18)
    last = size / slide
    a = np.minimum(t[None], last)[..., None]
    w = v0 + d
    speed = np.sqrt(np.sum(w**2, axis=2) + 1e-18)
    unit = w / speed[..., None]
    normal = np.stack([-unit[..., 1], unit[..., 0]], axis=2)
    b = np.clip(t[None] - last, 0.0, speed / roll)[..., None]
    slid = v0 * a + 0.5 * a**2 * (slide / size)[..., None] * d
    return np.asarray(
        r0 + slid + unit * (speed[..., None] * b - 0.5 * roll[..., None] * b**2) + 0.5 * across * b**2 * normal
    )


@dataclass(frozen=True)
class SlideRoll:
    """A slide and a roll fitted to one ball's samples."""

    parameters: Array  # (9,)
    covariance: Array  # (9, 9), widened where the model does not fit
    chi2: float  # reduced

    def state(self, t: float) -> tuple[Array, Array]:
        """Position and velocity (4,) and their covariance (4, 4) at a time after the start [s]."""
        h, steps, p = 1e-5, DIFFERENCE_STEPS, self.parameters
        around = np.concatenate([p[None], p + np.diag(steps), p - np.diag(steps)])
        at = positions(around, np.array([t - h, t, t + h]))
        both = np.concatenate([at[:, 1], (at[:, 2] - at[:, 0]) / (2 * h)], axis=1)
        jacobian = ((both[1:10] - both[10:]) / (2 * steps[:, None])).T
        return both[0], jacobian @ self.covariance @ jacobian.T

    def slide_duration(self) -> tuple[float, float]:
        """Duration of the slide and its sd [s]."""
        d, a = self.parameters[4:6], math.exp(self.parameters[LN_SLIDE])
        size = math.hypot(*d)
        jacobian = np.array([*(d / max(size, 1e-9) / a), -size / a])
        return size / a, math.sqrt(jacobian @ self.covariance[4:7, 4:7] @ jacobian)


def fit_slide_roll(t: Array, xy: Array, sigma: float, prior: ParameterPrior = WIDE_PRIOR) -> SlideRoll:
    """The slide and roll through samples xy (n, 2) +- sigma [m] at t (n,) [s] after the start, by least squares."""
    mean, sd = prior
    free = sd > 0
    known = free & np.isfinite(sd)
    scale = np.where(known, sd, 1.0)

    def residual(p: Array) -> Array:
        return np.concatenate([((xy - positions(p[None], t)[0]) / sigma).ravel(), ((mean - p) / scale)[known]])

    def jacobian(p: Array) -> Array:
        at = positions(np.concatenate([p + np.diag(DIFFERENCE_STEPS), p - np.diag(DIFFERENCE_STEPS)]), t)
        data = (at[:9] - at[9:]).reshape(9, -1).T / (2 * DIFFERENCE_STEPS * sigma)
        return np.concatenate([data, (np.eye(9) / scale[:, None])[known]])[:, free]

    best, lowest = mean, math.inf
    for p in _starts(t, xy, mean, sd):
        r, damping = residual(p), 1e-3
        for _ in range(MAX_FIT_STEPS):  # Levenberg-Marquardt
            j = jacobian(p)
            square = j.T @ j
            step = np.zeros(9)
            step[free] = np.linalg.solve(square + damping * np.diag(np.diag(square)), j.T @ r)
            step[6:8] = np.clip(step[6:8], -MAX_LOG_STEP, MAX_LOG_STEP)
            new = residual(p + step)
            improvement = float(r @ r) - float(new @ new)
            if improvement > 0:
                p, r, damping = p + step, new, damping / 5
            else:
                damping *= 8
            if 0 <= improvement < 1e-6 * (1 + float(r @ r)) or damping > 1e8:
                break
        if float(r @ r) < lowest:
            best, lowest = p, float(r @ r)
    j = jacobian(best)
    covariance = np.zeros((9, 9))
    covariance[np.ix_(free, free)] = np.linalg.pinv(j.T @ j)
    total = float(np.sum((xy - positions(best[None], t)[0]) ** 2)) / sigma**2
    chi2 = total / max(xy.size - int(np.sum(free & ~known)) - 2, 1)
    return SlideRoll(best, covariance * max(chi2, 1.0), chi2)


def _starts(t: Array, xy: Array, mean: Array, sd: Array) -> list[Array]:
    """Start values: no slide, and the best two of several durations."""
    line = np.column_stack([np.ones_like(t), t])
    none = mean.copy()
    none[:2], none[2:4] = np.linalg.lstsq(line, xy, rcond=None)[0]
    if sd[4] == 0:
        return [none]
    none[4:6] = -1e-3 * none[2:4]
    found = []
    for last in TRIED_SLIDE_SHARES * t[-1]:
        early, late = np.minimum(t, last), np.maximum(t - last, 0.0)
        columns = np.column_stack([line, early * (t - early / 2), late**2 / 2])
        value = np.linalg.lstsq(columns, xy, rcond=None)[0]
        p = mean.copy()
        p[:2], p[2:4], p[4:6] = value[0], value[1], value[2] * last
        if sd[LN_SLIDE] > 0.5:
            p[LN_SLIDE] = math.log(min(max(float(np.hypot(*value[2])), 0.5), 6.0))
        found.append((float(np.sum((xy - positions(p[None], t)[0]) ** 2)), p))
    found.sort(key=lambda f: f[0])
    return [none, found[0][1], found[1][1]]


@dataclass(frozen=True)
class SegmentMotion:
    """A segment, the slide and roll at its beginning, and the time from which the ball rolls."""

    segment: Segment
    fit: SlideRoll
    rolls: float  # [s], as in the segment; inf where it may slide to the end


def segment_motions(segments: Sequence[Segment], sigma: float, frame: float) -> list[SegmentMotion]:
    """Fit slide and roll to the beginning of each segment; noise [m] and frame interval [s]."""
    found = []
    for s in segments:
        if s.before == "strike":  # its first sample may still be at rest, with a time nearer to the strike
            s = dataclasses.replace(s, time=s.time[1:], xy=s.xy[1:])
        t = s.time - s.time[0]
        span = max(FIRST_SPAN_S, float(t[min(len(t) - 1, 12)]))
        while True:
            use = t <= span
            fit = fit_slide_roll(t[use], s.xy[use], sigma)
            last, sd = fit.slide_duration()
            if last + 3 * sd < 0.6 * span or use.all():
                break
            span *= 2
        since = last + 3 * sd + frame
        found.append(SegmentMotion(s, fit, float(s.time[0]) + since if since < t[-1] else math.inf))
    return found
