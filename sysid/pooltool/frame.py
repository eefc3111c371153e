"""Conversion of positions, velocities and spins between our frame and pooltool's, a quarter turn apart.

pooltool counts x across the table and y along it, from a corner of the nose lines. There a ball meets a nose line with
its centre a radius away, here R cos(theta), since the nose is above the centre (models/shot.py). So that balls meet
cushions in the same places, its lines stand `nose_shift` = R (1 - cos(theta)) outside of ours, on all sides.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from models.shot import NOSE_COSINE, Array

PHI_AHEAD_RAD = math.pi / 2  # angle by which pooltool's directions lead ours


def nose_shift(radius: float) -> float:
    """Distance of pooltool's nose lines outside ours [m]."""
    return radius * (1.0 - NOSE_COSINE)


@dataclass(frozen=True)
class TableFrame:
    """The frame of a pooltool table: its size between the nose lines."""

    length: float  # along y there [m]
    width: float  # along x there [m]

    def place(self, xy: Array) -> Array:
        """Our positions (..., 2) [m] in pooltool's frame."""
        xy = np.asarray(xy, float)
        return np.stack([self.width / 2 - xy[..., 1], self.length / 2 + xy[..., 0]], axis=-1)

    def place_here(self, xy: Array) -> Array:
        """pooltool's positions (..., 2) [m] in our frame."""
        xy = np.asarray(xy, float)
        return np.stack([xy[..., 1] - self.length / 2, self.width / 2 - xy[..., 0]], axis=-1)


def turned_there(vector: Array) -> Array:
    """Our vectors (..., 2 or 3) in pooltool's frame: a quarter turn counter-clockwise."""
    vector = np.asarray(vector, float)
    return np.concatenate([-vector[..., 1:2], vector[..., 0:1], vector[..., 2:]], axis=-1)
