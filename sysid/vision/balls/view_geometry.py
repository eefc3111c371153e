"""What a camera's geometry says of its pictures: where bed, cushions and balls are, and the outlines of balls.

In: a camera. Out: masks of the picture, and for every pixel the outline that a ball centred there would have, sampled
at OUTLINE_NORMALS points with the normals to it.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.projection import OUTLINE_POINTS, Camera

Array = NDArray[np.float64]
Image = NDArray[np.float32]
Mask = NDArray[np.bool_]

OUTLINE_NORMALS = 64  # points of an outline at which its normal is followed
NODE_SPACING_PX = 8  # between the nodes of quantities that are smooth over the picture
OUTLINE_GRID_PX = 32  # between the places for which outlines are computed; interpolated between


@dataclass(frozen=True)
class ViewGeometry:
    """Which parts of the picture show what, and the outlines of balls, from the camera's geometry alone."""

    camera: Camera
    bed: Mask  # (h, w) pixels that show the bed
    behind_noses: Mask  # (h, w) pixels whose line of sight passes over the nose line at its height
    ball_region: Mask  # (h, w) pixels that balls on the table can cover
    centre_region: Mask  # (h, w) pixels where the centres of outlines can be
    box: tuple[int, int, int, int]  # columns and rows x0, x1, y0, y1 that enclose the ball region
    outlines: Array  # (rows, columns, OUTLINE_NORMALS, 5): offset from centre and normal [pixels], height [m]

    def outline(self, pixel: Array) -> tuple[Array, Array, Array]:
        """Outline of a ball centred at a pixel (2,): offsets (n, 2), normals (n, 2), heights (n,) [m]; n normals."""
        rows, columns = self.outlines.shape[:2]
        u, v = (
            np.clip(pixel[0] / OUTLINE_GRID_PX, 0, columns - 1.001),
            np.clip(pixel[1] / OUTLINE_GRID_PX, 0, rows - 1.001),
        )
        i, j = int(u), int(v)
        u, v = u - i, v - j
        corners = self.outlines[j : j + 2, i : i + 2]
        shape = (1 - v) * ((1 - u) * corners[0, 0] + u * corners[0, 1]) + v * (
            (1 - u) * corners[1, 0] + u * corners[1, 1]
        )
        return shape[:, :2], shape[:, 2:4], shape[:, 4]

    def radius(self, pixel: Array) -> float:
        """Mean radius of the outline of a ball centred at a pixel (2,) [pixels]."""
        return float(np.linalg.norm(self.outline(pixel)[0], axis=1).mean())

    def on_bed(self, pixel: Array) -> bool:
        """Whether a ball centred at a pixel (2,) is on the bed, clear of the pockets, which are discs themselves."""
        xy = self.camera.on_plane(pixel[None], self.camera.radius)
        half = np.array([self.camera.table.length, self.camera.table.width]) / 2
        return bool((np.abs(xy) < half).all() and self.camera.table.to_pocket(xy)[0] > self.camera.diameter)


def view_geometry(camera: Camera) -> ViewGeometry:
    """Where bed, cushions and balls are or can be in the picture of a camera."""
    nose, radius = NOSE_HEIGHT * camera.radius, camera.radius
    half = np.array([camera.table.length, camera.table.width], np.float32) / 2
    low, high, middle = (_plane(camera, z) for z in (0.0, nose, radius))
    behind_noses = np.asarray((np.abs(high) > half).any(axis=2))
    bed = np.asarray((np.abs(low) < half).all(axis=2) & ~behind_noses)
    ball_region = np.asarray((np.abs(middle) < half + radius).all(axis=2))
    centre_region = np.asarray((np.abs(middle) < half - radius / 2).all(axis=2))
    rows, columns = np.flatnonzero(ball_region.any(axis=1)), np.flatnonzero(ball_region.any(axis=0))
    box = (int(columns[0]), int(columns[-1]) + 1, int(rows[0]), int(rows[-1]) + 1) if len(rows) else (0, 0, 0, 0)
    return ViewGeometry(camera, bed, behind_noses, ball_region, centre_region, box, _outlines(camera))


def _plane(camera: Camera, height: float) -> Image:
    """Where the line of sight of every pixel meets the plane z = height: (h, w, 2) [m]; 1e3 where it does not."""
    w, h = camera.size
    columns, rows = (
        np.arange(0, w + NODE_SPACING_PX, NODE_SPACING_PX),
        np.arange(0, h + NODE_SPACING_PX, NODE_SPACING_PX),
    )
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    points = np.nan_to_num(camera.on_plane(nodes, height), nan=1e3).clip(-1e3, 1e3)
    grid = points.reshape(len(rows), len(columns), 2).astype(np.float32)
    x, y = np.meshgrid(
        np.arange(w, dtype=np.float32) / NODE_SPACING_PX, np.arange(h, dtype=np.float32) / NODE_SPACING_PX
    )
    return np.asarray(cv2.remap(grid, x, y, cv2.INTER_LINEAR))


def _outlines(camera: Camera) -> Array:
    w, h = camera.size
    columns, rows = (
        np.arange(0, w + 2 * OUTLINE_GRID_PX, OUTLINE_GRID_PX),
        np.arange(0, h + 2 * OUTLINE_GRID_PX, OUTLINE_GRID_PX),
    )
    nodes = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    limit = 2.0 * np.array([camera.table.length, camera.table.width])
    places = np.clip(np.nan_to_num(camera.centres(nodes), nan=1e3), -limit, limit)
    rims = camera.rims(places)
    ray, centre = camera.rays(rims.reshape(-1, 2)), np.column_stack([places, np.full(len(places), camera.radius)])
    sight = np.repeat(centre - camera.eye, OUTLINE_POINTS, axis=0)
    heights = (camera.eye[2] + np.sum(ray * sight, axis=1) * ray[:, 2]).reshape(-1, OUTLINE_POINTS)
    # Fourier series through the points, which are evenly spaced on the circle of contact of the cone of sight.
    order = np.fft.fftfreq(OUTLINE_POINTS, 1 / OUTLINE_POINTS)
    inverse = np.exp(2j * np.pi * np.outer(np.arange(OUTLINE_NORMALS) / OUTLINE_NORMALS, order))
    transform = np.exp(-2j * np.pi * np.outer(order, np.arange(OUTLINE_POINTS) / OUTLINE_POINTS)) / OUTLINE_POINTS
    series, tangent_series = (
        (inverse @ transform).real,
        ((inverse * (1j * order * (np.abs(order) < OUTLINE_POINTS / 2))) @ transform).real,
    )
    rims = rims - rims.mean(axis=1, keepdims=True)
    offsets, tangents = series @ rims, tangent_series @ rims
    normals = np.stack([tangents[..., 1], -tangents[..., 0]], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    normals *= np.sign(np.sum(normals * offsets, axis=-1, keepdims=True))
    shape = np.concatenate([offsets, normals, (series @ heights[..., None])], axis=-1)
    return np.asarray(shape.reshape(len(rows), len(columns), OUTLINE_NORMALS, 5))
