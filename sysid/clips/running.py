"""Running clips: recordings that begin, or are cut, in mid-motion, so that they show no strike.

In: a clip, the noise of its positions and the frame rate. Out: the clip from the first moment on at which every ball
rests or moves smoothly, so that its samples determine its state, and the balls that move then.

Smooth is a ball whose first samples show no impact (sysid/clips/segments.py) and lie on a parabola, the closed form of
a slide. A ball moves where the halves of its first samples, or of those near its first place, lie apart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np

from models.errors import BadInput
from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.contradiction import is_sound
from sysid.clips.consistency.strike import after_time
from sysid.clips.segments import cuts_of, moving_from, moving_m
from sysid.clips.tracker.noise import position_noise

SMOOTH_SAMPLES = 6  # first samples of each ball, which must hold no impact
MAX_BENT_SD, MAX_BENT_M = 4.0, 3e-4  # largest distance of a smooth motion from a parabola
APART_SHARE = 0.25  # least distance between the halves of a moving ball's first samples, over its displacement
MIN_RUNNING_SAMPLES = 12  # fewest samples of a ball that moves at the start
MAX_LATE_FRAMES = 3.5  # latest first sample of a ball after the start
LAST_SAMPLES = 4  # last samples of a ball that disappears; it rests if they lie in one place
MAX_STARTS = 2000  # most start moments that are tried; longer clips are thinned out
USUAL_SIGMA_M = 5e-4  # assumed noise of positions, if the tracks are too short for an estimate


def begun_running(clip_set: ClipSet) -> tuple[ClipSet, list[str]]:
    """The set with its running clips begun in free motion, and the files of those in which no ball moves."""
    if not any(clip.running for clip in clip_set.clips):
        return clip_set, []
    sigma = usual_noise(clip_set)
    clips, still = list[Clip](), []
    for clip in clip_set.clips:
        found: Clip | None = clip
        if clip.running and is_sound(clip):
            found = begun(clip, clip_set, sigma)
        clips.append(found or clip)
        still += [] if found else [clip.file]
    return dataclasses.replace(clip_set, clips=tuple(clips)), still


def usual_noise(clip_set: ClipSet) -> float:
    """Noise of the positions, one standard deviation per axis [m], or a usual one where the tracks are too short."""
    sound = [clip for clip in clip_set.clips if is_sound(clip)]
    try:
        return position_noise(dataclasses.replace(clip_set, clips=tuple(sound)))
    except BadInput:
        return USUAL_SIGMA_M


def begun(clip: Clip, of: ClipSet, sigma: float) -> Clip | None:
    """The clip from the first free motion on, or else from any motion; see `from_free_motion`."""
    return from_free_motion(clip, of, sigma) or from_free_motion(clip, of, sigma, smooth=False)


def from_free_motion(clip: Clip, of: ClipSet, sigma: float, smooth: bool = True) -> Clip | None:
    """The clip as a running one, from the first moment on at which every ball rests or moves smoothly.

    Args:
        clip: whose strike is not seen; its struck ball stays the first of those that move, where it is one.
        of: the set with its table, ball and frame rate.
        sigma: noise, one standard deviation per axis [m].
        smooth: whether motion must be smooth at first; else a ball that moves is enough.

    Returns:
        None where there is no such moment, or too few samples follow.
    """
    tracks = clip.balls.values()
    impacts = {name: _impacts(name, clip, of, sigma) for name in clip.balls} if smooth else {}
    last = max(float(seen.time[-1]) for seen in tracks)
    bare = {name: Observation(seen.time, seen.xy, seen.theta) for name, seen in clip.balls.items()}
    times = np.unique(np.concatenate([seen.time for seen in tracks]))
    for start in times[:: 1 + len(times) // MAX_STARTS].tolist():
        if start >= last:
            break
        balls = _from(bare, start)
        speeds = _speeds(balls, {name: when - start for name, when in impacts.items()}, sigma, of.fps)
        if not speeds:
            continue
        moving = sorted(speeds, key=lambda name: (name != clip.struck, -speeds[name], name))
        if max(len(balls[name].time) for name in moving) < MIN_RUNNING_SAMPLES:
            continue
        balls, origin = _from(clip.balls, start), clip.origin + start
        return dataclasses.replace(
            clip, struck=moving[0], balls=balls, cue=None, running=tuple(moving), origin=origin
        )  # fmt: skip
    return None


def starts_moving(clip: Clip, sigma: float) -> list[str]:
    """Balls that move smoothly from the clip's first frame on."""
    found, begin = [], min(float(seen.time[0]) for seen in clip.balls.values())
    for name, seen in clip.balls.items():
        first = seen.xy[:SMOOTH_SAMPLES]
        if seen.time[0] <= begin and len(first) == SMOOTH_SAMPLES:
            is_smooth = _bent(seen.time[:SMOOTH_SAMPLES], first) < max(MAX_BENT_SD * sigma, MAX_BENT_M)
            if is_smooth and moves_at_first(seen, sigma):
                found.append(name)
    return found


def _from(balls: Mapping[str, Observation], start: float) -> dict[str, Observation]:
    """The tracks from a time on, which becomes 0; a ball last seen at rest before keeps its place."""
    found = {}
    for name, seen in balls.items():
        part = after_time(seen, start)
        if len(part.time):
            found[name] = part
        elif np.ptp(seen.xy[-LAST_SAMPLES:], axis=0).max() < moving_m(0.0):
            found[name] = Observation(np.zeros(1), seen.xy[-1:], np.full(1, np.nan))
    return found


def _impacts(name: str, clip: Clip, of: ClipSet, sigma: float) -> Array:
    """Times of the impacts that are seen in a ball's track [s]."""
    seen = clip.balls[name]
    return seen.time[[cut.sample for cut in cuts_of(name, dict(clip.balls), of.table, of.ball, sigma)]]


def _speeds(
    balls: Mapping[str, Observation], impacts: Mapping[str, Array], sigma: float, fps: float
) -> dict[str, float] | None:
    """Speeds of the balls that move at time 0 [m/s]; None where some ball's motion is not determined by its samples.

    Args:
        balls: tracks from time 0 on.
        impacts: times of those of each ball [s]; none where motion need not be smooth.
        sigma: noise, one standard deviation per axis [m].
        fps: frame rate [1/s].
    """
    found = {}
    for name, seen in balls.items():
        moves = moves_at_first(seen, sigma)
        first = slice(0, SMOOTH_SAMPLES)
        if moves and (seen.time[0] > MAX_LATE_FRAMES / fps or len(seen.time) < SMOOTH_SAMPLES):
            if not impacts:
                continue
            return None
        if impacts and len(seen.time) >= SMOOTH_SAMPLES:
            bent = _bent(seen.time[first], seen.xy[first]) > max(MAX_BENT_SD * sigma, MAX_BENT_M)
            hit = moves and bool(((impacts[name] >= 0) & (impacts[name] <= seen.time[SMOOTH_SAMPLES - 1])).any())
            if bent or hit:
                return None
        if moves:
            step, way = seen.time[SMOOTH_SAMPLES - 1] - seen.time[0], seen.xy[SMOOTH_SAMPLES - 1] - seen.xy[0]
            found[name] = float(np.hypot(*way) / step)
    return found


def moves_at_first(seen: Observation, sigma: float) -> bool:
    """Whether a ball moves from its first sample on, rather than rests until it is hit."""
    near = moving_from(seen, sigma)
    if near == len(seen.time) or len(seen.time) < 2:
        return False
    xy = seen.xy[: max(near, SMOOTH_SAMPLES)]
    half = len(xy) // 2
    apart = np.hypot(*(xy[half:].mean(axis=0) - xy[:half].mean(axis=0)))
    return bool(apart > APART_SHARE * moving_m(sigma))


def _bent(time: Array, xy: Array) -> float:
    """Largest distance of samples from a parabola [m]."""
    powers = np.vander((time - time[0]) / max(float(time[-1] - time[0]), 1e-9), 3)
    fit, *_ = np.linalg.lstsq(powers, xy, rcond=None)
    return float(np.hypot(*(xy - powers @ fit).T).max())


def running_line(clips: Sequence[Clip]) -> str | None:
    """A line on how many clips begin in mid-motion; None if none does."""
    count = sum(bool(clip.running) for clip in clips)
    if not count:
        return None
    return f"{count} of {len(clips)} clips begin{'s' * (count == 1)} in mid-motion, without a strike"
