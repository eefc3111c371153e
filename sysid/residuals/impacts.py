"""Missing velocities after impacts: each segment is simulated beyond the event that ended it.

In: fitted segments, and the tracks of whole shots. Out: `Impacts`.

The state at the end of a segment is fitted to that segment alone, without errors of earlier impacts or of the cloth.
So the initial velocity of the next segment, minus the model's prediction, is the error of the impact alone. It is
resolved along the normal (out of the cushion, or along the line of centres) and the tangent (in the direction of
motion), and divided by the speed of approach.

Left out: a single segment does not determine sidespin, which is taken from the whole shot's track. An impact is skipped
if a segment before or after it is short, if the other ball of a pair was moving, or if the model predicts another
event, or none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.shot import Event, Shot, Track
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, Observation
from sysid.clips.segments import MAX_IMPACT_GAP_S, Segment
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem
from sysid.residuals.collect import MIN_SLIP_M_S, motions
from sysid.residuals.segment_fits import SegmentFits, sidespin

COMPARED_SAMPLE = 2  # sample of the next segment whose velocities are compared: an event may be detected too early
MIN_SEGMENT_SAMPLES = 8  # fewest samples for a velocity
MIN_APPROACH_M_S = 0.05
RESTING_MOTION_M = 0.003  # apparent motion of a ball at rest
ROLLED_SAMPLES = 12  # samples of rolling before an impact after which the spin is known
DOUBTFUL_RATIO = 1.2  # rms of a segment over the median of all above which its initial state is doubtful
DOUBTFUL_SD = 0.05  # sd of a velocity over the approach, if spin or segment are doubtful [1]


@dataclass(frozen=True)
class Impacts:
    """Impacts with segments before and after, one row for each ball that moves afterwards."""

    clip: NDArray[np.int64]  # (n,) index into the clip set
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) position of the ball [m]
    kind: tuple[str, ...]  # (n,) "cushion", "hitting ball", "hit ball"
    rail: tuple[str, ...]  # (n,) "" of a pair of balls
    approach: Array  # (n,) speed along the normal before [m/s]
    angle: Array  # (n,) of incidence, from the normal [rad]
    spin: Array  # (n,) sidespin before [rad/s]
    jump: Array  # (n, 2) velocity after, measured minus modelled, over the approach: along normal and tangent [1]
    sd: Array  # (n,) of each [1]


def no_impacts() -> Impacts:
    """The value without any impact."""
    none, pair = np.empty(0), np.empty((0, 2))
    return Impacts(np.empty(0, dtype=np.int64), none, pair, (), (), none, none, none, pair, none)


@dataclass(frozen=True)
class _Case:
    """An impact to be simulated: the segment before, and those after it (ball, segment)."""

    before: int
    shot: Shot
    after: tuple[tuple[int, int], ...]


def impacts(fits: SegmentFits, shots: ShotProblem, tracks: Sequence[Track], clip_set: ClipSet, noise: float) -> Impacts:
    """Simulate every good segment beyond the event that ended it.

    Args:
        fits: the segments.
        shots: the whole shots, whose model has cushions.
        tracks: of the whole shots.
        clip_set: of the segments.
        noise: of averaged positions, one standard deviation per axis [m].
    """
    cases = []
    for k, s in enumerate(fits.problem.segments):
        if fits.good[k] and len(s.time) >= MIN_SEGMENT_SAMPLES and s.after in ("ball", "cushion"):
            case = _case(k, fits, tracks[s.clip], clip_set)
            if case is not None:
                cases.append(case)
    rows = []
    for case, track in zip(cases, simulate(shots.model, [c.shot for c in cases]), strict=True):
        events = [e for e in track.events if track.names[0] in e.balls]
        if len(track.events) == len(events) == 1 and events[0].kind == fits.problem.segments[case.before].after:
            rows += _rows(case, track, events[0], fits, noise)
    if not rows:
        return no_impacts()
    clip, time, xy, kinds, rails, approach, angle, spin, jumps, sds = zip(*rows, strict=True)
    return Impacts(
        np.array(clip, dtype=np.int64), np.array(time), np.array(xy), kinds, rails, np.array(approach),
        np.array(angle), np.array(spin), np.array(jumps), np.array(sds),
    )  # fmt: skip


def _case(k: int, fits: SegmentFits, whole: Track, clip_set: ClipSet) -> _Case | None:
    """The shot that continues where a segment ended; None if nothing comparable follows."""
    segments, played = fits.problem.segments, fits.tracks[k]
    s = segments[k]
    end = float(s.time[-1])

    def following(ball: str) -> int | None:
        for j, other in enumerate(segments):
            if (other.clip, other.ball) == (s.clip, ball) and end < other.time[0] < end + MAX_IMPACT_GAP_S:
                usable = fits.good[j] and len(other.time) >= MIN_SEGMENT_SAMPLES and other.before == s.after
                return j if usable else None
        return None

    first = following(s.ball)
    after = [] if first is None else [(0, first)]
    position, velocity, spin = played.position[-1:, 0], played.velocity[-1:, 0], played.spin[-1:, 0].copy()
    spin[0, 2] = sidespin(whole, whole.names.index(s.ball), s.time[-1:])[0]
    names: tuple[str, ...] = ("ball",)
    if s.after == "ball":
        other = _resting_ball(clip_set.clips[s.clip].balls, s, position[0])
        if other is None:
            return None
        name, place = other
        if float(np.hypot(*(place - position[0]))) < clip_set.ball.diameter:
            return None  # the noisy end of the segment overlaps the other ball
        hit = following(name)
        after += [] if hit is None else [(1, hit)]
        names = ("ball", "other")
        position = np.concatenate([position, place[None]])
        velocity, spin = np.concatenate([velocity, np.zeros((1, 2))]), np.concatenate([spin, np.zeros((1, 3))])
    if not after:
        return None
    times = np.unique([0.0, *[float(segments[j].time[COMPARED_SAMPLE]) - end for _, j in after]])
    return _Case(k, Shot(names, position, velocity, spin, times), tuple(after))


def _rows(case: _Case, track: Track, event: Event, fits: SegmentFits, sigma: float) -> list[tuple[Any, ...]]:
    """Rows of `Impacts` for a simulated case, one for each ball that moves afterwards."""
    segments, radius = fits.problem.segments, fits.problem.model.ball.radius
    s, before = segments[case.before], fits.tracks[case.before]
    velocity = case.shot.velocity[0]
    place = _position_at(case.shot, event.time, 2 * radius if s.after == "ball" else None)
    if s.after == "cushion":
        normal = np.zeros(2)
        normal["xy".index(event.rail[1])] = -1.0 if event.rail[0] == "+" else 1.0
        approach = -float(velocity @ normal)
    else:
        normal = (case.shot.position[1] - place) / (2 * radius)
        approach = float(velocity @ normal)
    if approach < MIN_APPROACH_M_S:
        return []
    tangent = velocity - (velocity @ normal) * normal
    size = float(np.hypot(*tangent))
    tangent = tangent / size if size > 0.05 * approach else np.array([-normal[1], normal[0]])
    slip, _ = motions(before.velocity[:, 0], before.spin[:, 0], radius)
    usual, scale = np.median(fits.ratio[fits.good]), sigma / fits.problem.noise
    rows = []
    for ball, after in case.after:
        t = segments[after].time
        index = int(np.searchsorted(track.times, t[COMPARED_SAMPLE] - s.time[-1] - 1e-9))
        jump = (fits.tracks[after].velocity[COMPARED_SAMPLE, 0] - track.velocity[index, ball]) / approach
        if not np.isfinite(jump).all():
            continue
        sd = scale * float(np.hypot(fits.velocity_sds[after, 0], fits.velocity_sds[case.before, 1])) / approach
        slides = (slip[-ROLLED_SAMPLES:] > MIN_SLIP_M_S).any()
        if slides or max(fits.ratio[after], fits.ratio[case.before]) > DOUBTFUL_RATIO * usual:
            sd = float(np.hypot(sd, DOUBTFUL_SD))
        kind = "cushion" if s.after == "cushion" else ("hitting ball", "hit ball")[ball]
        rows.append((
            s.clip, s.time[-1] + event.time, place if ball == 0 else case.shot.position[1], kind, event.rail,
            approach, np.arctan2(size, approach), case.shot.spin[0, 2], [jump @ normal, jump @ tangent], sd,
        ))  # fmt: skip
    return rows


def _resting_ball(balls: Mapping[str, Observation], s: Segment, end: Array) -> tuple[str, Array] | None:
    """The ball nearest to the end of a segment, and its position; None if it was not at rest."""
    best: tuple[float, str, Array] | None = None
    for name, seen in balls.items():
        if name == s.ball:
            continue
        before = seen.xy[seen.time <= s.time[-1]]
        if len(before) < 1:
            before = seen.xy[:1]
        distance = float(np.hypot(*(before[-1] - end)))
        if best is None or distance < best[0]:
            still = bool(np.ptp(before, axis=0).max() < RESTING_MOTION_M)
            best = (distance, name if still else "", before.mean(axis=0))
    return (best[1], best[2]) if best is not None and best[1] else None


def _position_at(shot: Shot, time: float, contact: float | None) -> Array:
    """Position of the first ball at its impact, extrapolated in a straight line to the distance of contact."""
    start, velocity = shot.position[0], shot.velocity[0]
    if contact is None:
        return np.asarray(start + time * velocity)
    unit = velocity / np.hypot(*velocity)
    to = shot.position[1] - start
    along = float(to @ unit)
    across_squared = float(to @ to) - along**2
    return np.asarray(start + unit * (along - np.sqrt(max(contact**2 - across_squared, 0.0))))
