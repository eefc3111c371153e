"""Where a ball's path breaks: cut footage, or a ball that was moved unseen.

In: the tracked scene and a range of frames. Out: the last frame before the first break, and the ball.
"""

from __future__ import annotations

import math

import numpy as np

from sysid.vision.tracks.moves import SURE_SD, TrackedScene
from sysid.vision.tracks.phases import Phase

ROLLING_ENERGY = 7 / 5  # of a ball that rolls, over that of its speed alone


def first_break(scene: TrackedScene, first: int, last: int) -> tuple[int, str]:
    """The last frame before a ball's path breaks, and whose; `last` and "" where none does between two frames.

    A path breaks at a jump, and where a ball comes out of a knot with more energy than all balls had before it. What
    comes later than the first frame is in no clip.
    """
    found = (last, "")
    for track in scene.tracks:
        if track.frame[0] > first:
            continue
        for before, one in zip(scene.phases[track.name], scene.phases[track.name][1:], strict=False):
            left, at = int(track.frame[before.stop - 1]), int(track.frame[one.first])
            if left < first or at > last or left >= found[0]:
                continue
            if one.jumped or (not before.rest and _gains(scene, before, one, float(track.time[before.stop - 1]))):
                found = (left, track.name)
    return found


def _gains(scene: TrackedScene, before: Phase, one: Phase, time: float) -> bool:
    """Whether a ball has more energy in a phase than all balls had at a time [s]."""
    if one.rest or one.stop - one.first < 3:
        return False
    energy, since = 0.0, time - 1.5 * scene.period  # balls that met may show it in different frames
    for track in scene.tracks:
        speeds = [0.0]
        for phase in scene.phases[track.name]:
            begins, ends = phase.start, float(track.time[phase.stop - 1])
            if begins <= time and ends >= since and not phase.rest:
                speed, sd = _speed(phase, min(time, ends))
                speeds.append(speed + SURE_SD * sd)
        energy += max(speeds) ** 2
    speed, sd = _speed(one, one.start)
    return speed - SURE_SD * sd > math.sqrt(ROLLING_ENERGY * energy)


def _speed(one: Phase, time: float) -> tuple[float, float]:
    return float(np.linalg.norm(one.velocity(time))), one.velocity_sd(time)
