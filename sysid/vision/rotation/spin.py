"""How a ball turns, from the marks that pictures show of it.

Marks are landmarks in the ball's axes. A frame's orientation is the rotation that brings the known ones nearest to
those seen (weighted least squares), begun where a constant spin, or rolling without slip, would have brought the ball:
errors do not add up while a mark stays in sight. Two marks well apart give all three angles. With a single one, the
turn about the horizontal is taken to be that of rolling without slip, which is none for a ball that spins in place, and
the turn about the vertical is measured, as long as the mark stands as high as it then must.

Aliasing: a ball that turns by more than half the distance of its marks from where it was expected looks like one that
turns less. A single mark of a ball in place tells turns of up to half a turn a frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.errors import BadInput
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.rotation.spots import MODEL, Marks, Picture, Spots, choose_marks, find_spots, spacing, triad, ways
from sysid.vision.rotation.turned import Turning

BLIND = 0.2  # standard deviation of a turn about the vertical beyond which marks do not show it [rad]
BRAKE = 40.0  # change of spin that is allowed for while a ball is out of sight [rad/s^2]
WINDING = 1.2  # doubt about a turn out of sight beyond which it is not counted [rad]
KICK = 0.3  # change of velocity between frames that says that a ball met something [m/s]
APART = 0.05  # squared sine of half the angle between marks that fix an orientation
SLIP = (0.003, 0.05)  # by which a turn may depart from rolling where a single mark is seen: [rad], and of the turn
GATE = (0.1, 0.45)  # bounds of how far a mark may be from where it is expected [rad]
INNER = float(np.cos(np.radians(55)))  # of the angle to the line of sight, up to which a mark cannot be overlooked
MISSED = 12.0  # what a mark that is not where it should be costs, in squared standard deviations
AHEAD = 4  # frames that decide between turns that one pair of frames leaves open
OVERLAP = 0.3  # distance at which two marks would be one [rad]
ALIKE = 0.1  # difference of turns that need not both be looked at [rad]
STEADY = 0.06  # by which a turn departs from a constant spin between impacts [rad]
ANY = 1.0  # and from a guess that only says where to begin [rad]
SURE = 4.0  # cost of a mark up to which a constant spin is not doubted
SURPRISE = 12.0  # what an impact costs
HOPELESS = 60.0  # cost of a turn and the AHEAD frames after it that nothing explains
MOST = 120  # turns that are looked at
FASTEST = 3.0  # turn between frames that is looked for [rad]
USUAL = 50.0  # sidespin [rad/s]
UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class _State:
    """Where the ball is in its turning."""

    frame: int
    axes: Array  # (3, 3) from the ball's axes to the table's
    place: Array  # (m, 3) landmarks in the ball's axes
    weight: Array  # (m,) of what they are known from
    turn: Array  # (3,) rotation vector since the state before [rad]
    spin: Array | None  # (3,) smoothed [rad/s]
    sd: Array  # (3,) of the orientation about x, y, z [rad]
    stray: tuple[float, float, float]  # what this turn adds to the turned angle's error: (2,) [rad], variance [rad^2]
    full: bool  # all three angles are measured
    whole: bool  # and so is all of the spin, now or before
    cost: float  # of this frame, in squared standard deviations


def watch(frames: Iterable[tuple[float, Picture, Array]], camera: Camera) -> Turning:
    """How a ball turns in pictures: (time [s], picture (h, w, 3), the ball's centre (2,) [m])."""
    seen: list[Spots] = []
    for time, picture, xy in frames:
        seen.append(find_spots(picture, time, xy, camera, seen[-1] if seen else None))
    return turning(seen, camera.radius)


def turning(seen: Sequence[Spots], radius: float) -> Turning:
    """How a ball of this radius [m] turned, from what pictures in order of time showed of it."""
    frames = choose_marks(seen, radius)
    n, time = len(frames), np.array([f.time for f in frames])
    late = np.flatnonzero(np.diff(time) <= 0)
    if late.size:
        raise BadInput(f"frame {late[0] + 1} at {time[late[0] + 1]:g} s is not later than the one before: sort them")
    step = float(np.median(np.diff(time))) if n > 1 else math.inf
    theta, sd, stray, run = np.full(n, np.nan), np.full(n, np.nan), np.zeros((n, 3)), np.full(n, -1)
    spin, spin_sd, quaternion = np.full((n, 3), np.nan), np.full((n, 3), np.nan), np.full((n, 4), np.nan)
    state: _State | None = None
    angle, runs, known = 0.0, 0, -1
    for k, frame in enumerate(frames):
        if len(frame.place) == 0:
            continue
        after = None if state is None else _follow(state, frames, k, radius)
        if state is None or after is None:
            if state is not None and frame.time - frames[state.frame].time < 2.5 * step:
                continue  # one bad picture is no reason to begin anew
            state, angle, runs, known = _begin(frame, k), 0.0, runs + 1, -1
        else:
            gone = frame.time - frames[state.frame].time
            angle, stray[k] = angle + after.turn[2], after.stray
            if max(after.sd[2], state.sd[2]) < BLIND:
                few = slice(0, 3) if after.full and state.full else slice(2, 3)
                spin[k, few] = after.turn[few] / gone
                spin_sd[k, few] = np.hypot(after.sd, state.sd)[few] / gone
            if after.sd[2] < BLIND and known >= 0 and not _countable(state, frames, known, k, step):
                angle, runs = 0.0, runs + 1
            state = after
        if state.sd[2] < BLIND:
            theta[k], sd[k], run[k], known = angle, state.sd[2], runs, k
            if state.full:
                quaternion[k] = np.roll(Rotation.from_matrix(state.axes).as_quat(), 1)
    told = _told(frames, state, run, step)
    best = int(np.bincount(run[run >= 0]).argmax()) if (run >= 0).any() else 0
    other = run != best
    theta[other], sd[other], quaternion[other] = np.nan, np.nan, np.nan
    astray = np.cumsum(stray, axis=0)
    astray -= astray[int(np.argmax(run == best))]
    alike = np.maximum.accumulate(np.where(other, 0.0, np.hypot(astray[:, 0], astray[:, 1])))
    drift = np.where(other, np.nan, np.sqrt(np.maximum(alike**2 + astray[:, 2], 0)))
    return Turning(time, theta, sd, drift, spin, spin_sd, quaternion, tuple(told))


def _told(frames: Sequence[Marks], state: _State | None, run: NDArray[np.int64], step: float) -> list[str]:
    """What a user should know."""
    if state is None or not (run >= 0).any():
        on_top = "the mark shows no rotation: it lies where the ball turns about it"
        return ["no mark was seen on the ball" if state is None else on_top]
    told = []
    if (lost := int(np.sum(run < 0))) > 0:
        why = "its marks not telling the turn" if all(len(f.place) for f in frames) else "its marks out of sight"
        told.append(f"in {lost} of {len(frames)} frames the turned angle is unknown, {why}")
    counts = np.bincount(run[run >= 0])
    if (counts > 0).sum() > 1:
        part = f"the angle is that of {counts.max()} of {counts.sum()} frames in one piece"
        told.append(f"sight was lost for so long that the turn meanwhile is unknown: {part}")
    single = len(state.place) == 1
    what = "a single mark: sidespin above" if single else "between frames, a change of spin by more than"
    limit = (1.0 if single else 0.5) * spacing(state.place) / step
    return [*told, f"{what} {limit:.0f} rad/s looks like a smaller one"]


def _begin(frame: Marks, k: int) -> _State:
    """The first sight: the ball's axes are the table's."""
    full, spread, _ = _spread(frame.place, frame.sd, frame.sight, np.full(3, 1e6))
    return _State(k, np.eye(3), frame.place, frame.weight, np.zeros(3), None, spread, (0.0, 0.0, 0.0), full, False, 0.0)


def _follow(state: _State, frames: Sequence[Marks], k: int, radius: float) -> _State | None:
    """The state at frame k; None if no turn explains what is seen."""
    frame, before = frames[k], frames[state.frame]
    gone = frame.time - before.time
    dx, dy = (frame.xy - before.xy) / radius
    roll = np.array([-dy, dx, 0.0])
    expected: Array | None = None
    options: list[tuple[float, _State]] = []
    steady: _State | None = None
    if state.spin is not None:
        expected = state.spin * gone if state.whole else roll + UP * state.spin[2] * gone
        steady = _bring(state, frame, k, expected, STEADY + BRAKE * gone**2)
        if steady is not None:
            kept = 0.5 if state.whole == steady.whole else 0.0
            steady = replace(steady, spin=kept * state.spin + (1 - kept) * steady.turn / gone)
            if steady.cost < SURE * len(frame.place):
                return steady
            options.append((steady.cost, steady))
    for guess in _distinct(_guesses(state, frame, roll)):
        found = _bring(state, frame, k, guess, ANY)
        if found is not None and all(np.linalg.norm(found.turn - other.turn) > ALIKE for _, other in options):
            strange = _strange(found.turn, roll, gone, expected)
            options.append((found.cost + strange, replace(found, spin=found.turn / gone)))
    options = sorted(options, key=lambda o: o[0])[:8]
    if not options or (expected is not None and options[0][0] > _silent(state, frame, expected)):
        return None
    if len(state.place) == 1:
        return options[0][1]
    cost, _, best = min((cost + _later(other, frames, k), j, other) for j, (cost, other) in enumerate(options))
    # Where the frames to come refuse all turns alike, this one was misread.
    return best if best is steady or cost < HOPELESS else None


def _silent(state: _State, frame: Marks, turn: Array) -> float:
    """The cost of a turn after which a frame shows other marks than those known, which is no measurement."""
    turned = _exp(turn)
    missed = (state.place @ (turned @ state.axes).T @ frame.sight > INNER).sum()
    sudden = (frame.place @ turned @ frame.sight > INNER).sum()
    return float(MISSED * (missed + sudden) + len(frame.place))


def _later(state: _State, frames: Sequence[Marks], k: int) -> float:
    """What the frames after k say against a spin, if it stays as it is."""
    cost = 0.0
    for j in (j for j in range(k + 1, min(k + 1 + AHEAD, len(frames))) if len(frames[j].place)):
        gone = frames[j].time - frames[state.frame].time
        spin = np.zeros(3) if state.spin is None else state.spin
        found = _bring(state, frames[j], j, spin * gone, STEADY + BRAKE * gone**2)
        if found is None:
            cost += 3 * MISSED
        else:
            cost, state = cost + found.cost, replace(found, spin=0.5 * (spin + found.turn / gone))
    return cost


def _guesses(state: _State, frame: Marks, roll: Array) -> Iterable[Array]:
    """Turns that bring some of the landmarks to marks that are seen: rotation vectors (3,)."""
    place = state.place @ state.axes.T
    # Only two marks show that a ball slides.
    slides = roll @ roll > 1e-4 and min(len(place), len(frame.place)) > 1
    across = [roll, 0.5 * roll, 0.0 * roll] if slides else [roll]
    for flat in across:
        for own in place @ _exp(flat).T:
            for other in frame.place:
                if abs(math.asin(np.clip(own[2], -1, 1)) - math.asin(np.clip(other[2], -1, 1))) < GATE[1]:
                    z = math.atan2(own[0] * other[1] - own[1] * other[0], own[:2] @ other[:2])
                    yield flat + UP * z
    cosines, seen = place @ place.T, frame.place @ frame.place.T
    for i in range(len(place)):
        for j in range(i + 1, len(place)):
            fit = np.abs(seen - cosines[i, j]) < 0.08
            fit[np.diag_indices(len(seen))] = False
            for a, b in zip(*np.nonzero(fit), strict=True):
                turn = _log(triad(frame.place[a], frame.place[b]) @ triad(place[i], place[j]).T)
                if turn @ turn < FASTEST**2:
                    yield turn


def _distinct(turns: Iterable[Array]) -> list[Array]:
    """Turns that differ from each other."""
    found: list[Array] = []
    for turn in turns:
        if len(found) < MOST and all(np.sum((turn - other) ** 2) > ALIKE**2 for other in found):
            found.append(turn)
    return found


def _strange(turn: Array, roll: Array, gone: float, expected: Array | None) -> float:
    """How unusual a turn is for a ball that moves so: between backspin and rolling, with a sidespin of USUAL."""
    part = min(max(float(turn @ roll) / max(float(roll @ roll), 1e-9), -1.0), 1.5)
    off = turn[:2] - part * roll[:2]
    new = float(off @ off / (0.3 * math.hypot(*roll) + 0.1) ** 2 + (turn[2] / (USUAL * gone + 0.1)) ** 2)
    return new if expected is None else min(new + SURPRISE, float(np.sum((turn - expected) ** 2)) / STEADY**2)


def _bring(state: _State, frame: Marks, k: int, guess: Array, loose: float) -> _State | None:
    """Turn the ball from a guess, good to `loose` [rad], so that landmarks lie on marks; None if they do not."""
    gate = float(np.clip(0.5 * spacing(state.place), *GATE))
    if loose < ANY:
        gate = min(gate, 2 * loose + 3 * MODEL)
    axes = _exp(guess) @ state.axes
    total = np.zeros(3)
    for reach in (gate, gate, 0.6 * gate):
        place = state.place @ axes.T
        near = place @ frame.place.T  # (m, k)
        own = near.argmax(axis=0)
        mutual = near.argmax(axis=1)[own] == np.arange(len(frame.place))
        seen = np.flatnonzero(mutual & (near.max(axis=0) > math.cos(reach)))
        if len(seen) == 0:
            return None
        model, marks, sd = place[own[seen]], frame.place[seen], frame.sd[seen]
        # A single mark leaves the turn about itself open: it is that of the guess about the horizontal.
        slip = SLIP[0] + SLIP[1] * float(np.hypot(*guess[:2]))
        free = state.whole or len(seen) > 1
        prior = np.full(3, loose**-2) if free else np.array([slip**-2, slip**-2, 1e-2])
        full, spread, walk = _spread(model, sd, frame.sight, prior)
        unsure = np.sqrt(sd**2 + 1.0 / state.weight[own[seen], None])
        known, pull = _equations(model, marks, unsure, frame.sight)
        move = np.asarray(np.linalg.solve(known + np.diag(prior), pull - prior * total), float)
        total = total + move
        axes = _exp(move) @ axes
    place = state.place @ axes.T
    own = own[seen]
    across, along = ways(marks, frame.sight)
    away = place[own] - marks
    away = np.stack([np.sum(away * across, axis=1), np.sum(away * along, axis=1)], axis=1)
    off = np.sum(away**2 / (unsure**2 + MODEL**2), axis=1)
    new = np.setdiff1d(np.arange(len(frame.place)), seen)
    turn = _nearest(_log(axes @ state.axes.T), guess)
    # A mark that comes into sight was hidden before, and overlaps no other; one that should be in sight is missed.
    sudden = frame.place[new] @ _exp(turn) @ frame.sight > INNER
    double = (frame.place[new] @ place.T > math.cos(OVERLAP)).any(axis=1)
    clear = np.all(place @ frame.glare.T < math.cos(GATE[1]), axis=1)
    missed = np.setdiff1d(np.flatnonzero((place @ frame.sight > INNER) & clear), own)
    wrong = int((sudden | double).sum()) + len(missed)
    new = new[~double]
    if off.mean() > (9.0 if full else 4.0) or wrong > len(seen):
        return None
    cost = float(np.minimum(off, 16).sum() + total @ total / loose**2) + MISSED * wrong + len(new)
    weight, landmarks = state.weight.copy(), state.place.copy()
    fresh = frame.weight[seen]
    landmarks[own] = landmarks[own] * weight[own, None] + (marks @ axes) * fresh[:, None]
    landmarks[own] /= np.linalg.norm(landmarks[own], axis=1, keepdims=True)
    weight[own] += fresh
    landmarks = np.concatenate([landmarks, frame.place[new] @ axes])
    weight = np.concatenate([weight, frame.weight[new]])
    whole = state.whole or (full and state.full)
    # Errors about the horizontal, which hang together, become errors about the vertical as the ball rolls on. In place
    # a single mark comes round to where it was, so that they do not add up.
    wide = math.hypot(spread[0], spread[1]) if full else 0.0
    stray = (float(turn[0]) * wide, float(turn[1]) * wide, walk if math.hypot(turn[0], turn[1]) > SLIP[0] else 0.0)
    return _State(k, axes, landmarks, weight, turn, state.spin, spread, stray, full, whole, cost)


def _equations(model: Array, marks: Array, sd: Array, sight: Array) -> tuple[Array, Array]:
    """Normal equations (3, 3), (3,) of the small rotation that takes directions (k, 3) to others."""
    across, along = ways(marks, sight)
    off = marks - model
    # A turn d moves p by d x p: along a way e by d . (p x e), and p, across, along are a right-handed tripod.
    rows = np.concatenate([along, -across])
    rest = np.concatenate([np.sum(off * across, axis=1), np.sum(off * along, axis=1)])
    weighted = rows.T / np.concatenate([sd[:, 0], sd[:, 1]]) ** 2
    return weighted @ rows, weighted @ rest


def _spread(place: Array, sd: Array, sight: Array, prior: Array) -> tuple[bool, Array, float]:
    """Whether marks fix all three angles, their sd (3,), and the variance that errors of the expected turn add to z's.

    `prior` (3,) are the inverse variances of the expected turns; where marks do not fix all, only z's sd is told.
    """
    known, _ = _equations(place, place, sd, sight)
    values = np.linalg.eigvalsh(known)
    if values[0] > APART * values[1]:
        return True, np.sqrt(np.diag(np.linalg.inv(known))), 0.0
    lever = math.sqrt(max(float(np.max(1.0 - place[:, 2] ** 2)), 1e-9))
    if MODEL / lever > BLIND:
        return False, np.array([np.nan, np.nan, np.inf]), 0.0
    prior = np.array([9.0, 9.0, 0.0]) * prior  # what is expected is allowed to be three times as wrong as it is
    variance = float(np.linalg.inv(known + np.diag(prior))[2, 2])
    return False, np.array([np.nan, np.nan, math.sqrt(variance)]), variance - 1.0 / float(known[2, 2])


def _countable(state: _State, frames: Sequence[Marks], start: int, k: int, step: float) -> bool:
    """Whether the turn from frame `start` to k, unseen in between, can be no other by whole turns."""
    gone = frames[k].time - frames[start].time
    if gone < 1.5 * step:
        return True
    speed = [(b.xy - a.xy) / (b.time - a.time) for a, b in pairwise(frames[start : k + 1])]
    met = any(math.hypot(*(b - a)) > KICK for a, b in pairwise(speed))
    doubt = 0.5 * BRAKE * gone**2 + (0.0 if state.spin is None else 0.02 * abs(float(state.spin[2])) * gone)
    return not met and doubt < WINDING


def _exp(turn: Array) -> Array:
    """Rotation (3, 3) by a vector (3,) [rad]."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, float))[0])


def _log(axes: Array) -> Array:
    """Rotation vector (3,) [rad], at most half a turn."""
    return np.asarray(cv2.Rodrigues(np.asarray(axes, float))[0]).ravel()


def _nearest(turn: Array, guess: Array) -> Array:
    """The same rotation, by as many whole turns as the guess has."""
    size = float(np.linalg.norm(turn))
    axis = turn / max(size, 1e-12)
    return np.asarray(turn + 2 * math.pi * round(float(guess @ axis - size) / (2 * math.pi)) * axis)
