"""The model's own error, which grows along a shot: sd = hypot(noise, discrepancy rate times path length).

An error that a shot begins with grows with the path that its ball travels, and with that of the ball that set it
moving. What is travelled before the first event counts a tenth: impacts magnify errors, open cloth does not.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtri

from sysid.clips import Clip, ClipSet
from sysid.clips.segments import event_times
from sysid.estimation.problem import Array

BEFORE_FIRST_EVENT = 0.1  # of a path that counts there
MOVED_M = 0.02  # a ball that went no further was not set moving
MAX_RATE, HALVINGS = 1.0, 40  # of the search for a rate
LEAST_RATE = 1e-9  # below which it is 0


def path_lengths(clip: Clip, first: float) -> dict[str, Array]:
    """How far each sample's error has had to grow, by ball: (samples,) [m]; `first` is the first event's time [s]."""
    struck = clip.balls[clip.struck]

    def run(time: Array, xy: Array) -> Array:
        step = np.hypot(*np.diff(xy, axis=0).T) * np.where(time[1:] > first, 1.0, BEFORE_FIRST_EVENT)
        return np.concatenate([[0.0], np.cumsum(step)])

    lead = run(struck.time, struck.xy)
    found = {clip.struck: lead}
    for name, seen in clip.balls.items():
        if name != clip.struck:
            own = run(seen.time, seen.xy)
            moving = np.flatnonzero(own > MOVED_M)
            start = np.interp(seen.time[moving[0]], struck.time, lead) if moving.size else 0.0
            found[name] = own + start * (own > MOVED_M)
    return found


def events_and_paths(clip_set: ClipSet, noise: float) -> tuple[list[Array], list[dict[str, Array]]]:
    """Times of the struck ball's events in every clip, and the path length of every sample."""
    events = [event_times(c, clip_set.table, clip_set.ball, noise, clip_set.fps) for c in clip_set.clips]
    first = [e[0] if e.size else np.inf for e in events]
    return events, [path_lengths(c, f) for c, f in zip(clip_set.clips, first, strict=True)]


def discrepancy_rate(miss: Array, path: Array, noise: float, share: float = 0.5) -> float:
    """Model error per path length with which a share of |miss| / sd lies where Gaussian noise has it; 0 if noise does.

    Args:
        miss: residuals per axis (m,) [m], NaN unused.
        path: path length of each (m,) [m].
        noise: one standard deviation per axis [m].
        share: of the residuals.
    """
    use = np.isfinite(miss) & (path > 0)
    if not use.any():
        return 0.0
    off, far = np.abs(miss[use]), path[use]
    expected = float(ndtri(0.5 + share / 2))
    low, high = 0.0, MAX_RATE
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if np.quantile(off / np.hypot(noise, middle * far), share) > expected:
            low = middle
        else:
            high = middle
    return low if low > LEAST_RATE else 0.0
