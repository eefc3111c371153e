"""The edges along the sides of a table, and their sub-pixel edge points.

In: a picture and a rough camera. Out: `Edge` of every step along a side, and the points of one. noses.py decides
which of them is the nose of the cushion.

The noses hide what lies behind them, so the end of the visible bed is the image of the nose line, at the height of the
noses. Beside it there may be the cushion's outer edge (cloth against wood, about 5 cm on), the shadow of a cushion on
the bed, a dark gap under the nose, lines projected on the cloth. Each side is rectified to a strip in table
coordinates, in which edges parallel to the side are columns; averages along them show weak edges, too. Projected light
only adds: a grey opening across the strip removes thin bright lines and keeps steps in place.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, grey_opening
from scipy.signal import find_peaks

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.projection import Array, Camera

Image = NDArray[np.float32]
INWARD_SEARCH_M = 0.11  # from the outline of the cloth, in which edges are looked for
OUTWARD_SEARCH_M = 0.05
MAX_LINE_WIDTH_M = 0.012  # narrower bright lines are removed as projected light
SIDE_BLOCKS = 60  # averages along a side
SIDE_PARTS = 6  # of a side, in each of which an edge may be brighter or darker
MIN_SIGNIFICANCE = 6.0  # of an edge [standard errors]
MIN_STEP_GREY = 1.0  # of an edge [grey levels]
EXTENT_TRIALS = 11  # of a strip that may leave the picture
ALMOST_ALL = 0.9  # of what is seen of a side with the least extent
MAX_STRIP_PX = 8000  # length
MAX_EDGE_POINTS = 300  # of a side
ACROSS_STEP_PX = 0.25  # of the strip in which edge points are found
POINT_SIGNIFICANCE = 8.0  # of the step at an edge point [standard errors]
CORNER_MARGIN_MOUTHS = 1.4  # left out at a corner pocket, in widths of its mouth
MIDDLE_MARGIN_MOUTHS = 1.0  # and at a middle pocket
BARE_CORNER_MARGIN_M = 0.03  # and at a corner without pocket


@dataclass(frozen=True)
class Strip:
    """The picture along one side of the table, rectified."""

    colours: Array  # (n, m, 3) along the side, across it
    along: Array  # (n,) coordinate along the side [m]
    across: Array  # (m,) distance out of the table from the expected nose [m]
    pixel: float  # size of a pixel there [m]


@dataclass(frozen=True)
class Edge:
    """A step that runs along a side."""

    offset: float  # distance out of the table from the expected nose [m]
    places: Array  # (SIDE_PARTS,) middles of the parts of the side [m]
    steps: Array  # (SIDE_PARTS, 3) from inside to outside in each of them [grey levels]

    @property
    def strength(self) -> float:
        """Median size of the step [grey levels]."""
        return float(np.median(np.linalg.norm(self.steps, axis=1)))

    @property
    def rises(self) -> bool:
        """Whether it is brighter outside."""
        return bool(self.steps.sum() > 0)


def nose_points(camera: Camera, rail: int, along: Array, across: Array) -> Array:
    """Points at the height of the noses, at (n,) [m] along a rail and (n,) [m] outwards of its nose: (n, 3) [m]."""
    axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    half = (camera.table.length, camera.table.width)[axis] / 2
    out = np.empty((len(along), 3))
    out[:, axis], out[:, 1 - axis], out[:, 2] = sign * (half + across), along, NOSE_HEIGHT * camera.radius
    return out


def nose_crossings(camera: Camera) -> Array:
    """Where the nose lines cross: (4, 2) [pixels]."""
    return camera.project(np.hstack([camera.table.corners(), np.full((4, 1), NOSE_HEIGHT * camera.radius)]))


def strip(
    picture: Image, camera: Camera, rail: int, low: float, high: float, fine: float = 0.5, slope: float = 0.0
) -> Strip | None:
    """The picture along a rail, from low to high [m] out of its nose, every `fine` pixels across; None if not in view.

    It may run at a slope against the nose [m/m]. Pockets are left out, as is what lies outside the picture.
    """
    half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
    shapes = camera.table.shapes
    ends = half - (CORNER_MARGIN_MOUTHS * shapes.corner.mouth if camera.table.pockets else BARE_CORNER_MARGIN_M)
    coarse = np.linspace(-ends, ends, 400)
    coarse = coarse[_visible(camera, rail, coarse, low, high)]
    if len(coarse) < 20:
        return None
    pixels = camera.project(nose_points(camera, rail, coarse, np.zeros(len(coarse))))
    size = float(np.median(np.diff(coarse)) / np.median(np.linalg.norm(np.diff(pixels, axis=0), axis=1)))
    if (
        not max(coarse[-1] - coarse[0], (high - low) / fine) < MAX_STRIP_PX * size
    ):  # no camera over a table has such a view
        return None
    along = np.arange(coarse[0], coarse[-1], size)
    along = along[_visible(camera, rail, along, low, high)]
    if camera.table.pockets and rail >= 2:
        along = along[np.abs(along) > MIDDLE_MARGIN_MOUTHS * shapes.middle.mouth]
    if len(along) < 4 * SIDE_PARTS:
        return None
    across = np.arange(low, high, fine * size)
    a, u = (v.ravel() for v in np.meshgrid(along, across, indexing="ij"))
    places = camera.project(nose_points(camera, rail, a, u + slope * a)).astype(np.float32)
    shape = (len(along), len(across))
    seen = cv2.remap(
        picture, places[:, 0].reshape(shape), places[:, 1].reshape(shape), cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE
    )
    return Strip(np.asarray(seen, float), along, across, size)


def visible_extent(camera: Camera, rail: int, low: float, least: float, most: float) -> float:
    """How far out from a nose a strip from `low` may extend without losing much of the side where the picture ends [m].

    Between `least` and `most`, which is kept where not even `least` is in view.
    """
    half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
    along = np.linspace(-half, half, 100)
    tried = np.linspace(most, least, EXTENT_TRIALS)
    seen = [int(_visible(camera, rail, along, low, float(high)).sum()) for high in tried]
    return float(next((high for high, n in zip(tried, seen, strict=True) if 0 < seen[-1] * ALMOST_ALL <= n), most))


def _visible(camera: Camera, rail: int, along: Array, low: float, high: float) -> NDArray[np.bool_]:
    """Which places (n,) along a rail are in the picture, with the strip around them."""
    good = np.ones(len(along), bool)
    for across in (low, high):
        points = nose_points(camera, rail, along, np.full(len(along), across))
        pixels = camera.project(points)
        good &= ((pixels > 1) & (pixels < np.array(camera.size) - 2)).all(axis=1)
        # Far outside the picture the distortion's polynomial folds back into it.
        back = camera.on_plane(np.where(good[:, None], pixels, 0.0), float(points[0, 2]) if len(points) else 0.0)
        good &= np.linalg.norm(np.nan_to_num(back, nan=1e3) - points[:, :2], axis=1) < 1e-3
    return good


def edges(seen: Strip) -> list[Edge]:
    """Steps along a whole side, from the inside out; their sign may differ between its parts."""
    blocks = np.array_split(seen.colours, min(SIDE_BLOCKS, max(SIDE_PARTS * 2, len(seen.along) // 4)))
    step = float(seen.across[1] - seen.across[0])
    rows = gaussian_filter1d(np.stack([b.mean(axis=0) for b in blocks]), 0.7 * seen.pixel / step, axis=1)
    thin = max(3, int(np.clip(8 * seen.pixel, MAX_LINE_WIDTH_M, 2 * MAX_LINE_WIDTH_M) / step))
    rows = grey_opening(rows, (1, thin, 1))
    half = max(2, int(np.ceil(0.003 / step)))
    rise = rows[:, 2 * half :] - rows[:, : -2 * half]
    parts = np.array_split(rise, SIDE_PARTS)
    typical = np.stack([np.median(part, axis=0) for part in parts])  # (parts, m, 3)
    size = np.linalg.norm(typical, axis=2)
    strength = np.median(size, axis=0)
    scatter = 1.4826 * np.median(np.abs(rise - np.repeat(typical, [len(p) for p in parts], axis=0)), axis=0)
    error = np.maximum(np.linalg.norm(scatter, axis=1) / np.sqrt(len(blocks) / SIDE_PARTS), 0.02)
    seen_in = (size > 3 * error).mean(axis=0)
    peaks, _ = find_peaks(strength, height=MIN_STEP_GREY, prominence=0.5 * MIN_STEP_GREY)
    places = np.array([part.mean() for part in np.array_split(seen.along, SIDE_PARTS)])
    return [
        Edge(float(seen.across[k + half]), places, typical[:, k])
        for k in peaks
        if strength[k] > MIN_SIGNIFICANCE / np.sqrt(SIDE_PARTS) * error[k] and seen_in[k] > 0.5
    ]


def edge_points(picture: Image, camera: Camera, rail: int, edge: Edge, search: float) -> Array:
    """Sub-pixel edge points along a rail, within `search` pixels of the offset of the edge: (n, 2) [pixels].

    A point is where the colour changes fastest, in blocks long enough for the step to be significant. A dark gap or a
    gradient of the light beside the edge would shift a threshold halfway, but not the steepest place.
    """
    rough = strip(picture, camera, rail, edge.offset - 1e-3, edge.offset + 1e-3)
    if rough is None:
        return np.zeros((0, 2))
    margin = (search + 4) * rough.pixel
    seen = strip(picture, camera, rail, edge.offset - margin, edge.offset + margin, ACROSS_STEP_PX)
    if seen is None:
        return np.zeros((0, 2))
    part = np.argmin(np.abs(seen.along[:, None] - edge.places), axis=1)
    sizes = np.linalg.norm(edge.steps, axis=1)
    colour_axes = edge.steps / np.maximum(sizes, 1e-9)[:, None]
    level = np.einsum("nmc,nc->nm", seen.colours, colour_axes[part])  # rising outwards
    noise = 1.4826 * float(np.median(np.abs(np.diff(level, axis=0)))) / np.sqrt(2)
    block = int(np.clip((POINT_SIGNIFICANCE * noise / edge.strength) ** 2, 4, max(4, len(seen.along) // 12)))
    count = int(np.clip(len(seen.along) // block, 1, MAX_EDGE_POINTS))
    rows = np.stack([v.mean(axis=0) for v in np.array_split(level, count)])
    places, size = (np.array([v.mean() for v in np.array_split(w, count)]) for w in (seen.along, sizes[part]))
    slope = gaussian_filter1d(rows, 1.0 / ACROSS_STEP_PX, axis=1, order=1) / ACROSS_STEP_PX  # [grey levels per pixel]
    across = (seen.across - edge.offset) / seen.pixel
    within = np.where(np.abs(across) <= search, slope, -np.inf)
    at, k = np.argmax(within, axis=1), np.arange(count)
    at = np.clip(at, 1, len(across) - 2)
    before, steepest, after = slope[k, at - 1], slope[k, at], slope[k, at + 1]
    # A maximum rather than a flank, as steep as the expected step when blurred; where the step is much larger than
    # elsewhere, balls are at the side.
    typical = (size > 0.3 * edge.strength) & (size < 3.0 * edge.strength)
    good = (steepest >= before) & (steepest >= after) & (steepest > 0.12 * size) & typical
    curvature = np.where(good, before - 2 * steepest + after, -1.0)
    peak = across[at] + np.where(good, 0.5 * (before - after) / np.minimum(curvature, -1e-12), 0.0) * ACROSS_STEP_PX
    return camera.project(nose_points(camera, rail, places[good], edge.offset + peak[good] * seen.pixel))
