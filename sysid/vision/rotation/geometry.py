"""Directions and rotations on a sphere."""

from __future__ import annotations

import math

import cv2
import numpy as np

from sysid.vision.camera.projection import Array


def rotation_matrix(turn: Array) -> Array:
    """Rotation (3, 3) by a vector (3,) [rad]."""
    return np.asarray(cv2.Rodrigues(np.asarray(turn, float))[0])


def rotation_vector(axes: Array) -> Array:
    """Rotation vector (3,) [rad], at most half a turn."""
    return np.asarray(cv2.Rodrigues(np.asarray(axes, float))[0]).ravel()


def same_winding(turn: Array, guess: Array) -> Array:
    """The same rotation, with as many whole turns as the guess."""
    size = float(np.linalg.norm(turn))
    axis = turn / max(size, 1e-12)
    return np.asarray(turn + 2 * math.pi * round(float(guess @ axis - size) / (2 * math.pi)) * axis)


def symmetric_axes(one: Array, two: Array) -> Array:
    """Orthonormal axes (3, 3), columns, of a pair of directions, symmetric in the two."""
    first, second = one + two, one - two
    first, second = first / np.linalg.norm(first), second / np.linalg.norm(second)
    return np.column_stack([first, second, np.cross(first, second)])


def smallest_angle(place: Array) -> float:
    """Smallest angle between directions (k, 3) [rad]; pi for a single one."""
    return math.acos(min(max(float((place @ place.T - 3 * np.eye(len(place))).max()), -1.0), 1.0))


def tangents(place: Array, sight: Array) -> tuple[Array, Array]:
    """Tangents (k, 3) of the sphere across the direction to the centre of the visible face, and along it."""
    axis = sight + 1e-6 * np.array([0.3, 0.5, 0.8])
    x, y, z = place.T
    across = np.stack([axis[1] * z - axis[2] * y, axis[2] * x - axis[0] * z, axis[0] * y - axis[1] * x], axis=1)
    across /= np.sqrt(np.sum(across**2, axis=1))[:, None] + 1e-12
    along = axis - (place @ axis)[:, None] * place
    return across, along / (np.sqrt(np.sum(along**2, axis=1))[:, None] + 1e-12)
