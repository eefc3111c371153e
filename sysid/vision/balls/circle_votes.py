"""A circular Hough transform: edges of what differs from the empty table vote for the centres of outlines.

In: the geometry of the view and a picture. Out: `CoarseGrid`, the picture of the table in which votes are counted, and
the votes of a difference picture. The cells are so coarse that the smallest outline has a radius of a few of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.balls.view_geometry import Array, Image, Mask, ViewGeometry

MIN_RADIUS_CELLS = 5.0  # radius of the smallest outline in the coarse picture


@dataclass(frozen=True)
class CoarseGrid:
    """The coarse picture in which outlines vote for their centres."""

    cell: int  # pixels along the side of a cell
    corner: Array  # (2,) column and row of its first pixel
    table: Image  # (rows, columns, 3) the empty table
    ball_region: Mask  # (rows, columns, 1) that balls can cover
    centre_region: Mask  # (rows, columns) where their centres can be
    radius: Image  # (rows, columns) of outlines [cells]
    clean_votes: float  # votes that a clean, complete outline gets


def coarse_grid(geometry: ViewGeometry, table: Image) -> CoarseGrid:
    """A grid in which the smallest outline still has a radius of a few cells."""
    x0, x1, y0, y1 = geometry.box
    sizes = [geometry.radius(np.array([x, y])) for x in np.linspace(x0, x1, 9) for y in np.linspace(y0, y1, 9)]
    smallest = float(np.min(sizes))
    if not 0 < smallest < min(x1 - x0, y1 - y0):
        raise BadInput(
            f"balls of {smallest:.3g} pixels on a table of {x1 - x0} x {y1 - y0}: calibrate the camera again"
        )
    cell = max(1, int(smallest / MIN_RADIUS_CELLS))
    size = columns, rows = (x1 - x0) // cell, (y1 - y0) // cell

    def coarse(picture: NDArray[np.generic]) -> Image:
        window = picture[y0 : y0 + rows * cell, x0 : x0 + columns * cell].astype(np.float32)
        return np.asarray(cv2.resize(window, size, interpolation=cv2.INTER_AREA))

    radii = np.array(sizes, np.float32).reshape(9, 9).T / cell
    radius = np.asarray(cv2.resize(radii, size, interpolation=cv2.INTER_LINEAR))
    ball_region, centre_region = (coarse(mask) > 0.5 for mask in (geometry.ball_region, geometry.centre_region))
    r = float(np.median(radius))
    down, across = np.mgrid[: int(6 * r) + 4, : int(6 * r) + 4] - (3 * r + 2)
    disc = 100 * np.clip(r - np.hypot(across, down) + 0.5, 0, 1).astype(np.float32)[..., None].repeat(3, axis=2)
    clean_votes = float(circle_votes(disc, np.full(disc.shape[:2], r, np.float32), 1.0).max())
    return CoarseGrid(
        cell, np.array([x0, y0]), coarse(table), ball_region[..., None], centre_region, radius, clean_votes
    )


def circle_votes(difference: Image, radius: Image, noise: float) -> Image:
    """Circular Hough transform: every edge in the difference (rows, columns, 3) votes a radius to either side of it."""
    gx, gy = (cv2.Sobel(difference, cv2.CV_32F, i, 1 - i, ksize=3, scale=0.125) for i in (1, 0))
    slope_squared = gx * gx + gy * gy
    channel = slope_squared.argmax(axis=2)
    best = np.take_along_axis(slope_squared, channel[..., None], axis=2)[..., 0]
    min_slope = 1.5 + 1.5 * noise
    rows, columns = np.nonzero(best > min_slope**2)
    channel, slope = channel[rows, columns], np.sqrt(best[rows, columns])
    ux, uy = gx[rows, columns, channel] / slope, gy[rows, columns, channel] / slope
    weight, r = np.minimum(slope / (3 * min_slope), 1.0), radius[rows, columns]
    h, w = radius.shape
    total = np.zeros(h * w)
    for side in (-1, 1):
        x, y = np.rint(columns + side * r * ux).astype(int), np.rint(rows + side * r * uy).astype(int)
        inside = (x >= 0) & (x < w) & (y >= 0) & (y < h)
        total += np.bincount((y * w + x)[inside], weight[inside], h * w)
    return np.asarray(cv2.GaussianBlur(total.reshape(h, w).astype(np.float32), (0, 0), 1.0))
