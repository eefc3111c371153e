"""Shots cut into consecutive windows of one impact each, for multiple shooting.

In: a `ShotProblem`. Out: `Windows`: samples, first guesses and priors of every window, and their order.

A window begins between two impacts, or with its shot, and ends where the next one begins: impacts that follow each
other within a few frames share one. Its state is that of every ball: place (2) [m], velocity (2) and R omega (3) [m/s]
of the first ball, places of the others (2 each), velocity and R omega of the others (5 each), in the table's frame
but for the first window of a shot, whose first ball has the frame of its shot. A ball that rests has a place alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from sysid.clips import Clip, Observation
from sysid.clips.segments import cuts_of, onsets
from sysid.estimation.problem import STATE_STEPS, Array, Index
from sysid.estimation.residual_rows import MOTION_SIZE, RESIDUALS_PER_SAMPLE, MeasuredShot, ShotData, packed
from sysid.estimation.shot_problem import REST_STEP, ShotProblem
from sysid.estimation.solver.least_squares import Prior

MIN_GAP_FRAMES = 6.0  # shortest time between two impacts for a window to begin between them
MOVING_M_S = 0.02  # slower balls count as at rest where a window begins
GUESS_SAMPLES = 9  # samples nearest to the beginning of a window that give position and velocity
MIN_CURVED_SAMPLES = 5  # fewest samples for a parabola; fewer give a line
SMEARED_FRAMES = 0.5  # time next to an impact whose samples are not used for the guess
Mask = NDArray[np.bool_]


def columns(ball: int, balls: int) -> tuple[Index, Index]:
    """Positions of a ball's place (2) and motion (5) within a window's state, for a number of balls."""
    first = 2 + MOTION_SIZE
    if ball == 0:
        return np.arange(2), np.arange(2, first)
    places, motions = first + 2 * (ball - 1), first + 2 * (balls - 1) + MOTION_SIZE * (ball - 1)
    return np.arange(places, places + 2), np.arange(motions, motions + MOTION_SIZE)


@dataclass(frozen=True)
class Windows:
    """All windows of all shots, grouped by shot and in order."""

    data: ShotData
    shot: Index  # (w,) number of the shot
    begin: Array  # (w,) [s] in its shot
    hit: Mask  # (w, b) balls that have an impact in it
    moving: Mask  # (w, b) balls that move where it begins
    start: Array  # (w, p) first guess
    prior: Prior  # (w, p) prior knowledge, of the first window of a shot
    travelled: Array  # (w, b, s) path length of each ball from the window's beginning to its sample [m]

    @property
    def balls(self) -> int:
        """Largest number of balls of a shot."""
        return self.data.rest.shape[1]

    @cached_property
    def lengths(self) -> Index:
        """Number of residuals of each window: (w,)."""
        return RESIDUALS_PER_SAMPLE * self.data.count.sum(axis=1)

    @cached_property
    def first(self) -> Mask:
        """Whether it is the first of its shot: (w,)."""
        return np.concatenate([[True], self.shot[1:] != self.shot[:-1]])

    @cached_property
    def following(self) -> tuple[Index, Index]:
        """Windows that have a successor, and their successors: (k,), (k,)."""
        second = np.flatnonzero(~self.first)
        return second - 1, second

    @cached_property
    def runs(self) -> list[Index]:
        """The windows of each shot."""
        edges = np.flatnonzero(self.first)
        return [np.arange(a, b) for a, b in zip(edges, [*edges[1:], len(self.shot)], strict=True)]

    @cached_property
    def free(self) -> Mask:
        """Which elements of the states are unknown: (w, p). A resting ball has no motion, an absent one nothing."""
        out = np.zeros(self.start.shape, bool)
        for i in range(self.balls):
            place, motion = columns(i, self.balls)
            there = self.data.balls > i
            out[:, place], out[:, motion] = there[:, None], (there & self.moving[:, i])[:, None]
        return out

    def only(self, shots: Index) -> Windows:
        """The windows of some shots, in order."""
        rows = np.flatnonzero(np.isin(self.shot, shots))
        return Windows(
            self.data.only(rows), np.searchsorted(shots, self.shot[rows]), self.begin[rows], self.hit[rows],
            self.moving[rows], self.start[rows], self.prior.only(rows), self.travelled[rows],
        )  # fmt: skip

    @property
    def steps(self) -> Array:
        """Finite differences of a state: (p,)."""
        others = self.balls - 1
        return np.concatenate([STATE_STEPS, np.full(2 * others, REST_STEP), np.tile(STATE_STEPS[2:], others)])


def windows_of(problem: ShotProblem) -> Windows:
    """The windows of all shots of a problem."""
    most = problem.data.rest.shape[1]
    size = (2 + MOTION_SIZE) * most
    shots, rows = list[MeasuredShot](), list[tuple[int, float, Mask, Mask, Array]]()
    for k, clip in enumerate(problem.clips):
        for begin, end, before, after, hit in _spans(problem, clip, float(problem.end[k])):
            start, moving = np.zeros(size), np.zeros(most, bool)
            for i, name in enumerate(problem.balls(k)):
                place, motion = columns(i, most)
                if begin == 0.0:
                    moving[i] = name in clip.first
                    continue
                at, state = _guess(clip.balls[name], begin, before, after, SMEARED_FRAMES / problem.clip_set.fps)
                start[place], start[motion], moving[i] = at, state, state.any()
            if begin == 0.0:
                start = _first_state(problem, k, problem.start[k], size)
            rows.append((k, begin, np.isin(np.arange(most), hit), moving, start))
            shots.append(_measured(problem, k, begin, end))
    data = packed(shots, most)
    shot, begins, hits, moves, starts = (np.array(part) for part in zip(*rows, strict=True))
    mean, sd = np.zeros(starts.shape), np.full(starts.shape, np.inf)
    for w in np.flatnonzero(begins == 0.0):
        k = int(shot[w])
        mean[w] = _first_state(problem, k, problem.prior.mean[k], size)
        sd[w] = _first_state(problem, k, problem.prior.sd[k], size, places=False)
        sd[w][sd[w] == 0.0] = np.inf
    return Windows(data, shot, begins, hits, moves, starts, Prior(mean, sd), _travelled(data))


def _spans(problem: ShotProblem, clip: Clip, end: float) -> list[tuple[float, float, float, float, list[int]]]:
    """Begin and end of each window, the impacts before and after its beginning [s], and the balls hit."""
    clips, names = problem.clip_set, clip.order_of_balls
    tracks = onsets(clip, problem.noise, clips.fps)
    impacts = sorted(
        (float(tracks[name].time[cut.sample]), i, names.index(cut.with_) if cut.kind == "ball" else i)
        for i, name in enumerate(names)
        for cut in cuts_of(name, tracks, clips.table, clips.ball, problem.noise)
    )
    times = [t for t, _, _ in impacts if t < end]
    begins = [(0.0, -np.inf, times[0] if times else np.inf)]
    begins += [(0.5 * (a + b), a, b) for a, b in pairwise(times) if b - a > MIN_GAP_FRAMES / clips.fps]
    ends = [*(b[0] for b in begins[1:]), end]
    return [
        (begin, stop, before, after, [x for t, i, j in impacts if begin <= t < stop for x in (i, j)])
        for (begin, before, after), stop in zip(begins, ends, strict=True)
    ]


def _guess(seen: Observation, begin: float, before: float, after: float, smeared: float) -> tuple[Array, Array]:
    """Place (2,) and motion (5,) of a ball at the beginning of a window, assuming that it rolls, or rests."""
    k = int(np.searchsorted(seen.time, begin))
    rest = np.array([np.interp(begin, seen.time, seen.xy[:, axis]) for axis in range(2)]), np.zeros(MOTION_SIZE)
    if k in (0, len(seen.time)):
        return rest
    velocity = (seen.xy[k] - seen.xy[k - 1]) / (seen.time[k] - seen.time[k - 1])
    if np.hypot(*velocity) < MOVING_M_S:
        return rest
    place = rest[0]
    near = np.flatnonzero((seen.time > before + smeared) & (seen.time < after - smeared))
    near = near[np.argsort(np.abs(seen.time[near] - begin), kind="stable")[:GUESS_SAMPLES]]
    if near.size > 2:
        order = 3 if near.size >= MIN_CURVED_SAMPLES else 2
        powers = np.vander(seen.time[near] - begin, order, increasing=True)
        place, velocity = np.linalg.lstsq(powers, seen.xy[near], rcond=None)[0][:2]
    return place, np.array([*velocity, -velocity[1], velocity[0], 0.0])


def _first_state(problem: ShotProblem, k: int, x: Array, size: int, places: bool = True) -> Array:
    """A shot's unknowns (p,) as the state of its first window, with the `places` of other balls, or displacements."""
    out, most, others = np.zeros(size), problem.data.rest.shape[1], problem.rest[k]
    first = 2 + MOTION_SIZE
    out[:first] = x[:first]
    for i in range(1, len(others) + 1):
        place, motion = columns(i, most)
        out[place] = x[first + 2 * (i - 1) :][:2] + (others[i - 1] if places else 0.0)
        if problem.balls(k)[i] in problem.clips[k].running:
            out[motion] = x[problem.motions_from + MOTION_SIZE * (i - 1) :][:MOTION_SIZE]
    return out


def shot_states(problem: ShotProblem, windows: Windows, states: Array) -> Array:
    """Initial states of shots (n, p) from the states of their first windows."""
    out = problem.start.copy()
    first, most = 2 + MOTION_SIZE, windows.balls
    for w in np.flatnonzero(windows.first):
        k = int(windows.shot[w])
        out[k, :first] = states[w, :first]
        for i in range(1, len(problem.rest[k]) + 1):
            place, motion = columns(i, most)
            out[k, first + 2 * (i - 1) : first + 2 * i] = states[w, place] - problem.rest[k][i - 1]
            if problem.balls(k)[i] in problem.clips[k].running:
                at = problem.motions_from + MOTION_SIZE * (i - 1)
                out[k, at : at + MOTION_SIZE] = states[w, motion]
    return out


def _measured(problem: ShotProblem, k: int, begin: float, end: float) -> MeasuredShot:
    """The samples of a window, with an additional stamp at its end."""
    clip, names = problem.clips[k], problem.balls(k)
    times, places, angles, trusts = list[Array](), list[Array](), list[Array](), list[Mask]()
    for i, name in enumerate(names):
        seen, trusted = clip.balls[name], problem.trusted[k][name]
        rows = np.flatnonzero((seen.time <= end) & ((seen.time > begin) | (begin == 0.0)))
        part = seen.at(rows)
        time, xy, theta, trust = part.time - begin, part.xy, part.theta, trusted[rows]
        if i == 0:
            time, xy = np.append(time, end - begin), np.vstack([xy, xy[-1:] if len(xy) else [[0.0, 0.0]]])
            theta, trust = np.append(theta, np.nan), np.append(trust, False)
        times.append(time)
        places.append(xy)
        angles.append(theta)
        trusts.append(trust)
    struck = begin == 0.0 and not clip.running
    return MeasuredShot(
        times, places, angles, trusts, np.zeros((len(names) - 1, 2)), [name in problem.staying[k] for name in names],
        float(problem.azimuth[k]) if begin == 0.0 else 0.0, clip.session, struck, moving=len(names),
    )  # fmt: skip


def _travelled(data: ShotData) -> Array:
    step = np.hypot(*np.moveaxis(np.diff(data.xy, axis=2, prepend=data.xy[:, :, :1]), -1, 0))
    step[np.arange(data.xy.shape[2]) >= data.count[:, :, None]] = 0.0
    return np.cumsum(step, axis=2)
