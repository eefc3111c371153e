"""Outliers: samples that the tracker misplaced, removed before any fit.

In: a ball's `Observation`, two of them, or a `ClipSet`. Out: which samples are outliers; the clip set without them.

A sample is an outlier if it lies far from three linear predictions: from the two samples before it, from the two after
it, and from its two neighbours. At an impact one of the three holds. The second sample has only one
before it: it is an outlier if the first and the two after it lie on a line, and it does not. So is the last but one,
the other way round. A sample beyond the cushions is one, too.

Two balls are exchanged for some samples if from one sample to the next the squared steps of both are at most half as
large, once each ball is continued with the other's place, and as soon again. Balls that do not overlap cannot pass each
other so: a ball that steps by s past another one d away gives s^2 against 2 (s^2 / 4 + d^2).
"""

from __future__ import annotations

import dataclasses
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from models.shot import Array
from sysid.clips.clip_set import ClipSet, Observation
from sysid.clips.plausibility import MAX_BEYOND_NOSE_M, POCKET_REACH

MAX_EXTRAPOLATION_SD = 8.0  # largest distance from a prediction, in its standard deviations
MIN_OUTLIER_M = 0.004  # least distance of an outlier
EXTRAPOLATION_GAIN = np.sqrt(6.0)  # of white noise, by a linear prediction: root of 1 + 4 + 1
MAX_NEIGHBOUR_INTERVALS = 4.0  # longest gap over which a prediction holds, in median intervals
MAX_SWAPPED_SAMPLES = 6  # longest run of exchanged samples; longer ones are another fault
MAX_CROSSED_SHARE = 0.5  # squared steps of exchanged balls over those as tracked


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

    limit = max(MAX_EXTRAPOLATION_SD * EXTRAPOLATION_GAIN * sigma, MIN_OUTLIER_M)
    away = np.min([np.hypot(*(xy[k] - line(*pair)).T) for pair in ((k - 2, k - 1), (k + 1, k + 2), (k - 1, k + 1))], 0)
    near = (t[k + 2] - t[k - 2]) < MAX_NEIGHBOUR_INTERVALS * 4 * np.median(np.diff(t))
    found[k] = near & (away > limit)
    for at, inner in (([0, 1, 2, 3], near[0]), ([n - 1, n - 2, n - 3, n - 4], near[-1])):
        found[at[1]] = inner and _alone_off_line(t[at], xy[at], limit)
    return found


def _alone_off_line(time: Array, xy: Array, limit: float) -> bool:
    """Whether the second of four samples is off the line of the others by more than a limit [m]: (4,), (4, 2)."""
    slope = (xy[3] - xy[2]) / (time[3] - time[2])
    away = np.hypot(*(xy[:2] - xy[2] - slope * (time[:2] - time[2])[:, None]).T)
    between = xy[0] + (xy[2] - xy[0]) * (time[1] - time[0]) / (time[2] - time[0])
    return bool(away[0] < limit and min(away[1], float(np.hypot(*(xy[1] - between)))) > limit)


def find_swaps(one: Observation, two: Observation) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Samples in which two balls are exchanged: their numbers in each."""
    time, a, b = np.intersect1d(one.time, two.time, assume_unique=True, return_indices=True)
    none = np.zeros(0, np.int64)
    if len(time) < 3:
        return none, none
    here, there = one.xy[a], two.xy[b]

    def squares(first: Array, then: Array) -> Array:
        return np.asarray(np.sum((then[1:] - first[:-1]) ** 2, axis=1))

    kept = squares(here, here) + squares(there, there)
    crossed = squares(here, there) + squares(there, here)
    step = np.diff(time)
    change = np.flatnonzero(
        (crossed < MAX_CROSSED_SHARE * kept) & (step < MAX_NEIGHBOUR_INTERVALS * np.median(step))
    ).tolist()
    found: list[int] = []
    while len(change) > 1:
        begin, end = change[0], change[1]
        swapped = end - begin <= MAX_SWAPPED_SAMPLES
        found += range(begin + 1, end + 1) if swapped else ()
        change = change[2 if swapped else 1 :]
    return a[found], b[found]


def remove_outliers(clip_set: ClipSet, sigma: float) -> tuple[ClipSet, int]:
    """The clip set without outliers, and how many there were."""
    count, clips = 0, []
    for clip in clip_set.clips:
        bad = {name: find_outliers(seen, sigma) | beyond_cushions(seen, clip_set) for name, seen in clip.balls.items()}
        for one, two in combinations(clip.balls, 2):
            for name, swapped in zip((one, two), find_swaps(clip.balls[one], clip.balls[two]), strict=True):
                bad[name][swapped] = True
        count += sum(int(rows.sum()) for rows in bad.values())
        balls = {name: _without(seen, bad[name]) if bad[name].any() else seen for name, seen in clip.balls.items()}
        clips.append(dataclasses.replace(clip, balls=balls))
    return (dataclasses.replace(clip_set, clips=tuple(clips)), count) if count else (clip_set, 0)


def beyond_cushions(seen: Observation, clip_set: ClipSet) -> NDArray[np.bool_]:
    """Samples farther beyond a cushion's nose than a ball can be, but not in a pocket: (n,)."""
    limit = np.array([clip_set.table.length, clip_set.table.width]) / 2 + MAX_BEYOND_NOSE_M
    outside = np.asarray(np.any(np.abs(seen.xy) > limit, axis=1), bool).reshape(len(seen.time))
    for k in np.flatnonzero(outside).tolist():
        outside[k] = clip_set.table.to_pocket(seen.xy[k]) > POCKET_REACH * clip_set.ball.diameter
    return outside


def _without(seen: Observation, bad: NDArray[np.bool_]) -> Observation:
    return seen.at(np.flatnonzero(~bad))
