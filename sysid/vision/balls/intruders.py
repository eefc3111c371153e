"""What comes in over a cushion: an arm, a hand or a cue, pieces of which look like balls.

In: a picture beside the background. Out: the pixels of the bed that show it.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.cover import not_table
from sysid.vision.balls.view_geometry import Array, Mask

RING_PLACES = 48  # places about a ball that rests all the time,
AROUND_RADII = 1.6  # so far from its centre,
BESIDE_RADII = 1.3  # and so far from those of other balls, to be none of theirs,
MAX_AROUND = 0.3  # of which show what comes in over a cushion: more, and it is a part of that
MIN_SHOWN = 0.5  # of what is not the table, from which on a pixel shows it


def intruding(view: View) -> Mask:
    """Pixels (h, w) of the bed, to a cell of the coarse grid, that show what comes in over a cushion."""
    grid, bed = view.grid, view.geometry.bed
    rows, columns = grid.radius.shape
    x, y = grid.corner
    part = slice(y, y + rows * grid.cell), slice(x, x + columns * grid.cell)
    small = cv2.resize(view.picture[part], (columns, rows), interpolation=cv2.INTER_AREA).astype(np.float32)
    on_bed = cv2.resize(bed[part].astype(np.uint8), (columns, rows), interpolation=cv2.INTER_NEAREST)
    seen = (not_table(small, grid.table * view.gain.astype(np.float32)) > MIN_SHOWN) & (on_bed > 0)
    _, labels = cv2.connectedComponents(seen.astype(np.uint8))
    edge = seen & (cv2.erode(on_bed, np.ones((3, 3), np.uint8)) == 0)
    found = np.zeros(bed.shape, bool)
    found[part] = np.kron(np.isin(labels, np.unique(labels[edge])) & seen, np.ones((grid.cell, grid.cell), bool))
    return found & bed


def shows(mask: Mask, pixels: Array) -> Mask:
    """Which of some pixels (n, 2) are in a mask (h, w), or beside the picture the nearest of it: (n,)."""
    column, row = (np.rint(pixels[:, k]).astype(int).clip(0, mask.shape[1 - k] - 1) for k in (0, 1))
    return np.asarray(mask[row, column])


def is_part(intruders: Mask, view: View, xy: Array, others: Sequence[Array] = ()) -> bool:
    """Whether what seems a ball at a pixel (2,) goes on beyond its rim, and not as other balls beside it."""
    radius = view.geometry.radius(xy)
    angles = np.arange(RING_PLACES) * 2 * np.pi / RING_PLACES
    ring = xy + AROUND_RADII * radius * np.column_stack([np.cos(angles), np.sin(angles)])
    beside = np.array([np.hypot(*(ring - other).T) < BESIDE_RADII * radius for other in others], bool)
    covered = shows(intruders, ring) & ~beside.reshape(len(others), RING_PLACES).any(axis=0)
    return bool(covered.mean() > MAX_AROUND)
