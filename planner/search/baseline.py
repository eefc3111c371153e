"""The method of Robotic Billiards (2015, section VI), to measure the search against.

Minimise F(q) = |C_D - C_F|^2 over q = (V_C0, x'_C, y'_C, theta): the cue ball's distance from the wanted place, on the
nominal model, subject to V_C0 < 2.2 m/s, sqrt(x'_C^2 + y'_C^2) < 0.5 R, an aim that hits the object ball, and an object
ball whose path goes up to the pocket within 55 mm of its middle. The genetic algorithm is differential evolution (Storn
and Price 1997, scipy's), a whole generation at a time in MuJoCo; violated constraints rank behind all that hold, the
less violated first (Deb 2000). The paper's pocket is given; of several allowed, the least demanding one is taken.
No errors of the launcher or the model enter.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from models.shot import Track
from planner.evaluation.play import Player
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED
from planner.scene import POCKETS, pocket_places
from planner.search.candidates import Way, every_way

Array = NDArray[np.float64]
MARGIN = 0.055  # of the object ball's path from the pocket's middle (Robotic Billiards 2015) [m]
POPULATION = 12  # strokes for each of the four unknowns
GENERATIONS = 40
EVERY = 0.02  # between the points of a path, 44 mm at the fastest [s]
IN_OFF = 99.0  # cost of one, which keeps the paper's rules and has no place [m^2]
ABOVE = 100.0  # cost from which a constraint is violated [m^2], larger than any table's squared diagonal


def search(player: Player, *, seed: int = 0, report: Callable[[str], None] | None = None) -> tuple[Way, Array, float]:
    """The paper's stroke: its way, q (4,), and the cost that it was found at: above ABOVE no shot keeps the rules."""
    scene, launcher = player.scene, player.launcher
    direct = [w for w in every_way(scene) if w.bank < 0 and w.kick < 0]
    way = min(direct, key=lambda w: (bool(w.lies), w.effort))
    pocket = pocket_places(scene.table)[POCKETS[way.pocket]]
    limit = launcher.offset * scene.ball.radius
    cue, ball = scene.position[:2]
    to = ball - cue
    apart = float(np.hypot(*to))
    middle, window = math.atan2(to[1], to[0]), math.asin(min(scene.ball.diameter / apart, 1.0))
    bounds = [(launcher.slowest, launcher.fastest), (-limit, limit), (-limit, limit), (-window, window)]

    def strokes(x: Array) -> Array:
        q = np.empty((x.shape[1], 4))
        q[:, [SIDE, HEIGHT]], q[:, AZIMUTH] = x[1:3].T, middle + x[3]
        q[:, SPEED] = x[0] * launcher.gain(q, scene.ball)
        return q

    def cost(x: Array) -> Array:
        q = strokes(x.reshape(4, -1))
        out = np.empty(len(q))
        over = np.hypot(q[:, SIDE], q[:, HEIGHT]) - limit
        out[:] = ABOVE * (2 + np.maximum(over, 0.0) / limit)
        good = np.flatnonzero(over <= 0)
        if good.size:
            tracks = player.tracks(q[good], every=EVERY, jaws=False)
            out[good] = [_cost(track, pocket, scene.goal.rest, scene.goal.rest_radius) for track in tracks]
        return out

    count = 0

    def tell(_: Array, convergence: float) -> None:
        nonlocal count
        count += 1
        if report:
            report(f"generation {count} of {GENERATIONS}")

    found = differential_evolution(
        cost, bounds, popsize=POPULATION, maxiter=GENERATIONS, vectorized=True, updating="deferred", polish=False,
        tol=0.0, atol=1e-6, rng=np.random.default_rng(seed), callback=tell,
    )  # fmt: skip
    return way, strokes(found.x.reshape(4, 1))[0], float(found.fun)


def _cost(track: Track, pocket: Array, rest: Array | None, radius: float) -> float:
    """Squared distance from the wanted place [m^2], or more than ABOVE where a constraint is violated."""
    past = _nearest(track, 1, pocket)
    if past > MARGIN:
        return ABOVE + past - MARGIN
    end = track.position[-1, 0]
    if np.isnan(end[0]):
        return IN_OFF
    if rest is None:
        return 0.0
    return max(float(np.hypot(*(end - rest))) - radius, 0.0) ** 2


def _nearest(track: Track, ball: int, place: Array) -> float:
    """How near a ball's path comes to a place [m]."""
    path = track.position[:, ball]
    path = path[np.isfinite(path[:, 0])]
    for event in track.events:
        if event.kind == "pocket" and event.balls[0] == track.names[ball] and event.place is not None:
            path = np.concatenate([path, [event.place]])
    a, way = path[:-1], np.diff(path, axis=0)
    size = np.maximum(np.sum(way * way, axis=1), 1e-18)
    f = np.clip(np.sum((place - a) * way, axis=1) / size, 0.0, 1.0)
    return float(np.min(np.linalg.norm(place - a - f[:, None] * way, axis=1)))
