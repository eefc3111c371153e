"""What a shot is worth: one number that the search makes large, and from which it is told what was bought.

worth = made ((1 - rest) + rest ease(d)) - foul x fouled, with d the cue ball's distance from the wanted place and
ease = exp(-d / far), 1 where every place is as good. Where the place must leave a shot on another ball, ease is
that of the best pot from there: (1 - cut / 75 degrees) x exp(-(way of the cue ball + way of the ball) / 3 m), 0 where
a ball is in the way. Leaves out safety and what comes after the next shot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from planner.evaluation.outcome import Outcomes
from planner.scene import Scene, pocket_places

Array = NDArray[np.float64]
THIN = math.radians(75)  # cut beyond which the next shot counts for nothing
FAR = 3.0  # way at which a next shot is worth 1/e of a near one [m]


@dataclass(frozen=True)
class Wish:
    """What the user asks for."""

    rest: float = 0.2  # part of a made shot's worth that the cue ball's place decides, 0 to 1
    far: float = 0.35  # distance from the wanted place at which that part is down to 1/e [m]
    foul: float = 0.5  # what a foul costs


def distance(scene: Scene, outcomes: Outcomes) -> Array:
    """How far the cue ball stopped from the wanted place, or region: (n,) [m]; NaN where potted or none is wanted."""
    goal = scene.goal
    if goal.rest is None:
        return np.full(len(outcomes), np.nan)
    return np.maximum(np.hypot(*(outcomes.cue - goal.rest).T) - goal.rest_radius, 0.0)


def ease(scene: Scene, outcomes: Outcomes, far: float) -> Array:
    """How good the cue ball's places are, 0 to 1: (n,)."""
    if scene.goal.rest_for:
        return _next_shot(scene, outcomes.place, scene.names.index(scene.goal.rest_for))
    if scene.goal.rest is None:
        return np.where(np.isfinite(outcomes.cue[:, 0]), 1.0, 0.0)
    return np.nan_to_num(np.exp(-distance(scene, outcomes) / far))


def worth(scene: Scene, outcomes: Outcomes, wish: Wish) -> Array:
    """Worth of every shot: (n,)."""
    good = (1.0 - wish.rest) + wish.rest * ease(scene, outcomes, wish.far)
    return np.asarray(outcomes.made * good - wish.foul * outcomes.foul)


def clear(start: Array, end: Array, others: Array, room: float) -> NDArray[np.bool_]:
    """Whether ways (n, 2) to (n, 2) keep `room` [m] from the centres of others (n, k, 2); NaN: a ball gone."""
    way = end - start
    size = np.maximum(np.sum(way * way, axis=-1), 1e-12)
    to = others - start[:, None]
    along = np.clip(np.einsum("nki,ni->nk", to, way) / size[:, None], 0.0, 1.0)
    gap = np.linalg.norm(to - along[..., None] * way[:, None], axis=-1)
    return np.asarray(~(gap < room).any(axis=1))


def _next_shot(scene: Scene, place: Array, target: int) -> Array:
    """Ease of the best direct pot of a ball from where balls lie (n, nball, 2): (n,)."""
    diameter = scene.ball.diameter
    cue, ball = place[:, 0], place[:, target]
    others = np.delete(place, (0, target), axis=1)
    best = np.zeros(len(place))
    for pocket in pocket_places(scene.table).values():
        line = pocket - ball
        way = np.linalg.norm(line, axis=-1)
        ghost = ball - diameter * line / np.maximum(way, 1e-9)[:, None]
        aim = ghost - cue
        run = np.linalg.norm(aim, axis=-1)
        with np.errstate(invalid="ignore", divide="ignore"):
            cut = np.arccos(np.clip(np.sum(aim * line, axis=-1) / (run * way), -1.0, 1.0))
        free = clear(ball, np.broadcast_to(pocket, ball.shape), others, diameter) & clear(cue, ghost, others, diameter)
        good = np.maximum(0.0, 1.0 - cut / THIN) * np.exp(-(run + way) / FAR)
        best = np.maximum(best, np.nan_to_num(np.where(free, good, 0.0)))
    return best
