"""Printed markers on the cushions: where each lies, and where a picture shows them.

Six square markers (ArUco, 4x4 cells; Garrido-Jurado et al. 2014, doi:10.1016/j.patcog.2014.01.005) lie on cards whose
front edge is flush with the nose. So the side of a marker next to the bed is at the height of the noses, a known margin
outside of them; its middle is opposite to a place that a tape or a diamond gives. A nose can be felt to a millimetre,
a place along it is known to some, and where a card rises towards the rail counts for nothing.

    numbers, seen from above, +x to the right:      2       1
                                                3               0
                                                    4       5
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import Table
from sysid.vision.camera.projection import Array

MARKER_RAILS: tuple[int, ...] = (0, 2, 2, 1, 3, 3)  # of each marker, places in models.shot.RAIL_NAMES
MARKER_LENGTHS: tuple[float, ...] = (0.0, 0.25, -0.25, 0.0, -0.25, 0.25)  # along its rail [lengths of the table]
MARKER_SIZE_M = 0.1  # side of the black square, as printed
MARGIN_SIZES = 0.15  # white about it [sides of the marker]
MAX_WIDTH_PX = 2000  # of a picture that is searched; smaller ones are magnified up to it
MAX_MAGNIFICATION = 3.0  # at most: cells of two pixels are read
REFINED_PX = 3  # half the window in which a corner is refined [pixels]
FRONT_CORNERS = (
    3,
    2,
)  # corners of a marker next to the bed, in the order that OpenCV gives: left and right, seen from there


@dataclass(frozen=True)
class Markers:
    """Markers seen."""

    numbers: NDArray[np.intp]  # (n,)
    pixels: Array  # (n, 4, 2) corners, clockwise as printed, from the upper left one
    table: Table
    size: float = MARKER_SIZE_M  # side of the black square [m]

    @property
    def rails(self) -> NDArray[np.intp]:
        """The rail that each belongs to: (n,)."""
        return np.array(MARKER_RAILS, np.intp)[self.numbers]

    @property
    def along(self) -> Array:
        """Where its middle belongs along its rail: (n,) [m]."""
        return np.array(MARKER_LENGTHS)[self.numbers] * self.table.length

    @property
    def margin(self) -> float:
        """From the nose to the side of a marker next to it [m]."""
        return MARGIN_SIZES * self.size

    @property
    def front(self) -> Array:
        """The corners next to the bed: (n, 2, 2) [pixels]."""
        return self.pixels[:, FRONT_CORNERS]

    def where(self, chosen: NDArray[np.bool_]) -> Markers:
        """Some of them."""
        return replace(self, numbers=self.numbers[chosen], pixels=self.pixels[chosen])

    def __len__(self) -> int:
        """How many."""
        return len(self.numbers)


def no_markers(table: Table) -> Markers:
    """None seen."""
    return Markers(np.zeros(0, np.intp), np.zeros((0, 4, 2)), table)


def dictionary() -> cv2.aruco.Dictionary:
    """The patterns that are printed and looked for."""
    return cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)


def find_markers(picture: NDArray[np.uint8], table: Table, size: float = MARKER_SIZE_M) -> Markers:
    """The markers in a picture.

    Args:
        picture: (height, width, 3).
        table: on which they lie.
        size: side of the black square [m].
    """
    grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    zoom = float(np.clip(MAX_WIDTH_PX / grey.shape[1], 1.0, MAX_MAGNIFICATION))
    large = cv2.resize(grey, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_CUBIC) if zoom > 1 else grey
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_NONE
    settings.minMarkerPerimeterRate = 0.02
    settings.adaptiveThreshWinSizeMax = 43
    settings.errorCorrectionRate = 0.3
    corners, numbers, _ = cv2.aruco.ArucoDetector(dictionary(), settings).detectMarkers(large)
    if numbers is None:
        return no_markers(table)
    names = np.asarray(numbers, np.intp).ravel()
    places = [(np.asarray(c, float).reshape(4, 2) + 0.5) / zoom - 0.5 for c in corners]
    # Of two that carry one number none is known to be it.
    good = [
        k for k in np.argsort(names, kind="stable") if names[k] < len(MARKER_RAILS) and (names == names[k]).sum() == 1
    ]
    refined = [_refined(grey, places[k]) for k in good]
    return Markers(names[good].astype(np.intp), np.array(refined).reshape(-1, 4, 2), table, size)


def _refined(grey: NDArray[np.uint8], corners: Array) -> Array:
    """Corners (4, 2) to a fraction of a pixel: where lines fitted to the four sides meet."""
    light = cv2.GaussianBlur(grey, (0, 0), 0.7).astype(np.float32)
    lines = []
    for k in range(4):
        a, b = corners[k], corners[(k + 1) % 4]
        way = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
        out = np.array([way[1], -way[0]])  # clockwise corners, v downwards
        places = a + np.linspace(0.12, 0.88, 25)[:, None] * (b - a)
        across = np.arange(-REFINED_PX, REFINED_PX + 1e-9, 0.25)
        points = (places[:, None] + across[:, None] * out).astype(np.float32)
        seen = cv2.remap(light, points[..., 0], points[..., 1], cv2.INTER_LINEAR).astype(float)
        slope = np.clip(np.gradient(seen, axis=1), 0, None)  # white is outside
        weight = slope**2
        edge = (weight * across).sum(axis=1) / np.maximum(weight.sum(axis=1), 1e-9)
        near = np.abs(edge - np.median(edge)) < 1.0
        u = np.linspace(-1, 1, len(edge))
        slope_of, offset = np.polyfit(u[near], edge[near], 1) if near.sum() > 5 else (0.0, 0.0)
        ends = [a + 0.12 * (b - a) + out * (offset - slope_of), a + 0.88 * (b - a) + out * (offset + slope_of)]
        lines.append(np.cross([*ends[0], 1.0], [*ends[1], 1.0]))
    meets = [np.cross(lines[k - 1], lines[k]) for k in range(4)]
    found = np.array([m[:2] / m[2] if abs(m[2]) > 1e-9 else corners[k] for k, m in enumerate(meets)])
    return found if np.abs(found - corners).max() < REFINED_PX else corners
