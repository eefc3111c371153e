"""Balls and cushions that meet at random, and their energy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MASS, RADIUS = 0.1406, 0.02625  # snooker (Mathavan 2010, 2014)
BALLS, CUSHION = (0.89, 0.05, 0.21), (0.98, 0.14, 0.212)  # restitution, friction, friction of the cloth
MIRROR = {True: np.array([-1, 1, 1, -1, -1]), False: np.tile([1, -1, -1, 1, -1], 2)}


def energy(state: Array) -> float:
    """v^2 + 2/5 (R omega)^2 [m^2/s^2]."""
    rows = state.reshape(-1, 5)
    return float(np.sum(rows[:, :2] ** 2) + 0.4 * np.sum(rows[:, 2:] ** 2))


def approaching(cushion: bool, angle: float, roll: float, side: float) -> Array:
    """Speed 1: at an angle [deg] from the cushion's line, or to the line of centres of a ball at rest."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    ball = np.array([c, s, -roll * s, roll * c, side])
    return ball if cushion else np.concatenate([ball, np.zeros(5)])


def random_states(cushion: bool, count: int, seed: int = 5) -> list[Array]:
    """Rolling, sliding, with side."""
    noise = np.random.default_rng(seed)
    made = []
    for _ in range(count):
        roll = 1.0 if noise.random() < 0.4 else noise.uniform(-1, 2)
        side = 0.0 if noise.random() < 0.3 else noise.uniform(-1, 1)
        made.append(approaching(cushion, noise.uniform(5, 90) if cushion else noise.uniform(-80, 80), roll, side))
    return made
