"""What a model missed, sample by sample, and what the ball was doing there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Every trusted sample of the compared clips, one row each: what the model missed, and where."""

    clip: NDArray[np.int64]  # (n,) index into the clip set
    ball: tuple[str, ...]  # (n,)
    struck: NDArray[np.bool_]  # (n,)
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) measured [m]
    miss: Array  # (n, 2) model minus measurement [m]
    speed: Array  # (n,) modelled [m/s]
    heading: Array  # (n,) modelled [rad]
    spin: Array  # (n,) modelled sidespin [rad/s]
    motion: tuple[str, ...]  # (n,) "slide", "roll", "spin", "rest": what the ball does
    last: tuple[str, ...]  # (n,) what the ball met last: "strike", "ball", "cushion"
    events: NDArray[np.int64]  # (n,) how many events the ball has had so far
    angle: Array  # (n,) turned angle of the mark, model minus measurement [rad]; NaN where unseen
    slip: Array  # (n,) modelled slip speed of the point of contact [m/s]
    rail: tuple[str, ...]  # (n,) the cushion met last, "+x", "-x", "+y", "-y"; "" where the last event was none
    since: Array  # (n,) time since the ball's last event [s]
    stretch: NDArray[np.int64]  # (n,) number of the stretch between two events of one ball
