"""Shots in which effects show, and what the independent program makes of them."""

from __future__ import annotations

import numpy as np

from models.shot import Array, Ball, Shot, Table, Track
from tests.truth import physics
from tests.truth.cloth import Constants

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)
BASE = {
    "decoupled_cloth.slide": 0.212, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
    "ball_impact.restitution": 0.92, "ball_impact.friction": 0.05, "cushion_impact.restitution": 0.90,
    "cushion_impact.friction": 0.14,
}  # fmt: skip


def shots(count: int) -> list[Shot]:
    """A ball with spin, every other one at a ball ahead of it, for three seconds."""
    rng, found = np.random.default_rng(8), []
    for k in range(count):
        heading, n = rng.uniform(-np.pi, np.pi), 1 + k % 2
        way = np.array([np.cos(heading), np.sin(heading)])
        places = np.array([-0.3 * way, 0.1 * way + 0.02 * np.array([-way[1], way[0]])])[:n]
        v, w = np.zeros((n, 2)), np.zeros((n, 3))
        v[0], w[0] = rng.uniform(0.8, 2.0) * way, rng.normal(0, 25, 3)
        found.append(Shot(("white", "red")[:n], places, v, w, np.linspace(0, 3, 16)))
    return found


def truth(shot: Shot, hidden: dict[str, float]) -> Array:
    """Where the independent program sees the balls: (n, nball, 2) [m]."""
    starts = {
        n: physics.Start(tuple(p), tuple(v), tuple(w))
        for n, p, v, w in zip(shot.names, shot.position, shot.velocity, shot.spin, strict=True)
    }
    table = physics.Table(TABLE.length, TABLE.width, False)
    return physics.simulate(table, Constants(**hidden), starts, shot.times, increments=20_000).xy


def apart(a: list[Track], b: list[Track]) -> Array:
    """The largest distance along an axis in every shot [m]."""
    return np.array([np.abs(x.position - y.position).max() for x, y in zip(a, b, strict=True)])
