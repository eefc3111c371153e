"""The method of Robotic Billiards (2015, section VI), as a baseline for the search.

In: a scene on its nominal model. Out: one stroke, without regard to errors of the launcher or the model.

Minimise F(q) = |C_D - C_F|^2 over q = (V_C0, x'_C, y'_C, theta), C_D the goal position and C_F the final position of
the cue ball, subject to V_C0 < 2.2 m/s, sqrt(x'_C^2 + y'_C^2) < 0.5 R, an aim that hits the object ball, and a path of
the object ball that comes within 55 mm of the pocket's middle. The genetic algorithm is differential evolution (Storn
and Price 1997, scipy's), a whole generation at a time; strokes that violate a constraint rank behind all that
satisfy them, in the order of their violation (Deb 2000). The paper's pocket is given; of several allowed ones the least
difficult is used.
"""

from __future__ import annotations

import logging
import math
from itertools import count

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from models.shot import Track
from planner.evaluation.play import Player
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED
from planner.scene import POCKETS, pocket_places
from planner.search.candidates import Route, all_routes

Array = NDArray[np.float64]
POCKET_TOLERANCE_M = 0.055  # from the object ball's path to the pocket's middle (Robotic Billiards 2015)
POPULATION_PER_UNKNOWN = 12
MAX_GENERATIONS = 40
SAMPLE_PERIOD_S = 0.02  # time between points of a path: at most 44 mm
IN_OFF_COST_M2 = 99.0  # cost of an in-off, which satisfies the paper's constraints but has no final position
VIOLATION_COST_M2 = 100.0  # least cost of a violated constraint, above any table's squared diagonal
log = logging.getLogger(__name__)


def search(player: Player, *, seed: int = 0) -> tuple[Route, Array, float]:
    """The paper's stroke: its route, q (4,), and its cost [m^2]; above VIOLATION_COST_M2 no stroke is feasible."""
    scene, launcher = player.scene, player.launcher
    route = min((r for r in all_routes(scene) if r.direct), key=lambda r: (bool(r.obstacle), r.difficulty))
    pocket = pocket_places(scene.table)[POCKETS[route.pocket]]
    limit = launcher.max_offset(scene.ball)
    cue, ball = scene.position[:2]
    line = ball - cue
    middle = math.atan2(line[1], line[0])
    window = math.asin(min(scene.ball.diameter / float(np.hypot(*line)), 1.0))
    bounds = [(launcher.slowest, launcher.fastest), (-limit, limit), (-limit, limit), (-window, window)]

    def strokes(x: Array) -> Array:
        q = np.empty((x.shape[1], 4))
        q[:, [SIDE, HEIGHT]], q[:, AZIMUTH] = x[1:3].T, middle + x[3]
        q[:, SPEED] = x[0] * launcher.gain(q, scene.ball)
        return q

    def cost(x: Array) -> Array:
        q = strokes(x.reshape(4, -1))
        excess = np.hypot(q[:, SIDE], q[:, HEIGHT]) - limit
        out = VIOLATION_COST_M2 * (2 + np.maximum(excess, 0.0) / limit)
        playable = np.flatnonzero(excess <= 0)
        if playable.size:
            tracks = player.tracks(q[playable], every=SAMPLE_PERIOD_S, jaws=False)
            out[playable] = [_cost(track, pocket, scene.goal.rest, scene.goal.rest_radius) for track in tracks]
        return np.asarray(out)

    generations = count(1)

    def progress(_: Array, convergence: float) -> None:
        log.info("generation %d of %d", next(generations), MAX_GENERATIONS)

    found = differential_evolution(
        cost, bounds, popsize=POPULATION_PER_UNKNOWN, maxiter=MAX_GENERATIONS, vectorized=True, updating="deferred",
        polish=False, tol=0.0, atol=1e-6, rng=np.random.default_rng(seed), callback=progress,
    )  # fmt: skip
    return route, strokes(found.x.reshape(4, 1))[0], float(found.fun)


def _cost(track: Track, pocket: Array, rest: Array | None, radius: float) -> float:
    """Squared distance from the goal position [m^2], or more than VIOLATION_COST_M2 for a violated constraint."""
    miss = _least_distance(track, 1, pocket)
    if miss > POCKET_TOLERANCE_M:
        return VIOLATION_COST_M2 + miss - POCKET_TOLERANCE_M
    end = track.position[-1, 0]
    if np.isnan(end[0]):
        return IN_OFF_COST_M2
    if rest is None:
        return 0.0
    return max(float(np.hypot(*(end - rest))) - radius, 0.0) ** 2


def _least_distance(track: Track, ball: int, place: Array) -> float:
    """Least distance of a ball's path from a point (2,) [m]."""
    path = track.position[:, ball]
    path = path[np.isfinite(path[:, 0])]
    for event in track.events:
        if event.kind == "pocket" and event.balls[0] == track.names[ball] and event.place is not None:
            path = np.concatenate([path, [event.place]])
    start, step = path[:-1], np.diff(path, axis=0)
    length2 = np.maximum(np.sum(step * step, axis=1), 1e-18)
    f = np.clip(np.sum((place - start) * step, axis=1) / length2, 0.0, 1.0)
    return float(np.min(np.linalg.norm(place - start - f[:, None] * step, axis=1)))
