"""What the time stamps say of the camera's clock: their interval against the nominal frame rate.

A camera's frame rate is good to some parts in ten thousand, and the header gives it to its last digit. Stamps that
keep another interval come from a clock that runs fast or slow, or from a rate that is not the nominal one: without it,
a scale of time is hidden, since every friction scales along.
"""

from __future__ import annotations

import numpy as np

from sysid.clips.clip_set import ClipSet

FRAME_RATE_TOLERANCE = 2e-4  # by which a frame rate may differ from its nominal value [1]
MAX_OFF_WHOLE_FRAMES = 0.2  # of a frame: an interval farther than this from a whole number of frames says nothing
MIN_INTERVALS = 30  # intervals


def stamp_scale(clip_set: ClipSet) -> tuple[float, float]:
    """Interval of the stamps over the nominal one, and its standard deviation, inf where they do not tell."""
    times = [np.unique(np.concatenate([o.time for o in c.balls.values()])) for c in clip_set.clips]
    frames = np.concatenate([np.diff(t) for t in times]) * clip_set.fps if times else np.zeros(0)
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
