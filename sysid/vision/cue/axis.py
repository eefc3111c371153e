"""The axis of a cue on the plane of the balls' centres, z = R, from the two edges of the cue in pictures.

In: pictures, a camera and the place of the struck ball. Out: `CueAxis`. It is looked for where the pictures change in a
narrow strip that leads to the ball; there, sections across the strip give both edges of the cue to a fraction of a
pixel. The taper is symmetric, so the middles of the edges lie on the axis.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.sources.pictures import Picture

Image = NDArray[np.float32]

SEARCH_LENGTH_M = 0.35  # behind the ball, in which a cue is looked for
EDGE_LENGTH_M = 0.8  # behind the ball, over which its edges are measured
LANE_OFFSETS_M = (0.008, 0.012)  # from the axis of a cue near its tip to bare cloth: fine search, coarse search
CLOTH_OFFSETS_M = (0.013, 0.018)  # from the axis of a cue to bare cloth, all along it: from, to
CUE_WIDTHS_M = (0.004, 0.026)  # least and greatest width of a cue
SECTION_LENGTH_M = 0.012  # along the axis
MIN_CONTRAST_GREY = 10.0  # of an edge [grey levels]
MIN_SECTIONS = 6  # that make an axis


@dataclass(frozen=True)
class CueAxis:
    """The axis of a cue: a line on the plane of the balls' centres, relative to the ball."""

    ball: Array  # (2,) [m]
    azimuth: float  # of travel [rad]
    side: float  # offset to the right [m]

    @property
    def direction(self) -> Array:
        """Unit vector of travel: (2,)."""
        return np.array([math.cos(self.azimuth), math.sin(self.azimuth)])

    def points(self, behind: Array, across: Array) -> Array:
        """Points (n, m, 2) [m] at distances behind the ball (n,) and to the right of the axis (m,) [m]."""
        right = np.array([self.direction[1], -self.direction[0]])
        return np.asarray(self.ball + (self.side + across)[:, None] * right - behind[:, None, None] * self.direction)

    def shifted(self, offset: float, slope: float) -> CueAxis:
        """The axis shifted to the right by `offset` [m] at the ball, and by `slope` per distance behind it."""
        return replace(self, azimuth=self.azimuth + math.atan(slope), side=self.side + offset)


def sample_colours(picture: Picture, pixels: Array) -> Image:
    """Colours (n, m, c) at pixels (n, m, 2); NaN outside the picture."""
    h, w = picture.shape[:2]
    low = np.clip(np.floor(pixels.reshape(-1, 2).min(axis=0)).astype(int) - 1, 0, [w - 1, h - 1])
    high = np.clip(np.ceil(pixels.reshape(-1, 2).max(axis=0)).astype(int) + 2, low + 1, [w, h])
    part = np.ascontiguousarray(picture[low[1] : high[1], low[0] : high[0]], np.float32)
    at = (pixels - low).astype(np.float32)
    outside = (math.nan,) * 4
    seen = cv2.remap(part, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, outside)
    return np.asarray(seen, np.float32).reshape(*pixels.shape[:2], -1)


def plane_pixels(camera: Camera, points: Array) -> Array:
    """Pixels (n, m, 2) of points (n, m, 2) [m] on the plane of the balls' centres."""
    flat = points.reshape(-1, 2)
    return camera.project(np.column_stack([flat, np.full(len(flat), camera.radius)])).reshape(points.shape)


def candidate_axes(pictures: Sequence[Picture], camera: Camera, ball: Array, scale: float) -> list[CueAxis]:
    """Lines to the ball along which a narrow strip of the pictures changes, best first."""
    step = max(scale, 0.0015)
    ticks = np.arange(-SEARCH_LENGTH_M - LANE_OFFSETS_M[1], SEARCH_LENGTH_M + LANE_OFFSETS_M[1] + step / 2, step)
    pixels = plane_pixels(camera, ball + np.stack(np.meshgrid(ticks, ticks), axis=-1))

    def view(picture: Picture) -> Image:
        """The cloth around the ball, rectified."""
        return np.reshape(cv2.GaussianBlur(sample_colours(picture, pixels), (0, 0), 0.8), (len(ticks), len(ticks), -1))

    views = np.array([view(p) for p in (*pictures[:: max(1, len(pictures) // 10)], pictures[-1])])
    change = np.nan_to_num(np.abs(views - views.min(axis=0)).max(axis=0)).sum(axis=2)
    noise = float(np.median(change)) + 1.0
    behind = np.arange(camera.radius + 0.01, SEARCH_LENGTH_M, 0.004)
    angles = np.radians(np.arange(0, 360, 1.5))
    sides = np.arange(-0.8, 0.81, 0.13) * camera.radius
    found: list[CueAxis] = []
    score = _strip_contrast(change, step, angles, sides, behind, noise, LANE_OFFSETS_M[1])
    for _ in range(4):
        a, s = np.unravel_index(int(np.argmax(score)), score.shape)
        if score[a, s] < 0.08:
            break
        near, fine = angles[a] + np.radians(np.arange(-5, 5.01, 0.25)), sides[s] + np.arange(-8, 8.1, 1.0) * 1e-3
        closer = _strip_contrast(change, step, near, fine, behind, noise, LANE_OFFSETS_M[0])
        i, j = np.nonzero(closer > 0.95 * closer.max())
        found.append(CueAxis(ball, float(near[i].mean()), float(fine[j].mean())))
        score[np.abs(np.angle(np.exp(1j * (angles - angles[a])))) < math.radians(4)] = 0
    return found


def _strip_contrast(
    change: Image, step: float, angles: Array, sides: Array, behind: Array, noise: float, lane_offset: float
) -> Array:
    """Contrast of a strip to both sides of it, along lines with angles (n,) [rad] and sides (m,) [m]: (n, m)."""
    middle = (change.shape[0] - 1) / 2
    directions = np.exp(1j * angles)[:, None, None, None]
    lanes = sides[:, None, None] + np.array([0.0, -lane_offset, lane_offset])[:, None]
    points = -1j * directions * lanes - directions * behind
    x, y = (np.clip(np.rint(v / step + middle), 0, 2 * middle).astype(int) for v in (points.real, points.imag))
    seen = change[y, x]  # (n, m, 3, stations)
    contrast = seen[:, :, 0] - np.maximum(seen[:, :, 1], seen[:, :, 2])
    return np.asarray(np.clip(contrast / noise - 1.5, 0, 3).mean(axis=2))


def align_axis(
    axis: CueAxis, pictures: Sequence[Picture], camera: Camera, scale: float
) -> tuple[CueAxis, Array] | None:
    """The axis of a cue, and for each picture (k, 6): its index, offset at the ball [m], slope, their sd, sections."""
    across = np.arange(-CLOTH_OFFSETS_M[1], CLOTH_OFFSETS_M[1] + 1e-9, max(scale / 4, 2e-4))
    behind = np.arange(camera.radius + 0.008, EDGE_LENGTH_M, max(SECTION_LENGTH_M / 8, scale / 2))
    for last in (False, False, True):
        pixels = plane_pixels(camera, axis.points(behind, across))
        fits: list[tuple[float, ...]] = []
        for k in range(0, len(pictures), 1 if last else max(1, len(pictures) // 8)):
            fit = fit_axis(*_edges(sample_colours(pictures[k], pixels), behind, across), scale)
            if fit is not None:
                fits.append((k, *fit))
        if not fits:
            return None
        if not last:
            _, offset, slope, *_ = np.median(np.array(fits[-8:]), axis=0)
            axis = axis.shifted(float(offset), float(slope))
    return axis, np.array(fits)


def _edges(strip: Image, behind: Array, across: Array) -> tuple[Array, Array, Array]:
    """Sections of a strip (n, m, c) that show both edges: distance behind the ball (k,), middle and width [m]."""
    count = max(1, round(SECTION_LENGTH_M / (behind[1] - behind[0])))
    n = len(behind) // count
    block = strip[: n * count].reshape(n, count, len(across), -1).mean(axis=1)
    positions = behind[: n * count].reshape(n, count).mean(axis=1)
    whole = np.isfinite(block).all(axis=(1, 2))
    block, positions = block[whole], positions[whole]
    inner = np.median(block[:, np.abs(across) < 0.002], axis=1)
    edges = []
    for sign in (-1, 1):
        outside = np.median(block[:, (sign * across > CLOTH_OFFSETS_M[0])], axis=1)
        contrast = inner - outside
        size = np.sum(contrast**2, axis=1) + 1e-9
        part = np.sum((block - outside[:, None]) * contrast[:, None], axis=2) / size[:, None]
        y, level = across[::sign], part[:, ::sign]
        y, level = y[sign * y >= 0], level[:, sign * y >= 0]
        below = level < 0.5
        first = np.maximum(below.argmax(axis=1), 1)
        rows = np.arange(len(block))
        one, two = level[rows, first - 1], level[rows, first]
        edge = y[first - 1] + (y[first] - y[first - 1]) * (one - 0.5) / np.maximum(one - two, 1e-9)
        edges.append(np.where(below.any(axis=1) & (one >= 0.5) & (size > MIN_CONTRAST_GREY**2), edge, np.nan))
    middle, width = 0.5 * (edges[0] + edges[1]), edges[1] - edges[0]
    good = (width > CUE_WIDTHS_M[0]) & (width < CUE_WIDTHS_M[1])
    return positions[good], middle[good], width[good]


def fit_axis(behind: Array, middle: Array, width: Array, scale: float) -> tuple[float, float, float, float, int] | None:
    """Offset at the ball [m], slope, their sd, and the number of sections that fit a taper; None if too few."""
    if len(behind) < MIN_SECTIONS:
        return None
    inliers = _inliers(behind, width, 0.5 * scale)
    taper = np.polyfit(behind[inliers], width[inliers], 1)
    inliers &= np.abs(width - np.polyval(taper, behind)) < np.maximum(scale, 0.15 * width)
    if inliers.sum() < MIN_SECTIONS or not -0.002 < taper[0] < 0.03:
        return None
    behind, middle = behind[inliers], middle[inliers]
    use = _inliers(behind, middle, 0.1 * scale)
    if use.sum() < MIN_SECTIONS:
        return None
    (slope, offset), spread = np.polyfit(behind[use], middle[use], 1, cov="unscaled")
    residual = middle[use] - offset - slope * behind[use]
    rms = max(math.sqrt(float(residual @ residual) / (len(residual) - 2)), 0.02 * scale)
    if rms > 0.5 * scale:
        return None
    return float(offset), float(slope), rms * math.sqrt(spread[1, 1]), rms * math.sqrt(spread[0, 0]), len(residual)


def _inliers(x: Array, y: Array, least: float) -> NDArray[np.bool_]:
    """Inliers (n,) of the line through points by Theil and Sen's median of slopes; `least` is the least noise of y."""
    i, j = np.triu_indices(len(x), 1)
    distant = np.abs(x[i] - x[j]) >= 0.5 * np.median(np.abs(x[i] - x[j]))
    residual = y - x * float(np.median((y[i] - y[j])[distant] / (x[i] - x[j])[distant]))
    residual = np.abs(residual - np.median(residual))
    return np.asarray(residual < 4.0 * max(1.4826 * float(np.median(residual)), least))
