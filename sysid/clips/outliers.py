"""Outliers: single samples that the tracker placed elsewhere, removed before anything is fitted.

In: a ball's `Observation`, or a `ClipSet`. Out: which samples are outliers; the clip set without them.

A sample is an outlier if it lies far from three linear predictions: from the two samples before it, from the two after
it, and from its two neighbours. At an impact one of the three holds.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from models.shot import Array
from sysid.clips.clip_set import ClipSet, Observation

MAX_EXTRAPOLATION_SD = 8.0  # distance from a prediction, over its standard deviation
MIN_OUTLIER_M = 0.004  # distance that an outlier has at least
EXTRAPOLATION_GAIN = np.sqrt(6.0)  # of white noise, by a linear prediction: root of 1 + 4 + 1
MAX_NEIGHBOUR_INTERVALS = 4.0  # of the median interval: over longer gaps the prediction does not hold


def find_outliers(seen: Observation, sigma: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Which samples of a ball are outliers: (n,)."""
    n = len(seen.time)
    found = np.zeros(n, bool)
    if n < 5:
        return found
    t, xy = seen.time, seen.xy
    k = np.arange(2, n - 2)

    def line(a: NDArray[np.int64], b: NDArray[np.int64]) -> Array:
        slope = (xy[b] - xy[a]) / (t[b] - t[a])[:, None]
        return np.asarray(xy[a] + slope * (t[k] - t[a])[:, None])

    away = np.min([np.hypot(*(xy[k] - line(*pair)).T) for pair in ((k - 2, k - 1), (k + 1, k + 2), (k - 1, k + 1))], 0)
    near = (t[k + 2] - t[k - 2]) < MAX_NEIGHBOUR_INTERVALS * 4 * np.median(np.diff(t))
    found[k] = near & (away > max(MAX_EXTRAPOLATION_SD * EXTRAPOLATION_GAIN * sigma, MIN_OUTLIER_M))
    return found


def remove_outliers(clip_set: ClipSet, sigma: float) -> tuple[ClipSet, int]:
    """The clip set without outliers, and how many there were."""
    count, clips = 0, []
    for clip in clip_set.clips:
        balls = {}
        for name, seen in clip.balls.items():
            bad = find_outliers(seen, sigma)
            count += int(bad.sum())
            keep = np.flatnonzero(~bad)
            extra = (
                {key: tuple(cells[i] for i in keep) for key, cells in seen.extra.items()} if bad.any() else seen.extra
            )
            balls[name] = Observation(seen.time[keep], seen.xy[keep], seen.theta[keep], extra) if bad.any() else seen
        clips.append(dataclasses.replace(clip, balls=balls))
    return (dataclasses.replace(clip_set, clips=tuple(clips)), count) if count else (clip_set, 0)
