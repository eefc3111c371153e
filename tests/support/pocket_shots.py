"""Shots into pockets and at their jaws."""

from __future__ import annotations

import numpy as np

from models.shot import Ball, Shot, Table

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778)
R = BALL.radius
HALF = np.array([TABLE.length, TABLE.width]) / 2


def into_pockets(n: int, seed: int, balls: int) -> list[Shot]:
    """Balls on their way to all pockets and their jaws, of their own or sent by one that comes from behind."""
    noise, made = np.random.default_rng(seed), []
    for k in range(n):
        sides = np.array([(1, 1), (0, 1), (-1, 1), (1, -1), (0, -1), (-1, -1)][k % 6])
        angle = np.arctan2(sides[1], sides[0]) + noise.uniform(-0.5, 0.5)
        u = np.array([np.cos(angle), np.sin(angle)])
        p = HALF * sides - noise.uniform(0.35, 0.6) * u + noise.uniform(-0.06, 0.06) * np.array([-u[1], u[0]])
        p = np.clip(p, 0.03 - HALF, HALF - 0.03)
        v, w, position = np.zeros((balls, 2)), np.zeros((balls, 3)), p - np.arange(balls)[::-1, None] * 0.2 * u
        v[0] = noise.uniform(0.6, 3.0) * u
        w[0] = [-v[0, 1] / R, v[0, 0] / R, noise.uniform(-30, 30)]
        made.append(Shot(tuple("ab"[:balls]), position, v, w, np.linspace(0, 3, 31)))
    return made
