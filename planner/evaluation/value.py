"""The utility of a shot, the number whose expectation the search maximises.

In: a scene, outcomes of shots (planner/evaluation/outcome.py) and the user's weights. Out: one utility per shot,

    u = made ((1 - rest) + rest g) - foul fouled,   g = exp(-d / far),

with d the distance of the cue ball from the goal position; g = 1 where every position is as good. Where the position
must leave a shot on another ball, g is the quality of the best direct pot from there, (1 - cut / 75 degrees)
exp(-(path of the cue ball + path of the object ball) / 3 m), 0 if a ball blocks a path. Left out: safety play, and all
shots after the next one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.evaluation.outcome import Outcomes
from planner.scene import Scene, pocket_places

Array = NDArray[np.float64]
MAX_NEXT_CUT_RAD = math.radians(75)  # cut angle from which on the next shot has no value
PATH_SCALE_M = 3.0  # path length over which the value of the next shot falls to 1/e


@dataclass(frozen=True)
class UtilityWeights:
    """The user's weights; the field names are keys of plan files."""

    rest: float = 0.2  # part of a made shot's utility that the cue ball's position decides, 0 to 1
    far: float = 0.35  # distance from the goal position at which that part is down to 1/e [m]
    foul: float = 0.5  # cost of a foul, in pots


def rest_distance(scene: Scene, outcomes: Outcomes) -> Array:
    """Distance of the cue ball's end point from the goal position or region (n,) [m]; NaN if potted or without goal."""
    goal = scene.goal
    if goal.rest is None:
        return np.full(len(outcomes), np.nan)
    return np.maximum(np.hypot(*(outcomes.cue - goal.rest).T) - goal.rest_radius, 0.0)


def position_quality(scene: Scene, outcomes: Outcomes, far: float) -> Array:
    """Quality of the cue ball's positions, 0 to 1 (n,); `far` [m] is the scale of its exponential fall."""
    if scene.goal.rest_for:
        return _next_shot_quality(scene, outcomes.place, scene.names.index(scene.goal.rest_for))
    if scene.goal.rest is None:
        return np.where(np.isfinite(outcomes.cue[:, 0]), 1.0, 0.0)
    return np.nan_to_num(np.exp(-rest_distance(scene, outcomes) / far))


def utility(scene: Scene, outcomes: Outcomes, weights: UtilityWeights) -> Array:
    """Utility of every shot: (n,)."""
    gain = (1.0 - weights.rest) + weights.rest * position_quality(scene, outcomes, weights.far)
    return np.asarray(outcomes.made * gain - weights.foul * outcomes.foul)


def path_is_clear(start: Array, end: Array, others: Array, clearance: float) -> NDArray[np.bool_]:
    """Whether straight paths keep their distance from all other balls.

    Args:
        start: (n, 2) [m].
        end: (n, 2) [m].
        others: centres of the other balls (n, k, 2) [m]; NaN for one that is off the table.
        clearance: least distance of a path from a centre [m].
    """
    path = end - start
    length2 = np.maximum(np.sum(path * path, axis=-1), 1e-12)
    offset = others - start[:, None]
    along = np.clip(np.einsum("nki,ni->nk", offset, path) / length2[:, None], 0.0, 1.0)
    gap = np.linalg.norm(offset - along[..., None] * path[:, None], axis=-1)
    return np.asarray(~(gap < clearance).any(axis=1))


def _next_shot_quality(scene: Scene, place: Array, target: int) -> Array:
    """Quality of the best direct pot of ball number `target` with balls at places (n, nball, 2) [m]: (n,)."""
    diameter = scene.ball.diameter
    cue, ball = place[:, 0], place[:, target]
    others = np.delete(place, (0, target), axis=1)
    best = np.zeros(len(place))
    for pocket in pocket_places(scene.table).values():
        line = pocket - ball
        object_path = np.linalg.norm(line, axis=-1)
        ghost = ball - diameter * line / np.maximum(object_path, 1e-9)[:, None]
        aim = ghost - cue
        cue_path = np.linalg.norm(aim, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            cut = np.arccos(np.clip(np.sum(aim * line, axis=-1) / (cue_path * object_path), -1.0, 1.0))
        is_open = path_is_clear(ball, np.broadcast_to(pocket, ball.shape), others, diameter)
        is_open &= path_is_clear(cue, ghost, others, diameter)
        quality = np.maximum(0.0, 1.0 - cut / MAX_NEXT_CUT_RAD) * np.exp(-(cue_path + object_path) / PATH_SCALE_M)
        best = np.maximum(best, np.nan_to_num(np.where(is_open, quality, 0.0)))
    return best
