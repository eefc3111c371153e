"""Tracked balls cut into segments: the smooth motion between two impacts.

In: clips, with their table, ball size, noise and frame rate. Out: `Cut`s (impacts seen in the tracks) and `Segment`s.

An impact at a cushion shows as a change of sign of the velocity towards it, close to it; a ball-ball impact as a local
minimum of the distance of two tracks near 2R. The sample next to an impact belongs to neither side (trackers clamp and
smear there). A near miss may cut a smooth motion in two, which costs one sample; an impact that is not detected shows
as a segment that does not fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import UNKNOWN_SESSION, Array, Session, Table
from models.shot import Ball as BallSize
from sysid.clips.clip_set import Clip, Observation

MAX_IMPACT_GAP_S = 0.15  # longest time between the segments before and after an impact
MAX_TURN_GAP_M = 0.03  # largest distance of an impact from the cushion, beyond a frame's travel
SLOPE_SAMPLES = 5  # samples on each side of a slow impact, for the velocities before and after
MAX_SLOW_HIT_GAP_M = 0.006  # largest distance of a slow impact's nearest sample from the cushion
MAX_EVEN_FRAMES = 1.5  # longest interval between samples of a tracker that left out none
MAX_ONSET_ERROR_FRAMES = 2.0  # largest error of the moment at which a ball began to move
CLAMP_MARGIN_M = 0.002  # samples closer to a cushion may be clamped by the tracker: they are not used


@dataclass(frozen=True)
class Cut:
    """An impact seen in a track: the sample next to it, and what was hit."""

    sample: int
    kind: str  # "ball", "cushion"
    with_: str  # the other ball, or the rail


@dataclass(frozen=True)
class Segment:
    """Samples of one ball between two impacts."""

    clip: int
    ball: str
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) [m]
    before: str  # "strike", "ball", "cushion"; "start" of a clip that begins in mid-motion
    after: str  # "ball", "cushion", "end"
    rail: str = ""  # of the cushion before
    session: Session = UNKNOWN_SESSION  # of its clip


def moving_from(seen: Observation, sigma: float) -> int:
    """Number of initial samples in which a ball still rests at its first place."""
    moved = np.hypot(*(seen.xy - seen.xy[0]).T) > moving_m(sigma)
    return int(np.argmax(moved)) if moved.any() else len(moved)


def moving_m(sigma: float) -> float:
    """Distance from its first place by which a ball has moved, at a noise [m]."""
    return max(6 * sigma, 0.003)


def onsets(clip: Clip, sigma: float, fps: float) -> dict[str, Observation]:
    """The tracks of a clip from the onset of each ball's motion on, see `onset`; of a running ball the whole track."""
    return {n: seen if n in clip.running else onset(seen, sigma, fps) for n, seen in clip.balls.items()}


def onset(seen: Observation, sigma: float, fps: float) -> Observation:
    """The track from the onset of motion on, with one resting sample at that moment.

    The onset is a frame before the first sample in motion. If the tracker writes no samples of resting and slow balls,
    it is the moment to which the ball's first speed leads back.
    """
    first = moving_from(seen, sigma)
    if first == len(seen.time):
        return Observation(seen.time[:1], seen.xy[:1], seen.theta[:1])
    silent = seen.time[first] - seen.time[first - 1] > MAX_EVEN_FRAMES / fps
    # It moves from the start, unless so fast a ball would have been seen before.
    if not silent and (first == 1 or np.hypot(*(seen.xy[first - 1] - seen.xy[0])) > 4 * sigma):
        return seen
    time = seen.time[first - 1 :].copy()
    began = _back_to_rest(time, seen.xy[first - 1 :]) if silent else time[1] - 1 / fps
    time[0] = max(time[0], began)
    return Observation(time, seen.xy[first - 1 :], seen.theta[first - 1 :])


def _back_to_rest(time: Array, xy: Array) -> float:
    """When a ball left its first place, from its speed between the next two samples [s]."""
    if len(time) < 3:
        return float(time[0])
    first, second = np.hypot(*(xy[1] - xy[0])), np.hypot(*(xy[2] - xy[1]))
    return float(time[1] - (time[2] - time[1]) * first / second) if second > 0 else float(time[0])


def cushion_cuts(time: Array, xy: Array, table: Table, ball: BallSize, sigma: float) -> list[Cut]:
    """Samples at which the motion turns away from a cushion.

    A fast impact shows from one frame to the next, a slow one in the velocities fitted before and after.
    """
    limits = table.centre_limits(ball)
    cuts = []
    step = np.diff(xy, axis=0)
    for axis, letter in enumerate("xy"):
        for sign, mark in ((1.0, "+"), (-1.0, "-")):
            gap = limits[axis] - sign * xy[:, axis]
            inward = sign * step[:, axis]
            size = np.abs(step[:, axis])
            room = MAX_TURN_GAP_M + 0.5 * np.maximum(size[:-1], size[1:])
            turns = (inward[:-1] > 0) & (inward[1:] <= 0) & (inward[:-1] - inward[1:] > 5 * sigma)
            found = (1 + np.flatnonzero(turns & (gap[1:-1] < room))).tolist()
            for k in (SLOPE_SAMPLES + np.flatnonzero(gap[SLOPE_SAMPLES:-SLOPE_SAMPLES] < MAX_SLOW_HIT_GAP_M)).tolist():
                window = gap[k - SLOPE_SAMPLES : k + SLOPE_SAMPLES + 1]
                if gap[k] == window.min() and all(abs(k - f) > 2 for f in found):
                    before, after = (
                        float(np.polyfit(time[part], gap[part], 1)[0])
                        for part in (slice(k - SLOPE_SAMPLES, k), slice(k + 1, k + SLOPE_SAMPLES + 1))
                    )
                    span = (time[k + SLOPE_SAMPLES] - time[k - SLOPE_SAMPLES]) / (2 * SLOPE_SAMPLES)
                    noise = sigma / span * np.sqrt(12 / (SLOPE_SAMPLES * (SLOPE_SAMPLES**2 - 1)))
                    if before < 0 < after and after - before > 8 * noise:
                        found.append(k)
            cuts += [Cut(k, "cushion", mark + letter) for k in found]
    return cuts


def ball_cuts(name: str, time: Array, others: dict[str, Observation], xy: Array, ball: BallSize) -> list[Cut]:
    """Samples at which the distance to another ball has a minimum near one diameter.

    A ball that begins to move just then need not be as near, since that moment is known to a frame or two only.
    """
    cuts = []
    step = np.hypot(*np.diff(xy, axis=0).T)
    way = np.maximum(np.concatenate([[0.0], step]), np.concatenate([step, [0.0]]))
    frame = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for other, track in others.items():
        if other == name:
            continue
        there = np.column_stack([np.interp(time, track.time, track.xy[:, k]) for k in (0, 1)])
        distance = np.hypot(*(xy - there).T)
        change = np.abs(np.diff(distance))
        around = np.concatenate([[np.inf], distance, [np.inf]])
        travel = np.maximum(np.concatenate([[0.0], change]), np.concatenate([change, [0.0]]))
        begins = (np.abs(time - track.time[0]) < MAX_ONSET_ERROR_FRAMES * frame) & (len(track.time) > 1)
        margin = np.where(begins, way, 0.6 * travel) + 0.003
        near = (distance <= np.minimum(around[:-2], around[2:])) & (distance < ball.diameter + margin)
        cuts += [Cut(int(k), "ball", other) for k in np.flatnonzero(near)]
    return cuts


def cuts_of(name: str, tracks: dict[str, Observation], table: Table, ball: BallSize, sigma: float) -> list[Cut]:
    """All impacts of one ball among the tracks of a clip, in order."""
    seen = tracks[name]
    cuts = cushion_cuts(seen.time, seen.xy, table, ball, sigma) + ball_cuts(name, seen.time, tracks, seen.xy, ball)
    return sorted(cuts, key=lambda cut: cut.sample)


def event_times(clip: Clip, table: Table, ball: BallSize, sigma: float, fps: float) -> Array:
    """Times of the impacts of the struck ball, or of those that run when the clip begins: (n,) [s]."""
    tracks = onsets(clip, sigma, fps)
    return np.unique([
        tracks[name].time[cut.sample]
        for name in clip.first
        for cut in cuts_of(name, tracks, table, ball, sigma)
    ])  # fmt: skip


def split(number: int, clip: Clip, table: Table, ball: BallSize, sigma: float, fps: float) -> list[Segment]:
    """Segments of every moving ball of a clip, in order of ball and time."""
    tracks = onsets(clip, sigma, fps)
    found = []
    for name, seen in tracks.items():
        if len(seen.time) < 3:
            continue
        cuts = cuts_of(name, tracks, table, ball, sigma)
        low, before, rail = 1, "ball", ""
        if name in clip.running:
            low, before = 0, "start"
        elif name == clip.struck:
            low, before = free_from(seen, sigma), "strike"
        for cut in [*cuts, Cut(len(seen.time), "end", "")]:
            part = slice(low, cut.sample)
            if cut.sample - low >= 1:
                inside = _trusted(seen.xy[part], table, ball)
                time, xy = seen.time[part][inside], seen.xy[part][inside]
                if len(time):
                    found.append(Segment(number, name, time, xy, before, cut.kind, rail, clip.session))
            low, before, rail = cut.sample + 1, cut.kind, cut.with_ if cut.kind == "cushion" else ""
    return found


def free_from(seen: Observation, sigma: float) -> int:
    """First sample of a struck ball after the strike: from there on its speed does not rise."""
    step = np.hypot(*np.diff(seen.xy, axis=0).T) / np.diff(seen.time)
    low = 0
    while low < min(2, len(step) - 1):
        slack = max(0.12 * step[low + 1], 6 * sigma / np.diff(seen.time)[low])
        if step[low] > step[low + 1] - slack:
            break
        low += 1
    return low


def _trusted(xy: Array, table: Table, ball: BallSize) -> NDArray[np.bool_]:
    """Samples not so close to a cushion that a tracker may have clamped them."""
    edge = np.array([table.length / 2, table.width / 2]) - ball.radius
    return np.all(np.abs(xy) < edge - CLAMP_MARGIN_M, axis=1)


def split_all(
    clips: Sequence[Clip], table: Table, ball: BallSize, sigma: float, fps: float, least: int = 5
) -> list[Segment]:
    """Segments of a clip set with at least so many samples."""
    found = [s for k, clip in enumerate(clips) for s in split(k, clip, table, ball, sigma, fps)]
    return [s for s in found if len(s.time) >= least]
