"""How far apart the centres of two balls are when they meet: the diameter, by the tracks.

A resting ball that is struck moves off when the other's centre is a diameter away: where that one is, extrapolated to
the moment at which this one began to move, gives the distance. In: clips. Out: the typical distance, with its error.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.contradiction import Typical, typical
from sysid.clips.consistency.strike import REST_M

MIN_IMPACTS = 2  # fewer impacts are not judged
IMPACT_ERROR = 0.02  # least error of the distance at one impact, over the diameter: a few may agree by chance
BEGINNING_S = 0.03  # duration of a track's beginning, whose median is the ball's resting place
ALONE_M = 0.15  # smallest distance of other balls from an impact of two balls
SLIDE_M_S2 = 2.0  # deceleration of a ball just after it was struck, 0.2 g
BEGIN_ROUNDS = 5  # iterations for the moment at which a ball began to move
STRUCK_SAMPLES, STRIKING_SAMPLES = 5, 7  # after and before an impact
MAX_BEGIN_S = 0.1  # from the moment at which a struck ball begins to move to its next sample
MIN_STRIKING_M = 0.01  # least distance that the other ball moves in those samples
MIN_STRUCK_SPEED = 0.15  # least speed of a ball that was struck [m/s]
MAX_BENT_M = 0.003  # largest residual of the parabola before an impact of balls, and of the lines at a rebound


def contact_distance(clip_set: ClipSet) -> Typical:
    """Distance between centres at impacts with a resting ball [m]."""
    found = [d for clip in clip_set.clips for d in _distances(clip)]
    return typical(found, MIN_IMPACTS, IMPACT_ERROR * clip_set.ball.diameter)


def _distances(clip: Clip) -> Iterator[float]:
    for name, struck in clip.balls.items():
        begins = struck.time <= struck.time[0] + BEGINNING_S
        moved = np.flatnonzero(np.hypot(*(struck.xy - np.median(struck.xy[begins], axis=0)).T) > REST_M)
        first = int(moved[0]) if len(moved) else 0
        if name in clip.first or first < 1 or len(struck.time) < first + STRUCK_SAMPLES:
            continue
        place, part = np.median(struck.xy[: max(first - 1, 1)], axis=0), slice(first, first + STRUCK_SAMPLES)
        begin = float(struck.time[first])
        near = [
            other for other in clip.balls if other != name and distance_at(clip.balls[other], place, begin) < ALONE_M
        ]
        when = _began(struck.time[part], struck.xy[part] - place) if len(near) == 1 else None
        if when is None or not begin - MAX_BEGIN_S < when < begin:
            continue
        striking = _position(clip.balls[near[0]], when)
        if striking is not None:
            yield float(np.hypot(*(striking - place)))


def distance_at(seen: Observation, place: Array, time: float) -> float:
    """Distance of a ball from a place at about a given time [m]."""
    after = int(np.searchsorted(seen.time, time))
    near = range(max(after - 1, 0), min(after + 1, len(seen.time)))
    k = min(near, key=lambda one: abs(seen.time[one] - time))
    return float(np.hypot(*(seen.xy[k] - place)))


def _began(time: Array, off: Array) -> float | None:
    """When a ball that slides, then rolls, began to move, from its first samples relative to its place [s]."""
    far = float(np.hypot(*off[-1]))
    if far < REST_M:
        return None
    along = off @ (off[-1] / far)
    when, speed = float(time[0]), 1.0
    for _ in range(BEGIN_ROUNDS):
        sliding = np.minimum(time - when, 2 * speed / (7 * SLIDE_M_S2))
        lost = SLIDE_M_S2 * sliding * (time - when - sliding / 2)
        speed, start = np.polyfit(time - time[0], along + lost, 1)
        if speed < MIN_STRUCK_SPEED:
            return None
        when = float(time[0] - start / speed)
    return when


def _position(seen: Observation, when: float) -> Array | None:
    """Position of a ball at a time, extrapolated from smooth motion [m]; None if it was unseen or not smooth."""
    end = int(np.searchsorted(seen.time, when))
    part = slice(max(end - STRIKING_SAMPLES, 0), end)
    time, xy = seen.time[part] - when, seen.xy[part]
    if len(time) < STRIKING_SAMPLES or -time[-1] > 2 * float(np.median(np.diff(time))):
        return None
    if float(np.hypot(*(xy[-1] - xy[0]))) < MIN_STRIKING_M:
        return None
    fit = np.polyfit(time, xy, 2)
    bent = xy - np.vander(time, 3) @ fit
    return np.asarray(fit[-1]) if float(np.sqrt(np.mean(bent**2))) < MAX_BENT_M else None
