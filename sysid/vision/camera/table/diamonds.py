"""The diamonds on the rails of a table, which say how long and wide it is without regard to its noses.

In: a picture and a rough camera. Out: `Diamonds`. They lie at eighths of the length, nose to nose, and at quarters of
the width (World Pool-Billiard Association, equipment specifications, 8), each row at the same distance from its nose
and at the height of the rail's top, a little over the noses. A row counts where nearly all of its diamonds are seen,
as round as each other, all brighter or all darker than the rail, and another row lies as far from its own nose: some
three spots on wood are evenly spaced by chance.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter, maximum_filter

from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edges import Image, nose_points

DIAMOND_SIZE_M = 0.005  # standard deviation of the blob that a diamond is
DIAMOND_SEARCH_M = (0.012, 0.13)  # from the end of the cloth, outwards
DIAMOND_SHIFT_M = 0.05  # of a row along its rail, in a rough camera
DIAMOND_SCALES = np.linspace(0.92, 1.08, 33)  # of its spacing
DIAMOND_ACROSS_M = 0.006  # about the line of a row
DIAMOND_ALONG_M = 0.010  # about the expected place
DIAMOND_SIGNIFICANCE = 6.0  # of a blob [robust standard deviations of the rail]
MAX_BLOBS = 40  # of a rail, the clearest
MAX_BLOB_LENGTH = 2.5  # over its width: a ripple along an edge is longer
BLOB_REACH_SD = 1.0  # of its surroundings that must be in view, in standard deviations of the wider filter
MAX_ROW_STEP_M = 0.015  # between the distances of two rows from their noses, in a rough camera
MAX_UNLIKE = 3.0  # of the blobs of a row, over the middle one or under it
MAX_MISSING_DIAMONDS = 1  # of a long rail; of a short one none


@dataclass(frozen=True)
class Diamonds:
    """The diamonds seen."""

    pixels: Array  # (n, 2)
    rails: NDArray[np.intp]  # (n,) the rail each lies on
    along: Array  # (n,) coordinate along it [m]


NO_DIAMONDS = Diamonds(np.zeros((0, 2)), np.zeros(0, np.intp), np.zeros(0))


def find_diamonds(picture: Image, camera: Camera, margin: float) -> Diamonds:
    """The diamonds on the rails.

    Args:
        picture: (height, width, 3).
        camera: a rough one.
        margin: of the end of the cloth outside its noses [m].
    """
    rows = {rail: row for rail in range(4) if (row := _row(picture, camera, rail, margin)) is not None}
    agreed = [
        rail for rail, (_, _, out) in rows.items()
        if any(abs(out - rows[other][2]) < MAX_ROW_STEP_M for other in rows.keys() - {rail})
    ]  # fmt: skip
    if not agreed:
        return NO_DIAMONDS
    pixels, along = (np.concatenate([rows[rail][k] for rail in agreed]) for k in (0, 1))
    return Diamonds(pixels, np.repeat(np.array(agreed, np.intp), [len(rows[rail][1]) for rail in agreed]), along)


def _expected(camera: Camera, rail: int) -> Array:
    """Coordinates of the diamonds along a rail [m]."""
    if rail >= 2:
        eighths = np.array([-3, -2, -1, 1, 2, 3]) if camera.table.pockets else np.arange(-3, 4)
        return eighths * camera.table.length / 8
    return np.arange(-1, 2) * camera.table.width / 4


def _row(picture: Image, camera: Camera, rail: int, margin: float) -> tuple[Array, Array, float] | None:
    """Pixels (n, 2), coordinates (n,) and distance from the nose [m] of the diamonds of a rail, if any."""
    expected = _expected(camera, rail)
    places, strength = _blobs(picture, camera, rail, margin)
    if len(places) < len(expected) - 1:
        return None
    allowed = MAX_MISSING_DIAMONDS if len(expected) > 3 else 0
    best: tuple[float, Array, Array] | None = None
    for across, like in zip(places[:, 1], strength, strict=True):
        alike = (strength / like > 1 / MAX_UNLIKE) & (strength / like < MAX_UNLIKE)
        near = (np.abs(places[:, 1] - across) < DIAMOND_ACROSS_M) & alike
        row, weight = places[near, 0], np.abs(strength[near])
        for shift in np.arange(-DIAMOND_SHIFT_M, DIAMOND_SHIFT_M + 1e-9, DIAMOND_ALONG_M / 2):
            away = np.abs(row[:, None, None] - (DIAMOND_SCALES[:, None] * expected + shift))  # (blobs, scales, k)
            hit = away.min(axis=0) < DIAMOND_ALONG_M
            nearest = away.argmin(axis=0)
            scores = (hit * np.minimum(weight[nearest], 3 * np.median(weight))).sum(axis=1)
            scores = np.where(hit.sum(axis=1) >= len(expected) - allowed, scores, 0) - away.min(axis=0).sum(axis=1)
            k = int(np.argmax(scores))
            if scores[k] > 0 and (best is None or scores[k] > best[0]):
                chosen = np.flatnonzero(near)[nearest[k][hit[k]]]
                best = float(scores[k]), places[chosen], expected[hit[k]]
    if best is None:
        return None
    _, found, along = best
    pixels = camera.project(nose_points(camera, rail, found[:, 0], found[:, 1]))
    return pixels, along, float(np.median(found[:, 1]))


def _blobs(picture: Image, camera: Camera, rail: int, margin: float) -> tuple[Array, Array]:
    """Small round blobs on a rail: places (n, 2) along it and out of its nose [m], strengths (n,), negative if dark."""
    half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
    middle = camera.project(nose_points(camera, rail, np.array([-0.01, 0.01]), np.zeros(2)))
    step = 0.02 / max(float(np.linalg.norm(middle[1] - middle[0])), 1.0) / 2  # half a pixel
    along = np.arange(-half, half, step)
    across = np.arange(margin + DIAMOND_SEARCH_M[0], margin + DIAMOND_SEARCH_M[1], step)
    if len(along) * len(across) > 4e6:
        return np.zeros((0, 2)), np.zeros(0)
    a, u = (v.ravel() for v in np.meshgrid(along, across, indexing="ij"))
    pixels = camera.project(nose_points(camera, rail, a, u)).astype(np.float32)
    shape = (len(along), len(across))
    seen_here = ((pixels > 1) & (pixels < np.array(camera.size) - 2)).all(axis=1).reshape(shape)
    grey = picture.mean(axis=2)
    at = pixels[:, 0].reshape(shape), pixels[:, 1].reshape(shape)
    seen = cv2.remap(grey, *at, cv2.INTER_LINEAR, None, cv2.BORDER_REPLICATE)
    sd = max(DIAMOND_SIZE_M / step, 1.5)
    # Where the picture ends within the filter's support, its end looks like a blob.
    inside = binary_erosion(seen_here, iterations=int(np.ceil(BLOB_REACH_SD * 2 * sd)), border_value=1)
    blob = gaussian_filter(seen, sd) - gaussian_filter(seen, 2 * sd)
    size = np.abs(blob) * inside
    peak = (size == maximum_filter(size, int(4 * sd) | 1)) & inside & _round(blob)
    peak[[0, -1]], peak[:, [0, -1]] = False, False
    noise = 1.4826 * float(np.median(size[inside])) if inside.any() else np.inf
    rows, columns = np.nonzero(peak & (size > max(DIAMOND_SIGNIFICANCE * noise, 1.0)))
    order = np.argsort(-size[rows, columns])[:MAX_BLOBS]
    rows, columns = rows[order], columns[order]
    return np.column_stack([along[rows], across[columns]]), blob[rows, columns]


def _round(light: Array) -> NDArray[np.bool_]:
    """Where the light (n, m) curves about alike in all directions: at a blob it does, along an edge not."""
    rows, columns = np.gradient(light)
    (xx, xy), (_, yy) = np.gradient(rows), np.gradient(columns)
    turned = xx * yy - xy**2  # product of the two curvatures; the ratio of their sum's square to it is (r + 1)^2 / r
    ratio = MAX_BLOB_LENGTH**2  # curvature goes with the inverse square of the length
    return np.asarray((turned > 0) & ((xx + yy) ** 2 * ratio < (ratio + 1) ** 2 * turned))
