"""Noise of a tracker, estimated from its tracks: its size, and how far it is correlated from sample to sample.

In: a `ClipSet`. Out: the standard deviation of positions, and the correlation time.

White noise shows in third differences. Correlated noise is too small there. It shows in the residuals e = M y of cubics
through short windows of even samples, M the projection that removes them. Its autocovariance g_l gives their lagged
products, which is a linear system for g:

    E sum_i e_i e_(i+k) = sum_l g_l sum_i (M T_l M)_(i,i+k),    T_l the Toeplitz matrix of lag l.

The correlation time is 1 + 2 sum_l g_l / g_0. Left out: correlation beyond the last lag, which motion imitates, so that
the correlation time of noise that is correlated over many samples comes out low.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.clips.clip_set import ClipSet, Observation

THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)  # of white noise: root of 1 + 9 + 9 + 1

WINDOW_SAMPLES, WINDOW_DEGREE = 15, 3  # evenly timed samples of a window, and degree of its polynomial
MIN_VALUES = 30  # fewest third differences for an estimate
MAX_LAG = 2  # samples, of the autocovariance: more are hardly distinguished from the motion
MAX_WINDOW_RATIO = 2.5  # of a window's variance to the median: beyond it holds an impact or the end of a slide
MIN_WINDOWS = 20
MIN_SIGNIFICANCE = 2.0  # standard errors, for the noise to count as correlated
UNEVEN_SHARE = 0.05  # largest deviation of a window's intervals from even ones, relative
MIN_MOVED_M = 1e-4  # least distance from sample to sample of a moving ball


def position_noise(clip_set: ClipSet) -> float:
    """One standard deviation per axis [m]: as clips.toml has it, else from the tracks.

    Third differences of evenly timed samples of a smooth motion hold noise alone; the median ignores impacts. Where the
    noise is correlated, its variance is that of its autocovariance.
    """
    if clip_set.sigma is not None:
        return clip_set.sigma
    covariances = _autocovariance(clip_set)
    if covariances is not None:
        return float(np.sqrt(covariances[0]))
    found, at_rest = [], 0
    for clip in clip_set.clips:
        for seen in clip.balls.values():
            step = np.diff(seen.time)
            if len(step) < 3:
                continue
            even = np.abs(step / np.median(step) - 1) < 0.05
            smooth = even[2:] & even[1:-1] & even[:-2]
            third = np.diff(seen.xy, 3, axis=0)[smooth]
            moving = np.hypot(*np.diff(seen.xy, axis=0)[1:-1][smooth].T) > 1e-4
            found.append(third[moving].ravel())
            at_rest += third[~moving].size
    values = np.concatenate(found) if found else np.zeros(0)
    if values.size < MIN_VALUES:
        more = "hardly any" if values.size else "no"
        why = f"{more} ball moves" if at_rest >= MIN_VALUES else "the tracks are too short"
        remedy = "record shots in which balls move, or add [camera] sigma"
        raise BadInput(f"clips.toml: sigma is missing and {why} to estimate it; {remedy}")
    return max(smooth_noise(values), 1e-6)


def noise_correlation(clip_set: ClipSet) -> float:
    """Correlation time of the noise [samples]: so many count as one; 1 for white noise."""
    covariances = _autocovariance(clip_set)
    return 1.0 if covariances is None else float(1.0 + 2.0 * covariances[1:].sum() / covariances[0])


def _autocovariance(clip_set: ClipSet) -> NDArray[np.float64] | None:
    """Autocovariance of the noise (1 + MAX_LAG,) [m^2]; None where it does not differ from that of white noise."""
    found = [seen for clip in clip_set.clips for seen in clip.balls.values()]
    windows = np.concatenate([np.zeros((0, WINDOW_SAMPLES)), *(part for seen in found for part in _windows(seen))])
    if len(windows) < MIN_WINDOWS:
        return None
    size = np.arange(WINDOW_SAMPLES)
    polynomial = np.linalg.qr(np.vander((size - size.mean()) / WINDOW_SAMPLES, WINDOW_DEGREE + 1))[0]
    project = np.eye(WINDOW_SAMPLES) - polynomial @ polynomial.T
    residual = windows @ project
    variance = np.sum(residual**2, axis=1)
    residual = residual[variance < MAX_WINDOW_RATIO * np.median(variance)]
    lags = np.arange(MAX_LAG + 1)
    products = np.stack(
        [np.sum(residual[:, lag:] * residual[:, : WINDOW_SAMPLES - lag], axis=1) for lag in lags], axis=1
    )
    apart = np.abs(size[:, None] - size)
    gain = np.array([[np.trace(project @ (apart == one) @ project, lag) for one in lags] for lag in lags])
    each = np.linalg.solve(gain, products.T).T  # the autocovariance by every window: (windows, 1 + MAX_LAG)
    beyond = each[:, 1:].sum(axis=1)
    standard_error = float(np.std(beyond)) / np.sqrt(len(beyond))
    return np.asarray(each.mean(axis=0)) if beyond.mean() > MIN_SIGNIFICANCE * standard_error else None


def _windows(seen: Observation) -> list[NDArray[np.float64]]:
    """Positions of a moving ball in windows of even samples, a row for each axis: (2, WINDOW_SAMPLES) each."""
    step = np.diff(seen.time)
    if len(step) < WINDOW_SAMPLES:
        return []
    moves = np.hypot(*np.diff(seen.xy, axis=0).T) > MIN_MOVED_M
    good = (np.abs(step / np.median(step) - 1) < UNEVEN_SHARE) & moves
    found, first = [], 0
    for k in [*np.flatnonzero(~good).tolist(), len(step)]:
        for start in range(first, k - WINDOW_SAMPLES + 2, WINDOW_SAMPLES):
            found.append(seen.xy[start : start + WINDOW_SAMPLES].T)
        first = k + 1
    return found


def smooth_noise(third: NDArray[np.float64]) -> float:
    """Standard deviation of the noise of evenly timed samples of a smooth motion, from their third differences."""
    return float(np.median(np.abs(third)) / 0.6745 / THIRD_DIFFERENCE_GAIN)
