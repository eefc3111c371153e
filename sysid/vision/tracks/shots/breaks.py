"""Where a ball's path breaks: cut footage, or a ball that was moved unseen.

In: the tracked scene and a range of frames. Out: the last frame before the first break, and the ball.
"""

from __future__ import annotations

import math

import numpy as np

from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.moves import MIN_REST_DETECTIONS, SURE_SD, TrackedScene
from sysid.vision.tracks.phases import Phase

MIN_KNOWN = 3  # detections of a phase whose speed is known
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
            known = not before.rest and before.stop - before.first >= MIN_KNOWN  # else it may just be being struck
            if one.jumped or (known and _gains(scene, track, before, one)):
                found = (left, track.name)
    return found


def _gains(scene: TrackedScene, track: BallTrack, before: Phase, one: Phase) -> bool:
    """Whether a ball in motion gets farther or faster after a knot than the energy of all balls before it allows."""
    time, at = float(track.time[before.stop - 1]), float(track.time[one.first])
    # What a ball lost of its speed may be in its spin still, until it rests.
    energy = 0.0
    for other in scene.tracks:
        fastest_so_far = 0.0
        for phase in scene.phases[other.name]:
            if phase.start <= time:
                speed, sd = _speed(phase, phase.start)
                rests = phase.still and phase.stop - phase.first >= MIN_REST_DETECTIONS and phase.end < time
                fastest_so_far = 0.0 if rests else max(fastest_so_far, speed + SURE_SD * sd)
        energy += fastest_so_far**2
    fastest = math.sqrt(ROLLING_ENERGY * energy)
    way = float(np.linalg.norm(one.place(at) - before.place(time)))
    sd = math.hypot(before.place_sd(time), one.place_sd(at), scene.sigma)
    if way > fastest * (at - time) + SURE_SD * sd:
        return True
    if one.rest or one.stop - one.first < MIN_KNOWN:
        return False
    speed, sd = _speed(one, one.start)
    return speed - SURE_SD * sd > fastest


def _speed(one: Phase, time: float) -> tuple[float, float]:
    return float(np.linalg.norm(one.velocity(time))), one.velocity_sd(time)
