"""What an impact does beyond the model: each stretch is played on through the event that ended it.

The state with which a stretch ends is fitted to that stretch alone, so neither earlier impacts nor the cloth carry
their errors over: the velocity with which the next stretch begins, less the one that the model gives it, is the
impact's own. It is split along the normal (out of the cushion, or along the line of centres) and the tangent
(to where the ball was going), and divided by the speed of approach.

Left out: sidespin, which a stretch by itself does not tell, is that of the whole shot's track. An impact is passed
over where a stretch beside it is short, where the other ball of a pair was moving, and where the model meets
something else, or nothing.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.shot import Shot, Track
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, Observation
from sysid.clips.segments import Segment
from sysid.estimation.problem import Array
from sysid.estimation.segment_problem import SegmentProblem
from sysid.estimation.shot_problem import ShotProblem
from sysid.residuals.collect import SLIPS, begin, motions

LATER = 2  # sample of the next stretch at which velocities are compared: a hit may be seen a frame early
SHORT = 8  # samples of a stretch that tell a velocity
GAP = 0.15  # longest time between two stretches beside an impact [s]
SLOW = 0.05  # approach below which nothing is said [m/s]
LAIN = 0.003  # how far a ball that lies may seem to move [m]
ROLLED = 12  # samples of rolling before an impact with which the spin is known
MISFIT = 1.2  # rms of a stretch over the median of all from which its own unknowns are doubtful
DOUBT = 0.05  # of the approach: how well a velocity is known where spin or stretch are doubtful [1]
WINDOW = 0.25  # of a stretch that tells the velocity at its end [s]


@dataclass(frozen=True)
class Impacts:
    """Impacts whose stretches before and after were seen, one row each, of the ball that goes on."""

    clip: NDArray[np.int64]  # (n,) index into the clip set
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) where the ball goes on [m]
    kind: tuple[str, ...]  # (n,) "cushion", "hitting ball", "hit ball"
    rail: tuple[str, ...]  # (n,) "" of a pair of balls
    approach: Array  # (n,) speed along the normal before [m/s]
    angle: Array  # (n,) of the way in from the normal [rad]
    spin: Array  # (n,) sidespin before [rad/s]
    jump: Array  # (n, 2) velocity after, measured minus modelled, over the approach: along normal and tangent [1]
    sd: Array  # (n,) of each [1]


def no_impacts() -> Impacts:
    """None at all."""
    none, pair = np.empty(0), np.empty((0, 2))
    return Impacts(np.empty(0, dtype=np.int64), none, pair, (), (), none, none, none, pair, none)


@dataclass(frozen=True)
class _Case:
    """An impact to be played: the stretch before, and what goes on after it (ball, stretch)."""

    before: int
    shot: Shot
    after: tuple[tuple[int, int], ...]


def impacts(
    segments: SegmentProblem, x: Array, good: NDArray[np.bool_], ratio: Array, shots: ShotProblem,
    tracks: Sequence[Track], clip_set: ClipSet,
) -> Impacts:  # fmt: skip
    """Play every stretch on through the event that ended it; x (n, 7) are the stretches' unknowns.

    `ratio` (n,) is their rms residual over the noise.
    """
    played = simulate(segments.model, begin(segments, x))
    sigma, radius = segments.noise, clip_set.ball.radius
    usual = np.median(ratio[good]) if good.any() else 1.0
    cases = []
    for k, s in enumerate(segments.segments):
        if good[k] and len(s.time) >= SHORT and s.after in ("ball", "cushion"):
            case = _case(k, segments, x, good, played[k], shots, tracks[s.clip], clip_set)
            if case is not None:
                cases.append(case)
    rows = []
    for case, track in zip(cases, simulate(shots.model, [c.shot for c in cases]), strict=True):
        s = segments.segments[case.before]
        met = [e for e in track.events if track.names[0] in e.balls]
        if len(track.events) != 1 or len(met) != 1 or met[0].kind != s.after:
            continue
        way = case.shot.velocity[0]
        place = _place_at(track, case.shot, met[0].time, 2 * radius if s.after == "ball" else None)
        if s.after == "cushion":
            axis = "xy".index(met[0].rail[1])
            normal = np.zeros(2)
            normal[axis] = -1.0 if met[0].rail[0] == "+" else 1.0
            v_in = -float(way @ normal)
        else:
            normal = (case.shot.position[1] - place) / (2 * radius)
            v_in = float(way @ normal)
        if v_in < SLOW:
            continue
        tangent = way - (way @ normal) * normal
        size = float(np.hypot(*tangent))
        tangent = tangent / size if size > 0.05 * v_in else np.array([-normal[1], normal[0]])
        for ball, after in case.after:
            t = segments.segments[after].time
            index = int(np.searchsorted(track.times, t[LATER] - s.time[-1] - 1e-9))
            jump = (played[after].velocity[LATER, 0] - track.velocity[index, ball]) / v_in
            if not np.isfinite(jump).all():
                continue
            sd = float(np.hypot(_velocity_sd(t, sigma), _velocity_sd(s.time[::-1], sigma))) / v_in
            slip, _ = motions(played[case.before].velocity[:, 0], played[case.before].spin[:, 0], radius)
            if (slip[-ROLLED:] > SLIPS).any() or max(ratio[after], ratio[case.before]) > MISFIT * usual:
                sd = float(np.hypot(sd, DOUBT))
            kind = "cushion" if s.after == "cushion" else ("hitting ball", "hit ball")[ball]
            rows.append((
                s.clip, s.time[-1] + met[0].time, place if ball == 0 else case.shot.position[1], kind, met[0].rail,
                v_in, np.arctan2(size, v_in), case.shot.spin[0, 2], [jump @ normal, jump @ tangent], sd,
            ))  # fmt: skip
    if not rows:
        return no_impacts()
    clip, time, xy, kinds, rails, approach, angle, spin, jumps, sds = zip(*rows, strict=True)
    return Impacts(
        np.array(clip, dtype=np.int64), np.array(time), np.array(xy), kinds, rails, np.array(approach),
        np.array(angle), np.array(spin), np.array(jumps), np.array(sds),
    )  # fmt: skip


def _case(
    k: int, problem: SegmentProblem, x: Array, good: NDArray[np.bool_], played: Track, shots: ShotProblem, whole: Track,
    clip_set: ClipSet,
) -> _Case | None:  # fmt: skip
    """The shot that goes on where a stretch ended; None where nothing can be learnt of it."""
    s = problem.segments[k]
    end = float(s.time[-1])

    def following(ball: str) -> int | None:
        for j, other in enumerate(problem.segments):
            if (other.clip, other.ball) == (s.clip, ball) and end < other.time[0] < end + GAP:
                return j if good[j] and len(other.time) >= SHORT and other.before == s.after else None
        return None

    own = following(s.ball)
    after = [] if own is None else [(0, own)]
    position, velocity, spin = played.position[-1:, 0], played.velocity[-1:, 0], played.spin[-1:, 0].copy()
    b = whole.names.index(s.ball)
    spin[0, 2] = np.interp(end, whole.times, np.nan_to_num(whole.spin[:, b, 2]))
    names: tuple[str, ...] = ("ball",)
    if s.after == "ball":
        other = _met(clip_set.clips[s.clip].balls, s, position[0])
        if other is None:
            return None
        name, place = other
        if float(np.hypot(*(place - position[0]))) < clip_set.ball.diameter:
            return None  # the stretch's noisy end lies inside the other ball
        hit = following(name)
        after += [] if hit is None else [(1, hit)]
        names = ("ball", "other")
        position = np.concatenate([position, place[None]])
        velocity, spin = np.concatenate([velocity, np.zeros((1, 2))]), np.concatenate([spin, np.zeros((1, 3))])
    if not after:
        return None
    times = np.unique([0.0, *[float(problem.segments[j].time[LATER]) - end for _, j in after]])
    return _Case(k, Shot(names, position, velocity, spin, times), tuple(after))


def _met(balls: Mapping[str, Observation], s: Segment, place: Array) -> tuple[str, Array] | None:
    """The ball nearest to where a stretch ended, and where it lay; None if it did not lie."""
    best: tuple[float, str, Array] | None = None
    for name, seen in balls.items():
        if name == s.ball:
            continue
        before = seen.xy[seen.time <= s.time[-1]]
        if len(before) < 1:
            before = seen.xy[:1]
        far = float(np.hypot(*(before[-1] - place)))
        if best is None or far < best[0]:
            still = bool(np.ptp(before, axis=0).max() < LAIN)
            best = (far, name if still else "", before.mean(axis=0))
    return (best[1], best[2]) if best is not None and best[1] else None


def _place_at(track: Track, shot: Shot, time: float, contact: float | None) -> Array:
    """Where the first ball was at its impact: straight on; touching the other ball where there is one."""
    start, way = shot.position[0], shot.velocity[0]
    if contact is None:
        return np.asarray(start + time * way)
    unit = way / np.hypot(*way)
    to = shot.position[1] - start
    along = float(to @ unit)
    aside = float(to @ to) - along**2
    return np.asarray(start + unit * (along - np.sqrt(max(contact**2 - aside, 0.0))))


def _velocity_sd(time: Array, sigma: float) -> float:
    """Of the velocity at the first of these times, from a straight line through a window [m/s]."""
    part = time[np.abs(time - time[0]) <= WINDOW] if abs(time[-1] - time[0]) > WINDOW else time
    if len(part) < 2:
        part = time[:2]
    return float(sigma / np.sqrt(np.sum((part - part.mean()) ** 2)))
