"""Places, velocities and spins between our frame and pooltool's, which is a quarter of a turn from it.

pooltool counts x across the table and y along it, from a corner of the nose lines. There a ball meets a nose line with
its centre a radius away, here R cos(theta), since the nose is above the centre (models/shot.py). So that balls meet
cushions in the same places, its lines stand `nose_shift` = R (1 - cos(theta)) outside of ours, on all sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.shot import NOSE_COSINE, Array

PHI_AHEAD_RAD = math.pi / 2  # by which directions there are ahead of ours


def nose_shift(radius: float) -> float:
    """By how much pooltool's nose lines stand outside of ours [m]."""
    return radius * (1.0 - NOSE_COSINE)


@dataclass(frozen=True)
class Frame:
    """The size of a table there, between its nose lines."""

    length: float  # along y there [m]
    width: float  # along x there [m]

    def place(self, xy: Array) -> Array:
        """Places (..., 2) [m] of ours, there."""
        xy = np.asarray(xy, float)
        return np.stack([self.width / 2 - xy[..., 1], self.length / 2 + xy[..., 0]], axis=-1)

    def place_here(self, xy: Array) -> Array:
        """Places (..., 2) [m] of pooltool, here."""
        xy = np.asarray(xy, float)
        return np.stack([xy[..., 1] - self.length / 2, self.width / 2 - xy[..., 0]], axis=-1)


def turned_there(vector: Array) -> Array:
    """Vectors (..., 2 or 3) of ours, there: a quarter of a turn counter-clockwise."""
    vector = np.asarray(vector, float)
    return np.concatenate([-vector[..., 1:2], vector[..., 0:1], vector[..., 2:]], axis=-1)


def turned_here(vector: Array) -> Array:
    """Vectors (..., 2 or 3) of pooltool, here."""
    vector = np.asarray(vector, float)
    return np.concatenate([vector[..., 1:2], -vector[..., 0:1], vector[..., 2:]], axis=-1)
