"""The apparent shift of an edge by another one beside it that the picture does not resolve.

In: a picture, a camera, and an edge along a rail. Out: the shift of the place where the colour changes fastest, from
the step itself. A nose behind the narrow shadow of its cushion is such an edge: the two steps, one down and one up, are
nearer to each other than a picture of few pixels shows, and push each other apart. Blurring the picture more pushes
them farther; so the shift is what is extrapolated to no blur at all from two blurs, of which the finer is that of a
sharp lens.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.ndimage import gaussian_filter1d

from models.shot import RAIL_NAMES
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edges import ACROSS_STEP_PX, SIDE_PARTS, Edge, Image, strip

BLURS_PX = (1.0, 0.5)  # standard deviations: of that by which edge points are found, and a finer one
LENS_FACTOR = 2.0  # of the shift from the finer to the wider one: pictures are as blurred as lie between them
MAX_SHIFT_PX = 2.0
REACH_PX = 8.0
PART_BLOCKS = 4  # of a part of a side, whose median counts
MIN_PARTS = 3
MIN_NOTED_M = 1e-3  # of a shift
SURE_SD = 3.0  # of a shift that is more than chance


def blur_shift(picture: Image, camera: Camera, rail: int, edge: Edge) -> float:
    """How far outwards an edge seems shifted by blur, as far as that is significant [m].

    Args:
        picture: (height, width, 3).
        camera: in which the edge is straight.
        rail: along which it runs.
        edge: with its offset from the nose of the camera.
    """
    rough = strip(picture, camera, rail, edge.offset - 1e-3, edge.offset + 1e-3)
    if rough is None:
        return 0.0
    margin = REACH_PX * rough.pixel
    seen = strip(picture, camera, rail, edge.offset - margin, edge.offset + margin, ACROSS_STEP_PX)
    if seen is None:
        return 0.0
    across = (seen.across - edge.offset) / seen.pixel
    blocks = np.stack([part.mean(axis=0) for part in np.array_split(seen.colours, SIDE_PARTS * PART_BLOCKS)])
    slope = gaussian_filter1d(np.median(blocks, axis=0), BLURS_PX[0] / ACROSS_STEP_PX, axis=0, order=1)
    size = np.linalg.norm(slope, axis=1) * (np.abs(across) < 1.0)
    colour = slope[int(np.argmax(size))] / max(float(size.max()), 1e-9)
    parts = [np.median(part, axis=0) for part in np.array_split(blocks @ colour, SIDE_PARTS)]
    steps = []
    for level in parts:
        wide = _steepest(level, across, BLURS_PX[0], 0.0)
        fine = _steepest(level, across, BLURS_PX[1], wide)
        steps.append(wide - fine)
    found = np.array(steps)[np.isfinite(steps)]
    if len(found) < MIN_PARTS:
        return 0.0
    mean, sd = float(found.mean()), float(found.std(ddof=1) / np.sqrt(len(found)))
    significant = mean * max(0.0, 1 - (SURE_SD * sd / mean) ** 2) if mean else 0.0
    return LENS_FACTOR * significant * seen.pixel


def blur_notes(shifts: Mapping[int, float]) -> list[str]:
    """Notes on noses that blur shifts, by rail [m]."""
    far = max(shifts, key=lambda rail: abs(shifts[rail]), default=0)
    if abs(shifts.get(far, 0.0)) < MIN_NOTED_M:
        return []
    text = f"a narrow shadow beside the nose at {RAIL_NAMES[far]} shifts its edge by {1e3 * shifts[far]:+.1f} mm"
    return [f"{text}, which is corrected: at a higher resolution the two would be distinct"]


def _steepest(level: Array, across: Array, blur: float, near: float) -> float:
    """Where a level (n,) rises fastest, nearest to a place, all across the edge [pixels]; NaN if nowhere."""
    slope = gaussian_filter1d(level, blur / ACROSS_STEP_PX, order=1)
    before, here, after = slope[:-2], slope[1:-1], slope[2:]
    peaks = np.flatnonzero((here >= before) & (here > after) & (here > 0) & (np.abs(across[1:-1]) < MAX_SHIFT_PX))
    if not len(peaks) or not np.isfinite(near):
        return np.nan
    k = peaks[np.argmin(np.abs(across[1:-1][peaks] - near))]
    curvature = before[k] - 2 * here[k] + after[k]
    return float(across[1 + k] + 0.5 * (before[k] - after[k]) / min(curvature, -1e-12) * ACROSS_STEP_PX)
