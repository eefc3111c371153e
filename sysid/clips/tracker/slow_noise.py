"""Slow noise of a tracker: deviations of its tracks from smooth paths that last over many samples.

In: a `ClipSet`, and the noise from sample to sample. Out: a `SlowNoise`: its standard deviation and correlation time.

A ball that rolls is slowed, and turned, so evenly that a cubic follows it to its next impact; sets generated with an
effect of natural size show nothing beyond their noise of half a millimetre. What is left beyond the noise are errors of
the image (a compressed picture, uneven light, a lens, frames at uneven times) or a cloth that is not flat within some
decimetres; no model says which way they go, and neighbouring samples share them. Fits weigh samples by both noises, or
they would take wandering for physics.

Left out: what a cubic follows, so that slow noise of long waves comes out small, and so does its correlation time.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import GRAVITY
from sysid.clips.clip_set import ClipSet
from sysid.clips.segments import Segment, split_all
from sysid.clips.tracker.correlation import integrated_time

POLYNOMIAL_DEGREE = 3  # degree of the polynomial that follows a rolling ball
MIN_SAMPLES = 24  # fewest samples of a smooth part that distinguish noise from wandering
MIN_STRETCHES = 3  # fewest smooth parts for a median
MIN_SLIDING_FRICTION = 0.1  # least sliding friction, which gives the longest slide
MAX_SLIP_OF_SPEED = 2.0  # initial slip over speed of a ball with as much backspin as natural roll
MIN_SPEED_M_S = 0.04  # slower balls may be stopping
SPEED_SAMPLES = 3  # samples before and after one that give its speed
MIN_SIGNIFICANCE = 3.0  # standard errors beyond the noise for slow noise to count
ERROR_OF_MEDIAN = 1.25  # standard error of a median over that of a mean


@dataclass(frozen=True)
class SlowNoise:
    """Deviations of tracks from smooth paths."""

    sd: float = 0.0  # per axis [m]; 0 if nothing is found beyond the noise
    correlation_time: float = 1.0  # [samples]: so many count as one

    def together(self, noise: float, correlation: float) -> float:
        """Correlation time [samples] of this together with noise of a standard deviation [m] and correlation time."""
        both = noise**2 + self.sd**2
        return (noise**2 * correlation + self.sd**2 * self.correlation_time) / both if both > 0 else correlation

    def in_words(self) -> str:
        """A line on its size and its possible origin."""
        return (
            f"tracks wander by {1e3 * self.sd:.2f} mm an axis about smooth paths, over some "
            f"{self.correlation_time:.0f} samples: errors of the image, or cloth that is not flat"
        )

    def as_white(self, noise: float) -> float:
        """Standard deviation [m] of the white noise that matters as much in long means as this plus white noise."""
        return math.hypot(noise, self.sd * math.sqrt(self.correlation_time))


def slow_noise(clip_set: ClipSet, noise: float) -> SlowNoise:
    """The slow noise of a clip set's tracks.

    Args:
        clip_set: tracks without outliers.
        noise: from sample to sample, one standard deviation per axis [m].
    """
    residuals = [_residual(time, xy) for time, xy in _stretches(clip_set, noise)]
    if len(residuals) < MIN_STRETCHES:
        return SlowNoise()
    variance = np.concatenate([np.sum(r**2, axis=0) / (len(r) - POLYNOMIAL_DEGREE - 1) for r in residuals])
    freedom = float(np.median([len(r) - POLYNOMIAL_DEGREE - 1 for r in residuals]))
    error = ERROR_OF_MEDIAN * noise**2 * math.sqrt(2 / freedom / len(residuals))  # were there white noise alone
    beyond = float(np.median(variance)) - noise**2
    if beyond <= MIN_SIGNIFICANCE * error:
        return SlowNoise()
    return SlowNoise(math.sqrt(beyond), _correlation_time(residuals, noise))


def _stretches(clip_set: ClipSet, noise: float) -> Iterator[tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Times (n,) [s] and positions (n, 2) [m] of balls that roll, between two impacts."""
    for segment in split_all(clip_set.clips, clip_set.table, clip_set.ball, noise, clip_set.fps, MIN_SAMPLES):
        rolls = _rolls(segment)
        if np.sum(rolls) >= MIN_SAMPLES:
            yield segment.time[rolls], segment.xy[rolls]


def _rolls(segment: Segment) -> NDArray[np.bool_]:
    """Samples in which a ball certainly rolls: after the longest possible slide and before it stops."""
    time, xy, k = segment.time, segment.xy, SPEED_SAMPLES
    first = float(np.hypot(*(xy[2 * k] - xy[0]))) / (time[2 * k] - time[0])
    longest = 2 / 7 * MAX_SLIP_OF_SPEED * first / (MIN_SLIDING_FRICTION * GRAVITY)
    speed = np.hypot(*(xy[2 * k :] - xy[: -2 * k]).T) / (time[2 * k :] - time[: -2 * k])
    slow = np.flatnonzero(speed < MIN_SPEED_M_S)
    last = slow[0] if slow.size else len(time)
    return np.asarray((time - time[0] > longest) & (np.arange(len(time)) < last))


def _residual(time: NDArray[np.float64], xy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Residuals of positions from the cubic through them: (n, 2) [m]."""
    smooth = np.linalg.qr(np.vander((time - time.mean()) / np.ptp(time), POLYNOMIAL_DEGREE + 1))[0]
    return np.asarray(xy - smooth @ (smooth.T @ xy))


def _correlation_time(residuals: list[NDArray[np.float64]], noise: float) -> float:
    """Integrated autocorrelation time, the variance of the noise left out of it [samples]."""
    lags = min(len(r) for r in residuals) - 1
    products = np.zeros(lags)
    for r in residuals:
        products += [float(np.mean(r[lag:] * r[: len(r) - lag])) for lag in range(lags)]
    variance = products[0] - len(residuals) * noise**2
    if variance <= 0:
        return 1.0
    return integrated_time(np.minimum(products / variance, 1.0), 0.0)
