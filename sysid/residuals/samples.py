"""Residuals of every sample, with the ball's state.

In: what sysid/residuals/collect.py gathers. Out: `Samples`: one row for each sample of the compared clips.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Every trusted sample of the compared clips, one row each: its residual, and the state of the ball."""

    clip: NDArray[np.int64]  # (n,) index into the clip set
    ball: tuple[str, ...]  # (n,)
    struck: NDArray[np.bool_]  # (n,)
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) measured [m]
    residual: Array  # (n, 2) model minus measurement [m]
    speed: Array  # (n,) modelled [m/s]
    heading: Array  # (n,) modelled [rad]
    spin: Array  # (n,) modelled sidespin [rad/s]
    motion: tuple[str, ...]  # (n,) "slide", "roll", "spin", "rest": the phase of its motion
    last: tuple[str, ...]  # (n,) kind of its last event: "strike", "ball", "cushion"; "start" of a clip in mid-motion
    events: NDArray[np.int64]  # (n,) number of its events so far
    angle: Array  # (n,) turned angle of the mark, model minus measurement [rad]; NaN where unseen
    slip: Array  # (n,) modelled slip speed of the point of contact [m/s]
    rail: tuple[str, ...]  # (n,) cushion of the last event, "+x", "-x", "+y", "-y"; "" where it was another kind
    since: Array  # (n,) time since the ball's last event [s]
    segment: NDArray[np.int64]  # (n,) number of the segment between two events of one ball
