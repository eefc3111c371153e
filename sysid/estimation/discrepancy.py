"""Discrepancy of the model, which grows along a shot: sd = hypot(noise, discrepancy rate times path length).

In: clips, or residuals with their path lengths. Out: path lengths, and the discrepancy rate.

The error grows with the path that a ball has travelled, and with that of the ball that set it moving. The path before
the first event counts a tenth: impacts amplify errors, open cloth does not.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtri

from sysid.clips import Clip, ClipSet
from sysid.clips.segments import event_times
from sysid.estimation.problem import CAUCHY_SD, Array

SHARE_BEFORE_FIRST_EVENT = 0.1  # share with which the path before the first event counts
MOVED_M = 0.02  # a ball with a shorter path was not set moving
MAX_RATE, MAX_BISECTIONS = 1.0, 40  # limits of the search for a rate
MIN_RATE = 1e-9  # smaller rates are 0


def path_lengths(clip: Clip, first: float) -> dict[str, Array]:
    """Path length over which each sample's error has grown, by ball: (samples,) [m].

    Args:
        clip: its tracks.
        first: time of the first event [s].
    """
    struck = clip.balls[clip.struck]

    def length(time: Array, xy: Array) -> Array:
        step = np.hypot(*np.diff(xy, axis=0).T) * np.where(time[1:] > first, 1.0, SHARE_BEFORE_FIRST_EVENT)
        return np.concatenate([[0.0], np.cumsum(step)])

    struck_path = length(struck.time, struck.xy)
    found = {name: length(clip.balls[name].time, clip.balls[name].xy) for name in clip.first}
    for name, seen in clip.balls.items():
        if name not in found:
            path = length(seen.time, seen.xy)
            moving = np.flatnonzero(path > MOVED_M)
            start = np.interp(seen.time[moving[0]], struck.time, struck_path) if moving.size else 0.0
            found[name] = path + start * (path > MOVED_M)
    return found


def events_and_paths(clip_set: ClipSet, noise: float) -> tuple[list[Array], list[dict[str, Array]]]:
    """Times of the first balls' events in every clip, and the path length of every sample."""
    events = [event_times(c, clip_set.table, clip_set.ball, noise, clip_set.fps) for c in clip_set.clips]
    first = [e[0] if e.size else np.inf for e in events]
    return events, [path_lengths(c, f) for c, f in zip(clip_set.clips, first, strict=True)]


def discrepancy_rate(residual: Array, path: Array, noise: float, share: float = 0.5) -> float:
    """Model error per path length for which a quantile of |residual| / sd is a Gaussian's; 0 if noise alone suffices.

    Args:
        residual: per axis (m,) [m], NaN unused.
        path: path length of each (m,) [m].
        noise: one standard deviation per axis [m].
        share: of the residuals below the quantile.
    """
    use = np.isfinite(residual) & (path > 0)
    if not use.any():
        return 0.0
    size, length = np.abs(residual[use]), path[use]
    expected = float(ndtri(0.5 + share / 2))
    low, high = 0.0, MAX_RATE
    for _ in range(MAX_BISECTIONS):
        middle = 0.5 * (low + high)
        if np.quantile(size / np.hypot(noise, middle * length), share) > expected:
            low = middle
        else:
            high = middle
    return low if low > MIN_RATE else 0.0


def likely_rate(residual: Array, path: Array, noise: float) -> float:
    """The most likely model error per path length under Cauchy's loss; 0 if noise alone suffices.

    Args:
        residual: per axis (m,) [m], NaN unused.
        path: path length of each (m,) [m].
        noise: one standard deviation per axis [m].
    """
    use = np.isfinite(residual) & (path > 0)
    square, length = residual[use] ** 2, path[use] ** 2

    def slope(rate: float) -> float:
        """Twice the derivative of the log likelihood by the variance rate^2."""
        variance = noise**2 + rate**2 * length
        counted = square / (variance + square / CAUCHY_SD**2)
        return float(np.sum((counted - 1) * length / variance))

    if slope(0.0) <= 0:
        return 0.0
    return MAX_RATE if slope(MAX_RATE) >= 0 else float(brentq(slope, 0.0, MAX_RATE, xtol=MIN_RATE))
