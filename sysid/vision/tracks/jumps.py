"""Jumps of balls from one detection to the next: cut footage, or a ball that was moved unseen.

In: tracks and a range of frames. Out: the last frame before the first jump, and the ball that jumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.tracks.follow import BallTrack

JUMP_SPEED_RATIO = 3.0  # of a step to the steps before and after it
JUMP_SPEED_M_S = 0.5  # in addition to that [m/s]
MIN_GAP_PERIODS = 5.5  # between detections, from which on much may have happened unseen
RECENT_S = 0.2  # before a gap, in which some ball was so fast,
MAX_GAIN = (1.15, 0.15)  # that one that moved may be this much faster after it: factor, and [m/s]
MOVING_M_S = 0.1  # a slower ball may have been struck unseen


def first_jump(tracks: Sequence[BallTrack], first: int, last: int) -> tuple[int, str]:
    """The last frame before a ball jumps, and which; `last` and "" where none does between two frames."""
    found = (last, "")
    for track in tracks:
        rows = np.flatnonzero((track.frame >= first) & (track.frame <= last))
        if rows.size < 3:
            continue
        speed = np.hypot(*np.diff(track.xy[rows], axis=0).T) / np.diff(track.time[rows])
        neighbours = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
        fast = np.flatnonzero(
            (speed > JUMP_SPEED_RATIO * neighbours + JUMP_SPEED_M_S) | _gains(track, rows, speed, tracks)
        )
        if fast.size and (frame := int(track.frame[rows[fast[0]]])) < found[0]:
            found = (frame, track.name)
    return found


def _gains(
    track: BallTrack, rows: NDArray[np.intp], speed: Array, tracks: Sequence[BallTrack]
) -> NDArray[np.bool_]:  # fmt: skip
    """Whether a ball that moved is faster after a gap than any ball was before it: (n,) by steps (n,) [m/s]."""
    time = track.time[rows]
    gains = np.zeros(len(speed), bool)
    for k in np.flatnonzero(np.diff(time) > MIN_GAP_PERIODS * np.median(np.diff(time))):
        if not 0 < k < len(speed) - 1 or speed[k - 1] < MOVING_M_S:
            continue
        usual = max(_fastest(other, time[k]) for other in tracks)
        gains[k] = max(speed[k], speed[k + 1]) > MAX_GAIN[0] * usual + MAX_GAIN[1]
    return gains


def _fastest(track: BallTrack, time: float) -> float:
    """The greatest speed of a ball just before a time [m/s]; 0 where it was not seen."""
    rows = np.flatnonzero((track.time > time - RECENT_S) & (track.time <= time))
    if rows.size < 2:
        return 0.0
    return float((np.hypot(*np.diff(track.xy[rows], axis=0).T) / np.diff(track.time[rows])).max())
