"""The rotation of a ball from its marks, frame by frame.

In: the spots of one ball in pictures in order of time. Out: `Turning`. Marks are landmarks in the axes of the ball. The
orientation in a frame is the rotation that brings the known landmarks nearest to the marks seen (weighted least
squares), begun where a constant spin, or rolling without slip, would have brought the ball: errors do not accumulate
while a mark stays in sight. Two marks well apart give all three angles. With a single one, the turn about the
horizontal is assumed to be that of rolling without slip, which is none for a ball that spins in place; the turn about
the vertical is measured, as long as the mark is as high as it then must be.

Aliasing: a ball that turns by more than half the distance of its marks from where it was expected looks like one that
turns less. A single mark of a ball in place determines turns of up to half a turn a frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.errors import BadInput
from sysid.vision.camera.projection import Array
from sysid.vision.rotation.geometry import (
    rotation_matrix,
    rotation_vector,
    smallest_angle,
    symmetric_axes,
)
from sysid.vision.rotation.marks import Marks, choose_marks
from sysid.vision.rotation.spots import Spots
from sysid.vision.rotation.turn_fit import (
    GATE_RAD,
    GUESS_SD_RAD,
    INNER_COSINE,
    MAX_ANGLE_SD_RAD,
    MISSED_COST,
    MarkedState,
    angle_sd,
    fit_turn,
)
from sysid.vision.rotation.turned import Turning

MAX_SPIN_CHANGE_RAD_S2 = 40.0  # while a ball is out of sight [rad/s^2]
MAX_WINDING_DOUBT_RAD = 1.2  # about a turn out of sight that is still counted
IMPACT_SPEED_M_S = 0.3  # change of velocity between frames that shows an impact [m/s]
LOOKAHEAD_FRAMES = 4  # that decide between turns that one pair of frames leaves open
DUPLICATE_RAD = 0.1  # between turns that need not both be tried
STEADY_SD_RAD = 0.06  # of a turn from a constant spin between impacts
SURE_COST = 4.0  # of a mark, up to which a constant spin is accepted
IMPACT_COST = 12.0
MAX_TURN_COST = 60.0  # of a turn and the frames after it; above, nothing explains them
MAX_GUESSES = 120  # that are tried
MAX_TURN_RAD = 3.0  # between frames, that is tried
SIDESPIN_SD_RAD_S = 50.0  # a priori [rad/s]
VERTICAL_AXIS = np.array([0.0, 0.0, 1.0])


def turning(seen: Sequence[Spots], radius: float) -> Turning:
    """The rotation of a ball of this radius [m], from the spots that pictures in order of time show on it."""
    frames = choose_marks(seen, radius)
    n, time = len(frames), np.array([f.time for f in frames])
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        raise BadInput(f"frame {late[0] + 1} at {time[late[0] + 1]:g} s is not later than the one before: sort them")
    step = float(np.median(np.diff(time))) if n > 1 else math.inf
    theta, sd, added_error, run = np.full(n, np.nan), np.full(n, np.nan), np.zeros((n, 3)), np.full(n, -1)
    spin, spin_sd, quaternion = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full((n, 4), np.nan)
    state: MarkedState | None = None
    angle, runs, known = 0.0, 0, -1
    for k, frame in enumerate(frames):
        if len(frame.place) == 0:
            continue
        next_state = None if state is None else _follow(state, frames, k, radius)
        if state is None or next_state is None:
            if state is not None and frame.time - frames[state.frame].time < 2.5 * step:
                continue  # a single bad picture does not end a run
            state, angle, runs, known = _begin(frame, k), 0.0, runs + 1, -1
        else:
            elapsed = frame.time - frames[state.frame].time
            angle, added_error[k] = angle + next_state.turn[2], next_state.added_error
            if max(next_state.sd[2], state.sd[2]) < MAX_ANGLE_SD_RAD:
                axes = slice(0, 3) if next_state.full and state.full else slice(2, 3)
                spin[k, axes] = next_state.turn[axes] / elapsed
                spin_sd[k, axes] = np.hypot(next_state.sd, state.sd)[axes] / elapsed
            if next_state.sd[2] < MAX_ANGLE_SD_RAD and known >= 0 and not _countable(state, frames, known, k, step):
                angle, runs = 0.0, runs + 1
            state = next_state
        if state.sd[2] < MAX_ANGLE_SD_RAD:
            theta[k], sd[k], run[k], known = angle, state.sd[2], runs, k
            if state.full:
                quaternion[k] = np.roll(Rotation.from_matrix(state.axes).as_quat(), 1)
    notes = _notes(frames, state, run, step)
    longest_run = int(np.bincount(run[run >= 0]).argmax()) if (run >= 0).any() else 0
    outside_run = run != longest_run
    theta[outside_run], sd[outside_run], quaternion[outside_run] = np.nan, np.nan, np.nan
    accumulated = np.cumsum(added_error, axis=0)
    accumulated -= accumulated[int(np.argmax(run == longest_run))]
    correlated = np.maximum.accumulate(np.where(outside_run, 0.0, np.hypot(accumulated[:, 0], accumulated[:, 1])))
    drift = np.where(outside_run, np.nan, np.sqrt(np.maximum(correlated**2 + accumulated[:, 2], 0)))
    return Turning(time, theta, sd, drift, spin, spin_sd, quaternion, tuple(notes))


def _notes(frames: Sequence[Marks], state: MarkedState | None, run: NDArray[np.int64], step: float) -> list[str]:
    """Notes for the user."""
    if state is None or not (run >= 0).any():
        on_top = "the mark shows no rotation: it lies on the axis of rotation"
        return ["no mark was seen on the ball" if state is None else on_top]
    notes = []
    if (lost := int(np.sum(run < 0))) > 0:
        why = "its marks do not show it" if all(len(f.place) for f in frames) else "its marks are out of sight"
        notes.append(f"in {lost} of {len(frames)} frames the rotation angle is unknown: {why}")
    counts = np.bincount(run[run >= 0])
    if (counts > 0).sum() > 1:
        part = f"the angle is given for the longest span, {counts.max()} of {counts.sum()} frames"
        notes.append(f"the marks were out of sight for so long that the rotation meanwhile is unknown: {part}")
    single = len(state.place) == 1
    subject = "with a single mark, sidespin above" if single else "a change of spin between frames by more than"
    limit = (1.0 if single else 0.5) * smallest_angle(state.place) / step
    return [*notes, f"{subject} {limit:.0f} rad/s cannot be distinguished from a smaller one"]


def _begin(frame: Marks, k: int) -> MarkedState:
    """The first state: the axes of the ball are those of the table."""
    full, spread, _ = angle_sd(frame.place, frame.sd, frame.sight, np.full(3, 1e6))
    return MarkedState(
        k, np.eye(3), frame.place, frame.weight, np.zeros(3), None, spread, (0.0, 0.0, 0.0), full, False, 0.0
    )


def _follow(state: MarkedState, frames: Sequence[Marks], k: int, radius: float) -> MarkedState | None:
    """The state at frame k; None if no turn explains its marks."""
    frame, previous = frames[k], frames[state.frame]
    elapsed = frame.time - previous.time
    dx, dy = (frame.xy - previous.xy) / radius
    roll = np.array([-dy, dx, 0.0])
    expected: Array | None = None
    options: list[tuple[float, MarkedState]] = []
    steady: MarkedState | None = None
    if state.spin is not None:
        expected = state.spin * elapsed if state.whole else roll + VERTICAL_AXIS * state.spin[2] * elapsed
        steady = fit_turn(state, frame, k, expected, STEADY_SD_RAD + MAX_SPIN_CHANGE_RAD_S2 * elapsed**2)
        if steady is not None:
            memory = 0.5 if state.whole == steady.whole else 0.0
            steady = replace(steady, spin=memory * state.spin + (1 - memory) * steady.turn / elapsed)
            if steady.cost < SURE_COST * len(frame.place):
                return steady
            options.append((steady.cost, steady))
    for guess in _without_duplicates(_guesses(state, frame, roll)):
        candidate = fit_turn(state, frame, k, guess, GUESS_SD_RAD)
        if candidate is None:
            continue
        if all(np.linalg.norm(candidate.turn - other.turn) > DUPLICATE_RAD for _, other in options):
            prior_cost = _prior_cost(candidate.turn, roll, elapsed, expected)
            options.append((candidate.cost + prior_cost, replace(candidate, spin=candidate.turn / elapsed)))
    options = sorted(options, key=lambda o: o[0])[:8]
    if not options or (expected is not None and options[0][0] > _unmatched_cost(state, frame, expected)):
        return None
    if len(state.place) == 1:
        return options[0][1]
    cost, _, best = min((cost + _lookahead_cost(other, frames, k), j, other) for j, (cost, other) in enumerate(options))
    # If the following frames contradict all turns, this frame was misread.
    return best if best is steady or cost < MAX_TURN_COST else None


def _unmatched_cost(state: MarkedState, frame: Marks, turn: Array) -> float:
    """The cost of a turn after which none of the marks seen is a known landmark."""
    turned = rotation_matrix(turn)
    missed = (state.place @ (turned @ state.axes).T @ frame.sight > INNER_COSINE).sum()
    unexpected = (frame.place @ turned @ frame.sight > INNER_COSINE).sum()
    return float(MISSED_COST * (missed + unexpected) + len(frame.place))


def _lookahead_cost(state: MarkedState, frames: Sequence[Marks], k: int) -> float:
    """The cost of the frames after k if the spin stays constant."""
    cost = 0.0
    for j in (j for j in range(k + 1, min(k + 1 + LOOKAHEAD_FRAMES, len(frames))) if len(frames[j].place)):
        elapsed = frames[j].time - frames[state.frame].time
        spin = np.zeros(3) if state.spin is None else state.spin
        found = fit_turn(state, frames[j], j, spin * elapsed, STEADY_SD_RAD + MAX_SPIN_CHANGE_RAD_S2 * elapsed**2)
        if found is None:
            cost += 3 * MISSED_COST
        else:
            cost, state = cost + found.cost, replace(found, spin=0.5 * (spin + found.turn / elapsed))
    return cost


def _guesses(state: MarkedState, frame: Marks, roll: Array) -> Iterable[Array]:
    """Candidate turns that bring one or two landmarks onto marks: rotation vectors (3,)."""
    place = state.place @ state.axes.T
    # Sliding can be seen from two marks only.
    slides = roll @ roll > 1e-4 and min(len(place), len(frame.place)) > 1
    horizontals = [roll, 0.5 * roll, 0.0 * roll] if slides else [roll]
    for horizontal in horizontals:
        for landmark in place @ rotation_matrix(horizontal).T:
            for mark in frame.place:
                if abs(math.asin(np.clip(landmark[2], -1, 1)) - math.asin(np.clip(mark[2], -1, 1))) < GATE_RAD[1]:
                    z = math.atan2(landmark[0] * mark[1] - landmark[1] * mark[0], landmark[:2] @ mark[:2])
                    yield horizontal + VERTICAL_AXIS * z
    cosines, seen = place @ place.T, frame.place @ frame.place.T
    for i in range(len(place)):
        for j in range(i + 1, len(place)):
            matches = np.abs(seen - cosines[i, j]) < 0.08
            matches[np.diag_indices(len(seen))] = False
            for a, b in zip(*np.nonzero(matches), strict=True):
                axes = symmetric_axes(frame.place[a], frame.place[b])
                turn = rotation_vector(axes @ symmetric_axes(place[i], place[j]).T)
                if turn @ turn < MAX_TURN_RAD**2:
                    yield turn


def _without_duplicates(turns: Iterable[Array]) -> list[Array]:
    """Turns without near duplicates."""
    found: list[Array] = []
    for turn in turns:
        if len(found) < MAX_GUESSES and all(np.sum((turn - other) ** 2) > DUPLICATE_RAD**2 for other in found):
            found.append(turn)
    return found


def _prior_cost(turn: Array, roll: Array, elapsed: float, expected: Array | None) -> float:
    """Cost of a turn a priori: between backspin and rolling, with a sidespin of the order of SIDESPIN_SD_RAD_S."""
    rolling = min(max(float(turn @ roll) / max(float(roll @ roll), 1e-9), -1.0), 1.5)
    sideways = turn[:2] - rolling * roll[:2]
    sidespin = turn[2] / (SIDESPIN_SD_RAD_S * elapsed + 0.1)
    cost = float(sideways @ sideways / (0.3 * math.hypot(*roll) + 0.1) ** 2 + sidespin**2)
    if expected is None:
        return cost
    return min(cost + IMPACT_COST, float(np.sum((turn - expected) ** 2)) / STEADY_SD_RAD**2)


def _countable(state: MarkedState, frames: Sequence[Marks], start: int, k: int, step: float) -> bool:
    """Whether the turn from frame `start` to k, unseen in between, is unambiguous by whole turns."""
    elapsed = frames[k].time - frames[start].time
    if elapsed < 1.5 * step:
        return True
    speed = [(b.xy - a.xy) / (b.time - a.time) for a, b in pairwise(frames[start : k + 1])]
    hit = any(math.hypot(*(b - a)) > IMPACT_SPEED_M_S for a, b in pairwise(speed))
    sidespin = 0.0 if state.spin is None else abs(float(state.spin[2]))
    doubt = 0.5 * MAX_SPIN_CHANGE_RAD_S2 * elapsed**2 + 0.02 * sidespin * elapsed
    return not hit and doubt < MAX_WINDING_DOUBT_RAD
