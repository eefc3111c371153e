"""Where balls may be in a picture: centres of circles, blobs that motion has drawn out, and discs that cover the table.

In: a picture beside the background. Out: pixels from which the fits of outlines (outline_fit.py) and discs (discs.py)
begin.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from sysid.vision.balls.background import View, is_foreground
from sysid.vision.balls.circle_votes import circle_votes
from sysid.vision.balls.cover import covered
from sysid.vision.balls.view_geometry import Array, Image

MIN_VOTE_FRACTION = 0.2  # of the votes for a clean outline, that makes a candidate
MAX_CANDIDATES = 48  # in a picture
SMEAR_WINDOW_RADII = 3.0  # half the side of the window about a moving ball
SHADOW_FRACTION = 0.55  # of the light, that the darkest shadow leaves
MIN_SMEAR_RADII = 0.15  # shorter motion during the exposure is none
MAX_SMEAR_RADII = 3.0  # longer motion is no ball's
MAX_VARIANCE_MISMATCH = 0.25  # relative, between the variances of a blob and those of a stadium
MAX_RATIO_MISMATCH = 0.2  # relative, between the ratios of these variances
CELLS_PER_RADIUS = 4.0  # of the coarse picture in which balls are sought
RING_WIDTH_RADII = 0.45  # about a disc, with which its cover is compared
MIN_PEAK = 0.22  # cover of a disc less that of its ring; a ball swept by three radii still has a third
MAX_PEAKS = {"one": 6, "any": 40}  # in a picture, of one colour and of any


def motion_blurred(view: View, pixel: Array) -> tuple[Array, Array, bool] | None:
    """The blob about a pixel (2,) as a ball blurred by its motion; None if its shape is no stadium.

    Area and variances of the blob are compared with those of a stadium, which is a disc swept along a line. Returns its
    centre (2,) and motion during the exposure (2,) [pixels], and whether the ratio of its variances fits, too.
    """
    radius = view.geometry.radius(pixel)
    window, table, corner = view.window(pixel, SMEAR_WINDOW_RADII * radius)
    if min(window.shape[:2]) < 3:
        return None
    # Shadows are removed: they are the colour of the table, darker.
    share = ((window * table).sum(axis=2) / np.maximum((table * table).sum(axis=2), 1.0)).clip(SHADOW_FRACTION, 1.1)
    difference = np.abs(cv2.GaussianBlur(window - share[..., None] * table, (0, 0), 0.7))
    foreground = is_foreground(difference, table, view.noise).astype(np.uint8)
    _, labels, stats, centroids = cv2.connectedComponentsWithStats(foreground)
    large = [k for k in range(1, len(stats)) if stats[k, cv2.CC_STAT_AREA] > 0.8 * np.pi * radius**2]
    if not large:
        return None
    k = min(large, key=lambda k: float(np.hypot(*(centroids[k] + corner - pixel))))
    y, x = np.nonzero(labels == k)
    disc = np.pi * radius**2
    length = (len(x) - disc) / (2 * radius)
    (minor, major), axes = np.linalg.eigh(np.cov(x, y))
    box, ends = 2 * radius * length, 4 * radius**3 * length / 3
    across = (disc * radius**2 / 4 + box * radius**2 / 3) / len(x)
    along = (disc * (radius**2 + length**2) / 4 + box * length**2 / 12 + ends) / len(x)
    if (
        not MIN_SMEAR_RADII < length / radius < MAX_SMEAR_RADII
        or max(abs(minor / across - 1), abs(major / along - 1)) > MAX_VARIANCE_MISMATCH
    ):
        return None
    proportionate = bool(abs(major / minor * across / along - 1) < MAX_RATIO_MISMATCH)
    return np.asarray(centroids[k] + corner), np.asarray(length * axes[:, 1]), proportionate


def candidates(view: View, centre: Array | None = None, radius: float = 0.0) -> list[Array]:
    """Possible centres of outlines (2,) [pixels], best first: anywhere, or within `radius` [pixels] of a pixel (2,)."""
    grid = view.grid
    rows, columns = grid.radius.shape
    cell, corner = grid.cell, grid.corner
    i0, i1, j0, j1 = 0, columns, 0, rows
    if centre is not None:
        low, high = (centre - corner - radius) / cell, (centre - corner + radius) / cell
        i0, j0 = (max(0, int(v)) for v in low)
        i1, j1 = min(columns, int(high[0]) + 2), min(rows, int(high[1]) + 2)
    if i1 - i0 < 3 or j1 - j0 < 3:
        return []
    x, y = corner
    window = view.picture[y + j0 * cell : y + j1 * cell, x + i0 * cell : x + i1 * cell]
    small = cv2.resize(window, (i1 - i0, j1 - j0), interpolation=cv2.INTER_AREA)
    difference = (small - grid.table[j0:j1, i0:i1] * view.gain.astype(np.float32)) * grid.ball_region[j0:j1, i0:i1]
    votes = circle_votes(difference, grid.radius[j0:j1, i0:i1], view.noise / cell)
    is_peak = (votes == cv2.dilate(votes, np.ones((5, 5), np.uint8))) & (votes > MIN_VOTE_FRACTION * grid.clean_votes)
    down, across = np.nonzero(is_peak & grid.centre_region[j0:j1, i0:i1])
    order = np.argsort(-votes[down, across], kind="stable")[:MAX_CANDIDATES]
    found = []
    for j, i in zip(down[order].tolist(), across[order].tolist(), strict=True):
        a, b = max(j - 1, 0), max(i - 1, 0)
        patch = votes[a : j + 2, b : i + 2]
        v, u = np.mgrid[: patch.shape[0], : patch.shape[1]]
        cell_xy = np.array([b + i0 + (patch * u).sum() / patch.sum(), a + j0 + (patch * v).sum() / patch.sum()])
        found.append(corner + cell * (cell_xy + 0.5) - 0.5)
    return found


def _kernel(radius: float) -> Image:
    """A disc of weight 1 less the ring around it."""
    outer = radius * (1 + RING_WIDTH_RADII)
    n = math.ceil(outer)
    y, x = np.mgrid[-n : n + 1, -n : n + 1]
    distance = np.hypot(x, y)
    disc = np.clip(radius - distance + 0.5, 0, 1)
    ring = np.clip(outer - distance + 0.5, 0, 1) - np.clip(radius - distance + 1.5, 0, 1)
    return np.asarray(disc / disc.sum() - np.maximum(ring, 0) / np.maximum(ring, 0).sum(), np.float32)


def peaks(view: View, colour: Array | None, centre: Array | None = None, within: float = math.inf) -> list[Array]:
    """Pixels (2,) where a disc of this colour may be, best first: anywhere, or `within` so many of a pixel (2,)."""
    x0, x1, y0, y1 = view.geometry.box
    if centre is not None:
        x0, y0 = (int(max(low, c - within)) for low, c in zip((x0, y0), centre, strict=True))
        x1, y1 = (int(min(high, c + within)) for high, c in zip((x1, y1), centre, strict=True))
    middle = np.array([x0 + x1, y0 + y1]) / 2
    cell = max(1, int(view.geometry.radius(middle) / CELLS_PER_RADIUS))
    size = columns, rows = (x1 - x0) // cell, (y1 - y0) // cell
    if min(size) < 2:
        return []
    part = slice(y0, y0 + rows * cell), slice(x0, x0 + columns * cell)
    small = cv2.resize(view.picture[part], size, interpolation=cv2.INTER_AREA).astype(np.float32)
    table = cv2.resize(view.table[part], size, interpolation=cv2.INTER_AREA) * view.gain.astype(np.float32)
    found = np.maximum(covered(small, table, colour), 0.0)
    kernel = _kernel(view.geometry.radius(middle) / cell)
    score = cv2.filter2D(found, cv2.CV_32F, kernel, borderType=cv2.BORDER_REPLICATE)
    is_peak = (score == cv2.dilate(score, np.ones((5, 5), np.uint8))) & (score > MIN_PEAK)
    down, across = np.nonzero(is_peak)
    order = np.argsort(-score[down, across], kind="stable")[: MAX_PEAKS["any" if colour is None else "one"]]
    corner = np.array([x0, y0])
    return [corner + cell * (np.array([across[k], down[k]]) + 0.5) - 0.5 for k in order]
