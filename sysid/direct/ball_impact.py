"""Restitution of the balls.

In: segments with their fitted slide and roll. Out: `Single` values of the restitution.

Velocities of both balls are taken at the instant at which their centres are 2R apart, and resolved along the line
between them; the other ball was at rest. Friction between the balls changes their ratio by 0.001 at most.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sysid.clips import ClipSet
from sysid.clips.segments import Segment
from sysid.direct.at_impact import (
    MAX_IMPACT_SD,
    MIN_APPROACH_M_S,
    Before,
    Known,
    motion_after,
    motion_before,
    next_segment,
)
from sysid.direct.measured import Kind, Single
from sysid.direct.slide_roll import Array, SegmentMotion, positions

MAX_CUT_RAD = np.radians(55.0)  # widest angle between the velocity and the line of centres
RESTING_MOTION_M = 0.002  # apparent motion of a ball at rest
BALL_RESTITUTION = Kind(
    "ball_impact.restitution", "1", "impacts", "velocities of both balls along the line of centres",
    "film balls that run into resting ones", 1.0, "ball_restitution_speed", "s/m",
)  # fmt: skip


@dataclass(frozen=True)
class Touch:
    """A ball that touches one at rest."""

    time: float  # [s]
    ball: str  # the one at rest
    rest: Array  # (2,) its position [m]
    rest_sd: float  # [m]


def collisions(found: Sequence[SegmentMotion], clip_set: ClipSet, known: Known) -> list[Single]:
    """Restitution of every impact of a ball on one at rest."""
    singles = []
    for k in found:
        s = k.segment
        before = motion_before(k, known) if s.after == "ball" else None
        touch = _touch(before, s, clip_set, known) if before is not None else None
        if before is None or touch is None:
            continue
        following = [
            next_segment(found, s.clip, ball, "ball", touch.time - known.frame) for ball in (s.ball, touch.ball)
        ]
        fits = [fit for t in following if t is not None and (fit := motion_after(t, touch.time, known)) is not None]
        if len(fits) < 2:
            continue
        (into, cov_into), (one, cov_one), (two, cov_two) = (
            before.fit.state(touch.time - before.start), *(fit.state(0.0) for fit in fits)
        )  # fmt: skip
        line = (touch.rest - into[:2]) / np.hypot(*(touch.rest - into[:2]))
        cross = np.array([-line[1], line[0]])
        v, out, hit = into[2:], two[2:] - one[2:], two[2:]
        closing = float(v @ line)
        oblique = abs(v @ cross) > math.tan(MAX_CUT_RAD) * closing or abs(hit @ cross) > 0.2 * hit @ line
        if closing < MIN_APPROACH_M_S or oblique:
            continue
        e = float(out @ line) / closing
        by_turn = (float(out @ cross) - e * float(v @ cross)) / closing  # de per turn of the line of centres
        turn_sd = math.hypot(math.sqrt(cross @ cov_into[:2, :2] @ cross), touch.rest_sd) / clip_set.ball.diameter
        errors = [math.sqrt(line @ cov[2:, 2:] @ line) / closing for cov in (cov_one, cov_two, e**2 * cov_into)]
        sd = math.hypot(*errors, by_turn * turn_sd * math.hypot(*v) / closing)
        if sd < MAX_IMPACT_SD and 0.3 < e < 1.3:
            singles.append(Single(clip_set.clips[s.clip].file, s.ball, touch.time, e, sd, closing))
    return singles


def _touch(before: Before, s: Segment, clip_set: ClipSet, known: Known) -> Touch | None:
    """When a ball touches one at rest; None where it touches none, or where a third one is near."""
    rests = {}
    for name, seen in clip_set.clips[s.clip].balls.items():
        xy = seen.xy[: max(int(np.sum(seen.time <= s.time[-1])), 1)]
        if name != s.ball and np.abs(xy - np.median(xy, axis=0)).max() < max(5 * known.sigma, RESTING_MOTION_M):
            rests[name] = xy.mean(axis=0), known.sigma / math.sqrt(len(xy))
    start = before.start
    times = s.time[-1] - start + np.linspace(-1.0, 4.0, 400) * max(known.frame, float(s.time[-1] - s.time[-2]))
    path = positions(before.fit.parameters[None], times)[0]
    size = clip_set.ball.diameter
    for name, (rest, sd) in rests.items():
        gap = np.hypot(*(path - rest).T) - size
        at = int(np.argmax(gap < 0))
        if gap[at] >= 0 or at == 0:
            continue
        others = [other for n, (other, _) in rests.items() if n != name]
        if any(np.hypot(*(other - rest)) < size + 2 * RESTING_MOTION_M for other in others):
            return None
        part = gap[at - 1] / (gap[at - 1] - gap[at])
        return Touch(start + float(times[at - 1] + part * (times[at] - times[at - 1])), name, rest, sd)
    return None
