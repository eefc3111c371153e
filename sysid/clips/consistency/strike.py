"""The strike in a clip: a recording may begin before it, and shows which ball the cue strikes.

In: the track of a ball, or a clip. Out: the first sample after the strike, and the clip from there on.

A struck ball is fastest at once, so a ball that moves a step d from sample to sample would have moved at least n d in n
samples before. Where it moved half as much at most, it was at rest, until its first speed leads back to its place.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from models.shot import Array
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.contradiction import is_sound
from sysid.clips.names import CLIPS_TOML

STAMP_DECIMALS = 9  # of seconds: differences of stamps are rounded to them, so that the clock's origin leaves no trace
REST_M = 0.003  # a ball within this distance of its first place has not moved
MIN_MISSED_M = 0.006  # least distance that a ball would have covered at its first speed, beyond what noise imitates
REST_SHARE = 0.5  # largest share of that distance for a ball that was at rest
MAX_RESTING_TURN_RAD = 0.3  # largest turn of the mark of a ball at rest
SPEED_STEPS = 3  # steps from sample to sample whose mean is the first speed
MIN_MOVED_M = 0.02  # least motion of another ball before the strike for it to be the struck one
MIN_CLIPS = 2  # fewest clips that show another ball struck for a report on the set


def first_moving(seen: Observation) -> int:
    """Index of the first sample from which on a ball has left its first place; their number if it never has."""
    away = np.append(np.hypot(*(seen.xy - seen.xy[:1]).T) > REST_M, np.ones(SPEED_STEPS, bool))
    for k in np.flatnonzero(away[: len(seen.time)]).tolist():
        if away[k : k + SPEED_STEPS + 1].all():
            return int(k)
    return len(seen.time)


def strike_time(seen: Observation) -> float | None:
    """When a ball that was at rest began to move [s]; None where it moves from the start, or never."""
    first = first_moving(seen)
    last = min(first + SPEED_STEPS, len(seen.time) - 1)
    if first < 2 or last <= first:
        return None
    if np.nan_to_num(np.abs(seen.theta[:first] - seen.theta[0])).max() > MAX_RESTING_TURN_RAD:
        return None  # it spins in place
    rest = np.median(seen.xy[:first], axis=0)
    speed = float(np.hypot(*(seen.xy[last] - seen.xy[first])) / (seen.time[last] - seen.time[first]))
    if float(np.hypot(*(seen.xy[last] - rest))) < 2 * REST_M:
        return None
    missed = speed * float(seen.time[first - 1] - seen.time[0])
    if missed < MIN_MISSED_M or float(np.hypot(*(seen.xy[first - 1] - seen.xy[0]))) > REST_SHARE * missed:
        return None
    back = float(np.hypot(*(seen.xy[first] - rest))) / speed
    return max(float(seen.time[first]) - back, float(seen.time[first - 1]))


def from_strike(clip: Clip) -> Clip:
    """The clip from the strike on; unchanged if it begins with it, or if another ball moves first."""
    if clip.running:
        return clip
    seen = clip.balls.get(clip.struck)
    began = None if seen is None or not is_sound(clip) else strike_time(seen)
    if seen is None or began is None or moves_first(clip) != clip.struck:
        return clip
    start = float(seen.time[np.searchsorted(seen.time, began)])
    balls = {name: after_time(one, start) for name, one in clip.balls.items()}
    return dataclasses.replace(
        clip, balls={name: one for name, one in balls.items() if len(one.time)}, origin=clip.origin + start
    )


def after_time(seen: Observation, start: float) -> Observation:
    """The samples of a ball from a time on [s], which becomes 0."""
    kept = seen.at(np.flatnonzero(seen.time >= start))
    return dataclasses.replace(kept, time=np.round(kept.time - start, STAMP_DECIMALS))


def struck_fault(clip_set: ClipSet) -> tuple[str, str] | None:
    """Fault for clips in which another ball moves while the struck one rests: file and message."""
    struck = [clip for clip in clip_set.clips if not clip.running]
    wrong = [(clip, first) for clip in struck if (first := moves_first(clip)) != clip.struck]
    if len(wrong) < MIN_CLIPS:
        return None
    clip, first = wrong[0]
    more = f" ({len(wrong) - 1} more clips are so)" if len(wrong) > 1 else ""
    text = f"struck = {clip.struck!r} of {clip.file}, but {first!r} moves while that one rests{more}"
    return CLIPS_TOML, f"{text}: name the ball that the cue strikes, which moves first"


def moves_first(clip: Clip) -> str:
    """The ball that the cue must have struck: the one named, unless it rests while another moves."""
    named = clip.balls.get(clip.struck)
    began = -np.inf if named is None else _rests_until(named)
    early: dict[str, float] = {}
    for name, seen in clip.balls.items():
        before = seen.time < began
        if name == clip.struck or not before.any():
            continue
        way: Array = np.hypot(*(seen.xy[before] - seen.xy[:1]).T)
        if way.max() > MIN_MOVED_M:
            early[name] = float(seen.time[np.argmax(way > REST_M)])
    return min(early, key=lambda name: early[name]) if early else clip.struck


def _rests_until(seen: Observation) -> float:
    """Time that a ball rests from its first sample on [s]."""
    if first_moving(seen) == len(seen.time):
        return np.inf
    began = strike_time(seen)
    return -np.inf if began is None else began
