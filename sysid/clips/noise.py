"""Noise of a tracker, estimated from its tracks.

In: a `ClipSet`. Out: the standard deviation of positions.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.clips.clip_set import ClipSet

THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)  # of white noise: root of 1 + 9 + 9 + 1


def position_noise(clip_set: ClipSet) -> float:
    """One standard deviation per axis [m]: as clips.toml has it, else from the median third difference.

    Third differences of evenly timed samples of a smooth motion hold noise alone; the median ignores impacts.
    """
    if clip_set.sigma is not None:
        return clip_set.sigma
    found = []
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
    values = np.concatenate(found) if found else np.zeros(0)
    if values.size < 30:
        raise BadInput("clips.toml: sigma is missing and the tracks are too short to estimate it; add [camera] sigma")
    return max(smooth_noise(values), 1e-6)


def smooth_noise(third: NDArray[np.float64]) -> float:
    """Standard deviation of the noise of evenly timed samples of a smooth motion, from their third differences."""
    return float(np.median(np.abs(third)) / 0.6745 / THIRD_DIFFERENCE_GAIN)
