"""Start value and prior of a shot's initial state.

In: a clip: the cue's command, or the first samples. Out: start, prior mean and standard deviation, and azimuth.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.segments import free_from
from sysid.clips.tracker.noise import smooth_noise
from sysid.estimation.problem import Array, turn

LINE_SAMPLES = 6  # a straight line through these samples gives position and velocity
COMMAND_SD = {"speed": 0.05, "azimuth": 0.02, "offset": 0.002}  # sd of a shot about its command
MISCUE_SPIN = 1.25  # R omega over v at the miscue limit: 5/2 of half a radius
RUNNING_SPIN = 2.0  # factor for a ball that is already moving: its sidespin outlasts its speed
MIN_MARKS = 8  # fewest angles of a mark that determine the sidespin
MIN_SD_M_S = 0.02  # least sd of a velocity or R omega from a command [m/s]


def straight(time: Array, xy: Array, roll: float) -> tuple[Array, float]:
    """Initial state (7,) from a straight line through samples, with `roll` times natural roll, and its azimuth."""
    line = _line(time, xy)
    speed = float(np.hypot(*line[1]))
    azimuth = float(np.arctan2(line[1, 1], line[1, 0]))
    return np.array([*line[0], speed, 0, 0, roll * speed, 0]), azimuth


def running_sd(speed: float) -> Array:
    """Prior sd of the initial state of a ball that an impact or a strike set in motion: (7,)."""
    return np.array([np.inf] * 4 + [RUNNING_SPIN * speed + 0.05] * 3)


def shot_start(clip: Clip, clip_set: ClipSet, noise: float, hit: float) -> tuple[Array, Array, Array, float]:
    """Start, mean and standard deviation of a shot's initial state, (7,) each, and its azimuth.

    `hit` is the time of the struck ball's first impact [s]; later samples do not show the direction of the strike.
    """
    seen, radius = clip.balls[clip.struck], clip_set.ball.radius
    low = 0 if clip.running else free_from(seen, noise)
    before = int(np.searchsorted(seen.time, hit))
    part = slice(low, min(low + LINE_SAMPLES, max(before, low + 2)))
    x, azimuth = straight(seen.time[part], seen.xy[part], 1.0 if clip.running else 0.5)
    marked = np.flatnonzero(np.isfinite(seen.theta))
    sd = np.full(7, np.inf)
    if marked.size > 3:
        first = marked[: max(4, marked.size // 10)]
        x[6] = radius * np.polyfit(seen.time[first], seen.theta[first], 1)[0]
    if clip.running:
        sd = running_sd(x[2])
        sd[6] = np.inf if marked.size > MIN_MARKS else sd[6]
        return x, x.copy(), sd, azimuth
    if clip.cue is not None:
        cue = clip.cue
        azimuth = cue.azimuth
        line = _line(seen.time[part], seen.xy[part])
        v = turn(azimuth).T @ line[1]
        lever = 2.5 * cue.speed / radius
        x = np.array([*line[0], *v, lever * cue.side * np.sin(cue.elevation), lever * cue.height, lever * cue.side])
        across = COMMAND_SD["azimuth"] * cue.speed + MIN_SD_M_S
        spread = COMMAND_SD["offset"] * lever + MIN_SD_M_S
        mean = np.array([*line[0], cue.speed, 0.0, *x[4:]])
        along = COMMAND_SD["speed"] * cue.speed + MIN_SD_M_S
        sd[2:] = [along, across, 0.05 * cue.speed + MIN_SD_M_S, spread, spread]
        return x, mean, sd, azimuth
    speed = x[2]
    wide = 0.6 * MISCUE_SPIN * speed + MIN_SD_M_S
    sd[4:] = [0.1 * speed + MIN_SD_M_S, wide, np.inf if marked.size > MIN_MARKS else wide]
    return x, x.copy(), sd, azimuth


def running_start(seen: Observation) -> tuple[Array, Array]:
    """Position (2,) [m] at time 0, and velocity and R omega (5,) [m/s] of a rolling ball, table frame."""
    position, velocity = _line(seen.time[:LINE_SAMPLES], seen.xy[:LINE_SAMPLES])
    return position, np.array([*velocity, -velocity[1], velocity[0], 0.0])


def theta_noise(clips: Sequence[Clip]) -> float:
    """Noise of the marks' angles from their third differences [rad]; 1 if no ball is marked."""
    found = []
    for clip in clips:
        for seen in clip.balls.values():
            theta = seen.theta[np.isfinite(seen.theta)]
            if len(theta) > 8:
                found.append(np.diff(theta, 3))
    if not found:
        return 1.0
    return max(smooth_noise(np.concatenate(found)), 1e-4)


def _line(time: Array, xy: Array) -> Array:
    """Position at time 0 and velocity of a straight line through samples: (2, 2) [m], [m/s]."""
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(time), time]), xy, rcond=None)
    return np.asarray(line)
