"""Plausibility of times: frame rate, speeds, and the deceleration of rolling balls.

In: a `ClipSet`. Out: `Contradiction`s.

    frame rate  intervals of the stamps are whole frames
    speeds      no cue gives a ball more than some 13 m/s
    rolling     cloths slow a rolling ball by 0.04 to 0.2 m/s^2: Mathavan, Jackson, Parkin 2009 measured 0.125 on
                snooker cloth, pool cloths have 0.05 to 0.15, heated ones of carom 0.045. In another unit of time, k
                times as long, it is k^2 times as small. What lies beyond all of these is a fault, as a fit of it takes
                minutes and says nothing; who has checked the times on such a cloth says so: times_checked = true
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.report.numbers import SDS_OF_95_PERCENT
from models.shot import MAX_SPEED_M_S
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.aims import reading_command
from sysid.clips.consistency.contradiction import ALL_CLIPS, Contradiction
from sysid.clips.names import CLIPS_TOML
from sysid.clips.segments import split_all
from sysid.clips.tracker.clock import sample_intervals
from sysid.clips.trust import CAMERA_KEY

MIN_INTERVALS = 20
SOUND_INTERVAL = 0.1  # relative departure of the stamps' interval from a frame's; fits include the clock's scale
MIN_EVEN_SHARE = 0.7  # least share of equal intervals for stamps to have a rate
MAX_CUE_SPEED = 13.0  # speed of a hard break [m/s]
SPEED_STEPS = 5  # steps whose median is a speed: single samples may be misplaced
SOUND_ROLLING, CERTAIN_ROLLING = (0.035, 0.3), (0.02, 0.6)  # outside: doubtful, and certainly wrong [m/s^2]
USUAL_ROLLING = 0.1  # [m/s^2]
DEFAULT_SIGMA_M = 0.001  # assumed noise of positions, if unknown
MIN_SEGMENT_SAMPLES, MIN_ROLLING_M = 14, 0.1  # fewest samples and shortest path of a motion for a deceleration
MAX_ROLLING_ERROR_M = 0.003  # largest rms residual of an evenly decelerated motion
CHECKED_KEY = "times_checked"  # of [camera]
ROLLS_FROM = 0.4  # share of a motion after which most balls have stopped sliding
MIN_ROLLING_SEGMENTS = 4


def frame_rate(clip_set: ClipSet, times_are_wrong: bool = False) -> Contradiction | None:
    """Contradiction of stamps and stated frame rate; `times_are_wrong` if the motions contradict the times as well."""
    pooled = sample_intervals(clip_set.clips)
    if len(pooled) < MIN_INTERVALS:
        return None
    step = float(np.median(pooled))
    if abs(step * clip_set.fps - 1) < SOUND_INTERVAL:
        return None
    text = (
        f"fps = {clip_set.fps:g}, but rows are {step:.4g} s apart, as at {1 / step:.4g} frames a second: "
        f"{'' if times_are_wrong else 'correct fps if t is right, else '}multiply t by {1 / (step * clip_set.fps):.4g}"
    )
    frames = step * clip_set.fps
    skipped = frames > 1 and abs(frames / round(frames) - 1) < SOUND_INTERVAL  # as of a tracker that leaves out frames
    even = float(np.mean(np.abs(pooled / step - 1) < SOUND_INTERVAL)) > MIN_EVEN_SHARE
    return Contradiction(CLIPS_TOML, text, even and not skipped)


def speeds(clip_set: ClipSet) -> Contradiction | None:
    """Contradiction by balls faster than any cue can make them."""
    fastest = [(max(map(_top_speed, c.balls.values()), default=0.0), c.file) for c in clip_set.clips]
    fast = [one for one in fastest if one[0] > MAX_CUE_SPEED]
    if not fast:
        return None
    speed, file = max(fast)
    more = f" ({len(fast) - 1} more clips have such)" if len(fast) > 1 else ""
    text = f"a ball moves at {speed:.3g} m/s{more}, and no cue gives more than {MAX_CUE_SPEED:g}: correct t or fps"
    return Contradiction(file, text, speed > MAX_SPEED_M_S)


def _top_speed(seen: Observation) -> float:
    """The largest median speed over some steps [m/s]."""
    if len(seen.time) <= SPEED_STEPS:
        return 0.0
    step = np.hypot(*np.diff(seen.xy, axis=0).T) / np.diff(seen.time)
    return float(np.median(np.lib.stride_tricks.sliding_window_view(step, SPEED_STEPS), axis=1).max())


@dataclass(frozen=True)
class RollingDeceleration:
    """Deceleration of rolling balls: lower quartile over path length, since some still slide and slow down more."""

    rate: float  # [m/s^2]
    interval: tuple[float, float]  # quartiles of the lower and upper 95 % limits of single motions [m/s^2]
    way: float  # [m]


def rolling_deceleration(clip_set: ClipSet) -> RollingDeceleration | None:
    """Deceleration of rolling balls; None if there is too little motion."""
    sigma = clip_set.sigma or DEFAULT_SIGMA_M
    found = []
    clips: list[Clip] = [c for c in clip_set.clips if c.struck in c.balls]
    for part in split_all(clips, clip_set.table, clip_set.ball, sigma, clip_set.fps, MIN_SEGMENT_SAMPLES):
        first = int(ROLLS_FROM * len(part.time))
        time, xy = part.time[first:] - part.time[first:].mean(), part.xy[first:]
        way = float(np.hypot(*(xy[-1] - xy[0])))
        if way < MIN_ROLLING_M:
            continue
        along = (xy - xy[0]) @ (xy[-1] - xy[0]) / way
        fit, covariance = np.polyfit(time, along, 2, cov=True)
        if float(np.sqrt(np.mean((along - np.polyval(fit, time)) ** 2))) < MAX_ROLLING_ERROR_M:
            found.append((-2 * float(fit[0]), 2 * SDS_OF_95_PERCENT * float(np.sqrt(covariance[0, 0])), way))
    if len(found) < MIN_ROLLING_SEGMENTS:
        return None
    rates, errors, ways = np.array(found).T
    low, rate, high = (_lower_quartile(rates + side * errors, ways) for side in (-1, 0, 1))
    return RollingDeceleration(rate, (low, high), float(ways.sum()))


def _lower_quartile(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values, kind="stable")
    return float(values[order][np.searchsorted(np.cumsum(weights[order]), weights.sum() / 4)])


def rolling(clip_set: ClipSet) -> Contradiction | None:
    """Contradiction by decelerations of no real cloth: another unit of time, or the playback rate of a film."""
    found = rolling_deceleration(clip_set)
    if found is None:
        return None
    rate, (lower, upper) = found.rate, found.interval
    (low, high), (least, most) = SOUND_ROLLING, CERTAIN_ROLLING
    if lower < high and low < upper:
        return None
    factor = float(np.sqrt(USUAL_ROLLING / max(rate, 1e-9)))
    times = f", as with t about {max(factor, 1 / factor):.2g} times too {'long' if factor > 1 else 'short'}"
    beyond_doubt = upper < least or most < lower
    camera = clip_set.extra.get(CAMERA_KEY)
    checked = isinstance(camera, dict) and camera.get(CHECKED_KEY) is True
    text = (
        f"rolling balls slow down by {rate:.2g} m/s^2 (over {found.way:.0f} m), on real cloths by 0.04 to 0.2"
        f"{times if rate > 0 else ''}: correct t and fps, such as with: {reading_command(clip_set, '--fps F')}, "
        "F being the true frame rate"
    )
    if beyond_doubt:
        return Contradiction(ALL_CLIPS, text, True)
    if not checked:
        text += f"; if they are right, write {CHECKED_KEY} = true under [{CAMERA_KEY}] of {CLIPS_TOML}"
    return Contradiction(ALL_CLIPS, text, not checked, unless=CHECKED_KEY)
