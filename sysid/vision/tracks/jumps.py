"""Balls that are elsewhere from one sighting to the next: footage that was cut, or a ball moved by hand unseen."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.vision.tracks.follow import Path

FASTER = 3.0  # times the steps before and after it
SLACK = 0.5  # and this much [m/s]


def first_jump(paths: Sequence[Path], first: int, last: int) -> tuple[int, str]:
    """The last frame before a ball jumps, and which; `last` and "" where none does between two frames."""
    found = (last, "")
    for path in paths:
        part = np.flatnonzero((path.frame >= first) & (path.frame <= last))
        if part.size < 3:
            continue
        step = np.hypot(*np.diff(path.xy[part], axis=0).T) / np.diff(path.time[part])
        beside = np.maximum(np.append(0.0, step[:-1]), np.append(step[1:], 0.0))
        fast = np.flatnonzero(step > FASTER * beside + SLACK)
        if fast.size and (frame := int(path.frame[part[fast[0]]])) < found[0]:
            found = (frame, path.name)
    return found
