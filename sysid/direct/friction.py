"""Frictions of the cloth: decelerations of balls that slide, roll, or spin.

In: segments with their fitted slide and roll, or the marks' angles. Out: `Single` values of a deceleration.

* sliding, mu_s: slide and roll joined at a fitted instant, in the plane, with the slip in any direction; while sliding,
  the velocity changes by d = -2/7 of the slip, at mu_s g;
* rolling, mu_r: path length s = s0 + v t - 1/2 mu_r g t^2 of every segment that rolls, until the ball stops;
* sidespin: the mark's angle between two events, a = a0 + w t - 1/2 alpha t^2 until it stops.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from models.shot import GRAVITY
from sysid.clips import ClipSet, Observation
from sysid.clips.segments import cuts_of
from sysid.clips.tracker.noise import smooth_noise
from sysid.direct.deceleration import fit_deceleration, path_length
from sysid.direct.measured import Kind, Single
from sysid.direct.slide_roll import LN_SLIDE, SegmentMotion

MIN_SAMPLES = 8  # fewest samples of a segment for a friction
MAX_CHI2 = 9.0  # largest reduced chi-square of a fit that is used
MAX_SLIDE_SD, MAX_DECELERATION_SD = 0.12, 0.2  # largest relative sd of a value that is used
MIN_SLIDE_DECELERATION_M_S2 = 0.4
MIN_TURN_RAD = 0.5  # least turn of a spinning ball's mark
TURN_TOLERANCE_RAD = 0.15  # deviation from the last angle within which the mark may be at rest

SLIDE_FRICTION = Kind(
    "decoupled_cloth.slide", "1", "segments", "slide and roll joined at an unknown instant",
    "film stun, draw or follow shots at 1 m/s or more", GRAVITY, "slide_friction_speed", "1/s",
)  # fmt: skip
ROLL_FRICTION = Kind(
    "decoupled_cloth.roll", "1", "segments", "constant deceleration along the path while rolling",
    "film balls that roll for a second or more", GRAVITY, "speed_drag (or air_drag)", "1/s", True,
)  # fmt: skip
SPIN_FRICTION = Kind(
    "decoupled_cloth.spin", "rad/s^2", "segments", "constant deceleration of the turned angle",
    "film a marked ball spun on the spot", 1.0, "spin_decay_speed", "rad/s^2 per m/s",
)  # fmt: skip


def sliding(found: Sequence[SegmentMotion], files: Sequence[str]) -> list[Single]:
    """Deceleration of every slide that is long enough to determine it [m/s^2]; names of the clips' files."""
    singles = []
    for k in found:
        p, cov = k.fit.parameters, k.fit.covariance
        value, relative_sd, size = math.exp(p[LN_SLIDE]), math.sqrt(cov[LN_SLIDE, LN_SLIDE]), math.hypot(*p[4:6])
        certain = relative_sd < MAX_SLIDE_SD and size > 5 * math.sqrt(max(cov[4, 4], cov[5, 5]))
        if certain and value > MIN_SLIDE_DECELERATION_M_S2 and k.fit.chi2 < MAX_CHI2:
            slip = 1.75 * size if math.isfinite(k.rolls) else math.nan  # mean of what falls from 7/2 |d| to 0
            where = files[k.segment.clip], k.segment.ball, float(k.segment.time[0])
            singles.append(Single(*where, value, relative_sd * value, slip, math.atan2(p[3], p[2])))
    return singles


def rolling(found: Sequence[SegmentMotion], files: Sequence[str], sigma: float) -> list[Single]:
    """Deceleration of every segment that rolls far enough [m/s^2]; sigma is the noise per axis [m]."""
    singles = []
    for k in found:
        use = k.segment.time >= k.rolls
        path = path_length(k.segment.xy[use]) if use.sum() >= MIN_SAMPLES else None
        if path is None:
            continue
        r = fit_deceleration(k.segment.time[use], path[0], sigma, max(6 * sigma, 0.004))
        if r is not None and r.chi2 < MAX_CHI2 and r.sd < MAX_DECELERATION_SD * r.rate:
            widened = math.sqrt(max(r.chi2, 1.0))
            where = files[k.segment.clip], k.segment.ball, float(k.segment.time[use][0])
            singles.append(Single(*where, r.rate, r.sd * widened, r.at, path[1], r.slope, r.slope_sd * widened))
    return singles


def spinning(clip_set: ClipSet, sigma: float) -> list[Single]:
    """Deceleration of the sidespin of every marked ball between two events [rad/s^2]."""
    singles = []
    for clip in clip_set.clips:
        for name, seen in clip.balls.items():
            if np.isfinite(seen.theta).sum() < MIN_SAMPLES:
                continue
            cuts = [c.sample for c in cuts_of(name, dict(clip.balls), clip_set.table, clip_set.ball, sigma)]
            for low, high in zip([-1, *cuts], [*cuts, len(seen.time)], strict=True):
                part = _turning(seen, low + 1, high)
                if len(part) < MIN_SAMPLES:
                    continue
                t, angle = seen.time[part], seen.theta[part]
                turned = angle * np.sign(angle[len(angle) // 3] - angle[0])
                r = fit_deceleration(t, turned, None, TURN_TOLERANCE_RAD)
                if r is None or r.sd >= MAX_DECELERATION_SD * r.rate or r.speed**2 <= 2 * r.rate * MIN_TURN_RAD:
                    continue
                speed = float(np.hypot(*(seen.xy[part[-1]] - seen.xy[part[0]])) / (t[-1] - t[0]))
                singles.append(Single(clip.file, name, float(t[0]), r.rate, r.sd, speed))
    return singles


def _turning(seen: Observation, low: int, high: int) -> NDArray[np.int64]:
    """Samples from low to high whose angle is seen, without those before the ball begins to turn."""
    part = low + np.flatnonzero(np.isfinite(seen.theta[low:high]))
    if len(part) < MIN_SAMPLES:
        return part
    angle = seen.theta[part]
    begun = np.flatnonzero(np.abs(angle - angle[0]) > 8 * smooth_noise(np.diff(angle, 3)) + 0.02)
    return part[int(begun[0]) if begun.size and begun[0] > 1 else 0 :]
