"""The turn of a ball between two pictures, by weighted least squares: its landmarks are brought onto the marks seen.

In: the state of the ball in one picture, the marks of another, and a guess of the turn. Out: the state there, with the
standard deviations of its angles and its cost; None where landmarks and marks do not match.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array
from sysid.vision.rotation.geometry import (
    rotation_matrix,
    rotation_vector,
    same_winding,
    smallest_angle,
    tangents,
)
from sysid.vision.rotation.marks import MARK_ERROR_RAD, Marks

MAX_ANGLE_SD_RAD = 0.2  # of a turn about the vertical that counts as measured
MIN_SEPARATION_SQUARED = 0.05  # squared sine of half the angle between marks that fix an orientation
SLIP_SD = (0.003, 0.05)  # of a turn from rolling where a single mark is seen: [rad], and relative to the turn
GATE_RAD = (0.1, 0.45)  # least and greatest distance of a mark from where it is expected
INNER_COSINE = float(np.cos(np.radians(55)))  # of the angle to the line of sight, within which no mark is overlooked
MISSED_COST = 12.0  # of a mark that is not where it should be [squared standard deviations]
OVERLAP_RAD = 0.3  # distance within which two marks are one
GUESS_SD_RAD = 1.0  # of a guess that is only a start


@dataclass(frozen=True)
class MarkedState:
    """Orientation, spin and landmarks of the ball in one frame."""

    frame: int
    axes: Array  # (3, 3) rotation from the axes of the ball to those of the table
    place: Array  # (m, 3) landmarks in the axes of the ball
    weight: Array  # (m,) of the landmarks [1/rad^2]
    turn: Array  # (3,) rotation vector since the previous state [rad]
    spin: Array | None  # (3,) smoothed [rad/s]
    sd: Array  # (3,) of the orientation about x, y, z [rad]
    added_error: tuple[float, float, float]  # by this turn to the angle: two correlated parts [rad], variance [rad^2]
    full: bool  # whether all three angles are measured
    whole: bool  # whether all of the spin was measured, now or before
    cost: float  # of this frame, in squared standard deviations


def fit_turn(state: MarkedState, frame: Marks, k: int, guess: Array, guess_sd: float) -> MarkedState | None:
    """Fit a turn so that landmarks lie on marks, from a guess good to `guess_sd` [rad]; None if they do not match."""
    gate = float(np.clip(0.5 * smallest_angle(state.place), *GATE_RAD))
    if guess_sd < GUESS_SD_RAD:
        gate = min(gate, 2 * guess_sd + 3 * MARK_ERROR_RAD)
    axes = rotation_matrix(guess) @ state.axes
    total = np.zeros(3)
    for radius in (gate, gate, 0.6 * gate):
        place = state.place @ axes.T
        cosines = place @ frame.place.T  # (m, k)
        nearest = cosines.argmax(axis=0)
        mutual = cosines.argmax(axis=1)[nearest] == np.arange(len(frame.place))
        seen = np.flatnonzero(mutual & (cosines.max(axis=0) > math.cos(radius)))
        if len(seen) == 0:
            return None
        model, marks, sd = place[nearest[seen]], frame.place[seen], frame.sd[seen]
        # A single mark does not fix the turn about itself: about the horizontal it is that of the guess.
        slip = SLIP_SD[0] + SLIP_SD[1] * float(np.hypot(*guess[:2]))
        free = state.whole or len(seen) > 1
        prior = np.full(3, guess_sd**-2) if free else np.array([slip**-2, slip**-2, 1e-2])
        full, spread, walk = angle_sd(model, sd, frame.sight, prior)
        mark_sd = np.sqrt(sd**2 + 1.0 / state.weight[nearest[seen], None])
        information, gradient = _equations(model, marks, mark_sd, frame.sight)
        move = np.asarray(np.linalg.solve(information + np.diag(prior), gradient - prior * total), float)
        total = total + move
        axes = rotation_matrix(move) @ axes
    place = state.place @ axes.T
    nearest = nearest[seen]
    across, along = tangents(marks, frame.sight)
    offset = place[nearest] - marks
    offset = np.stack([np.sum(offset * across, axis=1), np.sum(offset * along, axis=1)], axis=1)
    squared_error = np.sum(offset**2 / (mark_sd**2 + MARK_ERROR_RAD**2), axis=1)
    new = np.setdiff1d(np.arange(len(frame.place)), seen)
    turn = same_winding(rotation_vector(axes @ state.axes.T), guess)
    # A new mark was hidden before and overlaps no other; a landmark that should be visible and is not is missed.
    unexpected = frame.place[new] @ rotation_matrix(turn) @ frame.sight > INNER_COSINE
    overlapping = (frame.place[new] @ place.T > math.cos(OVERLAP_RAD)).any(axis=1)
    clear = np.all(place @ frame.glare.T < math.cos(GATE_RAD[1]), axis=1)
    missed = np.setdiff1d(np.flatnonzero((place @ frame.sight > INNER_COSINE) & clear), nearest)
    contradictions = int((unexpected | overlapping).sum()) + len(missed)
    new = new[~overlapping]
    if squared_error.mean() > (9.0 if full else 4.0) or contradictions > len(seen):
        return None
    fit_cost = float(np.minimum(squared_error, 16).sum() + total @ total / guess_sd**2)
    cost = fit_cost + MISSED_COST * contradictions + len(new)
    landmarks, weight = _updated_landmarks(state, frame, axes, (seen, nearest), new)
    whole = state.whole or (full and state.full)
    # Errors about the horizontal, which are correlated, become errors about the vertical as the ball rolls on. In place
    # a single mark returns to where it was, so that they do not accumulate.
    horizontal_sd = math.hypot(spread[0], spread[1]) if full else 0.0
    walk = walk if math.hypot(turn[0], turn[1]) > SLIP_SD[0] else 0.0
    added_error = (float(turn[0]) * horizontal_sd, float(turn[1]) * horizontal_sd, walk)
    return MarkedState(k, axes, landmarks, weight, turn, state.spin, spread, added_error, full, whole, cost)


def _updated_landmarks(
    state: MarkedState,
    frame: Marks,
    axes: Array,
    matches: tuple[NDArray[np.intp], NDArray[np.intp]],
    new: NDArray[np.intp],
) -> tuple[Array, Array]:
    """Landmarks (m, 3) averaged with the marks that match them, and new ones; their weights (m,).

    `matches` are the indices of marks and of their landmarks, `new` those of new marks.
    """
    seen, nearest = matches
    weight, landmarks = state.weight.copy(), state.place.copy()
    new_weight = frame.weight[seen]
    landmarks[nearest] = landmarks[nearest] * weight[nearest, None] + (frame.place[seen] @ axes) * new_weight[:, None]
    landmarks[nearest] /= np.linalg.norm(landmarks[nearest], axis=1, keepdims=True)
    weight[nearest] += new_weight
    landmarks = np.concatenate([landmarks, frame.place[new] @ axes])
    return landmarks, np.concatenate([weight, frame.weight[new]])


def _equations(model: Array, marks: Array, sd: Array, sight: Array) -> tuple[Array, Array]:
    """Normal equations (3, 3), (3,) of the small rotation that takes directions (k, 3) to others."""
    across, along = tangents(marks, sight)
    difference = marks - model
    # A turn d moves p by d x p: along a tangent e by d . (p x e); p, across, along are right-handed axes.
    rows = np.concatenate([along, -across])
    residuals = np.concatenate([np.sum(difference * across, axis=1), np.sum(difference * along, axis=1)])
    weighted = rows.T / np.concatenate([sd[:, 0], sd[:, 1]]) ** 2
    return weighted @ rows, weighted @ residuals


def angle_sd(place: Array, sd: Array, sight: Array, prior: Array) -> tuple[bool, Array, float]:
    """Whether marks fix all three angles, the sd of the angles (3,), and the variance that z has from the prior.

    `prior` (3,) are the inverse variances of the expected turns; where marks do not fix all angles, only z has an sd.
    """
    information, _ = _equations(place, place, sd, sight)
    values = np.linalg.eigvalsh(information)
    if values[0] > MIN_SEPARATION_SQUARED * values[1]:
        return True, np.sqrt(np.diag(np.linalg.inv(information))), 0.0
    lever = math.sqrt(max(float(np.max(1.0 - place[:, 2] ** 2)), 1e-9))
    if MARK_ERROR_RAD / lever > MAX_ANGLE_SD_RAD:
        return False, np.array([np.nan, np.nan, np.inf]), 0.0
    prior = np.array([9.0, 9.0, 0.0]) * prior  # the expected turn may be three times less accurate
    variance = float(np.linalg.inv(information + np.diag(prior))[2, 2])
    return False, np.array([np.nan, np.nan, math.sqrt(variance)]), variance - 1.0 / float(information[2, 2])
