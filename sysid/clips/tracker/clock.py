"""The scale of the camera's clock: the interval of the time stamps over that of the nominal frame rate.

In: a `ClipSet`. Out: the ratio and its standard deviation.

A camera's frame rate is accurate to some parts in ten thousand, and clips.toml gives it to its last digit. Stamps with
another interval come from a clock that runs fast or slow. The tracks alone do not show that: a scale of time is
imitated by every friction.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet

FRAME_RATE_TOLERANCE = 2e-4  # relative standard deviation of a frame rate from its nominal value
MAX_OFF_WHOLE_FRAMES = 0.2  # intervals that deviate more from a whole number of frames are not used (relative)
MIN_INTERVALS = 30


def stamp_scale(clip_set: ClipSet) -> tuple[float, float]:
    """Ratio of the stamps' interval to the nominal one, and its standard deviation; inf if there are too few stamps."""
    frames = sample_intervals(clip_set.clips) * clip_set.fps
    whole = np.round(frames)
    use = (whole >= 1) & (whole <= 20) & (np.abs(frames - whole) < MAX_OFF_WHOLE_FRAMES * whole)
    if use.sum() < MIN_INTERVALS:
        return 1.0, float("inf")
    ratio = frames[use] / whole[use]
    scale = float(np.median(ratio))
    scatter = 1.4826 * float(np.median(np.abs(ratio - scale))) / float(np.sqrt(use.sum()))
    digits = len(repr(float(clip_set.fps)).partition(".")[2])
    rounding = 0.5 * 10.0**-digits / clip_set.fps / float(np.sqrt(3))
    return scale, float(np.sqrt(FRAME_RATE_TOLERANCE**2 + scatter**2 + rounding**2))


def sample_intervals(clips: Iterable[Clip]) -> Array:
    """Intervals between the times at which any ball of a clip was sampled, over all clips: (n,) [s]."""
    steps = [np.diff(np.unique(np.concatenate([seen.time for seen in clip.balls.values()]))) for clip in clips]
    return np.concatenate([np.zeros(0), *steps])
