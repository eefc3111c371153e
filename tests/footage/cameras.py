"""Ideal cameras for tests."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from models.shot import Table
from sysid.vision.camera.projection import Camera


def overhead(
    table: Table, diameter: float, size: tuple[int, int], height: float, span: float, tilt: tuple[float, float] = (0, 0)
) -> Camera:
    """An ideal camera over the table's centre.

    Args:
        table: the table below.
        diameter: of the balls [m].
        size: width and height of its pictures [pixels].
        height: of the camera over the cloth [m].
        span: how much of the table's length the width of a picture shows at the cloth [m].
        tilt: by which it looks past the table's centre along x and y [rad].
    """
    focal = size[0] * height / span
    matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    look = np.array([math.tan(tilt[0]), math.tan(tilt[1]), -1.0])
    z = look / np.linalg.norm(look)
    x = np.array([1.0, 0.0, 0.0]) - z[0] * z
    x /= np.linalg.norm(x)
    axes = np.stack([x, np.cross(z, x), z])
    return Camera(
        size, matrix, np.zeros(5), cv2.Rodrigues(axes)[0].ravel(), -axes @ np.array([0, 0, height]), table, diameter
    )


def aimed(camera: Camera, aside: tuple[float, float], beside: float) -> Camera:
    """The camera moved until all of the table, and so much beside its noses [m], is in view; it keeps its direction.

    Args:
        camera: with its lens and direction.
        aside: of the table's middle from the line of sight, in the camera's axes [m].
        beside: what must be in view, too [m].
    """
    away = float(camera.eye[2])
    while True:
        camera = replace(camera, translation=np.array([*aside, away]))
        if in_view(camera, beside):
            return camera
        away *= 1.01


def in_view(camera: Camera, beside: float) -> bool:
    """Whether all of the table, and so much beside its noses [m], is in the picture."""
    corners = (np.array([camera.table.length, camera.table.width]) / 2 + beside) * [[1, 1], [1, -1], [-1, -1], [-1, 1]]
    seen = camera.outline(corners)
    return bool((seen > 0).all() and (seen < np.array(camera.size) - 1).all())
