"""Jumps of balls from one detection to the next: cut footage, or a ball that was moved unseen.

In: tracks and a range of frames. Out: the last frame before the first jump, and the ball that jumps.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.vision.tracks.follow import BallTrack

JUMP_SPEED_RATIO = 3.0  # of a step to the steps before and after it
JUMP_SPEED_M_S = 0.5  # in addition to that [m/s]


def first_jump(tracks: Sequence[BallTrack], first: int, last: int) -> tuple[int, str]:
    """The last frame before a ball jumps, and which; `last` and "" where none does between two frames."""
    found = (last, "")
    for track in tracks:
        rows = np.flatnonzero((track.frame >= first) & (track.frame <= last))
        if rows.size < 3:
            continue
        speed = np.hypot(*np.diff(track.xy[rows], axis=0).T) / np.diff(track.time[rows])
        neighbours = np.maximum(np.append(0.0, speed[:-1]), np.append(speed[1:], 0.0))
        fast = np.flatnonzero(speed > JUMP_SPEED_RATIO * neighbours + JUMP_SPEED_M_S)
        if fast.size and (frame := int(track.frame[rows[fast[0]]])) < found[0]:
            found = (frame, track.name)
    return found
