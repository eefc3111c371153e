"""The table in a picture before its calibration: a first camera, and the likeliest reading of the cushions from it.

In: a picture, and what is known of its camera. Out: `CameraFit`, `TableEvidence`, `CushionReading`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import RAIL_NAMES
from sysid.vision.camera.board import Lens
from sysid.vision.camera.pose import CameraFit
from sysid.vision.camera.printed.marker_camera import MarkerView
from sysid.vision.camera.printed.markers import MARKER_SIZE_M, Markers, no_markers
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table import edges as table_edges
from sysid.vision.camera.table import lines as table_lines
from sysid.vision.camera.table.ball_outlines import NO_BALLS, find_balls
from sysid.vision.camera.table.diamonds import NO_DIAMONDS, find_diamonds
from sysid.vision.camera.table.edges import Edge
from sysid.vision.camera.table.evidence import CUSHION_WIDTHS_M, MIN_LEAD, unsure
from sysid.vision.camera.table.first_view import CLOTH_MARGIN_M, first_view, sides_of
from sysid.vision.camera.table.near_view import CUSHION_REACH_M, MIN_REACH_M, cloth_sides, on_noses
from sysid.vision.camera.table.noses import (
    CLOTH_END_SEARCH_M,
    CushionReading,
    TableEvidence,
    read_noses,
    what_is_seen,
    with_rival,
)


@dataclass(frozen=True)
class CameraHints:
    """What is known of a camera before its calibration."""

    fov: float | None = None  # field of view across the longer side of the picture [degrees]
    lens: Lens | None = None  # from a board
    corners: Array | None = None  # (4, 2) intersections of the nose lines, in any order [pixels]; see `calibrate`
    hold: bool = False  # whether these corners hold: what is found must go with them
    sees: Sequence[str] = RAIL_NAMES  # rails in the picture
    marker_size: float = MARKER_SIZE_M  # side of printed markers [m]

    @property
    def unknown(self) -> tuple[str, ...]:
        """Intrinsic parameters to fit."""
        if self.lens:
            return ()
        return ("k1",) if self.fov else ("k1", "focal")

    @property
    def focal_from(self) -> str:
        """Origin of a focal length that was not fitted."""
        return "board" if self.lens else "given" if self.fov else "assumed"


NO_HINTS = CameraHints()


@dataclass(frozen=True)
class TablePicture:
    """What is looked at, and what is known of it before its edges are."""

    light: NDArray[np.float32]
    stills: Sequence[NDArray[np.uint8]]
    markers: Markers
    view: MarkerView | None  # from those markers that agree
    by_hand: bool  # whether corners given by hand are the start
    held: Array  # (4, 2) of these, where they hold [pixels]; (0, 2) else

    @property
    def near(self) -> str:
        """What the noses are looked for near to; nothing where the outline of the cloth is known."""
        return "those beside the markers" if self.view else ""

    @property
    def agreeing(self) -> Markers:
        """The markers that agree."""
        return self.markers.where(self.view.used) if self.view else no_markers(self.markers.table)


def first_fit(scene: TablePicture, start: Camera, hints: CameraHints) -> CameraFit:
    """An initial camera: from markers, from corners given by hand, or from the outline of the cloth."""
    if scene.view is not None:
        return on_noses(scene.view.camera, [RAIL_NAMES.index(name) for name in hints.sees])
    unknown = hints.unknown
    if hints.corners is not None:
        rough = from_corners(start, hints)
        if hints.hold:
            return dataclasses.replace(rough, margin=CLOTH_MARGIN_M)
        sides, seen = cloth_sides(scene.light, rough)
        return first_view(start, sides, hints.sees, unknown, False) if seen else rough
    picture = np.rint(scene.light).astype(np.uint8)
    region = table_lines.cloth(picture)
    sides = table_lines.sides(region)
    if len(sides) < len(hints.sees) and (cut := table_lines.cut_off(region)):
        text = f"the cloth extends beyond the {' and the '.join(cut)} of the picture: film all of it with its frame"
        raise BadInput(f"{text}, or give --corners, or --sees if only three sides are in view")
    first = first_view(start, sides, hints.sees, unknown, False)
    if table_lines.RIM_LOST_PX * float(first.camera.eye[2]) / first.camera.matrix[0, 0] > CLOTH_END_SEARCH_M:
        first = first_view(start, table_lines.at_edges(sides, picture), hints.sees, unknown, False)
    return first


def from_corners(start: Camera, hints: CameraHints) -> CameraFit:
    """A camera from the corners given alone."""
    sides = sides_of(np.asarray(hints.corners, float), len(hints.sees))
    free = hints.unknown[-1:] if hints.hold else hints.unknown[:1]  # four corners that hold determine the focal length
    return first_view(start, sides, hints.sees, free, True)


def read_table(
    scene: TablePicture, first: CameraFit, unknown: tuple[str, ...], focal: float
) -> tuple[CameraFit, TableEvidence, CushionReading | None]:
    """The first view, what is seen from it, and the likeliest reading.

    Where a side shows no nose, what is seen does not go together, or another reading is about as likely, the cloth may
    have seemed to end elsewhere, as a cushion in the dark has not its colour: what is seen from the camera of the
    reading, and from that of its rival, is then read again.
    """
    near = bool(scene.near)
    first, seen, reading = _look(scene, first, unknown, focal)
    if reading is not None and (near or len(reading.noses) < len(seen.edges) or unsure(seen, reading)):
        margin = 0.0 if near else reading.cushion_width
        if not near and not CUSHION_WIDTHS_M[0] < margin < CUSHION_WIDTHS_M[1]:  # drawn to what is no end of the cloth
            margin = CLOTH_MARGIN_M
        unclear = reading.lead < MIN_LEAD and not near
        cameras = [reading.camera, *([reading.rival] if unclear and reading.rival is not None else [])]
        looks = [_look(scene, dataclasses.replace(first, camera=one, margin=margin), unknown, focal) for one in cameras]
        first, seen, reading = looks[0]
        for other_first, other_seen, other in looks[1:]:
            if reading is None or (other is not None and other.total < reading.total):
                first, seen, reading, other = other_first, other_seen, other, reading
            reading = with_rival(reading, other)
    if reading is None and not (near or scene.by_hand):
        raise BadInput("the noses cannot be distinguished from the bed; give --corners, or light the table evenly")
    return first, seen, reading


def _look(
    scene: TablePicture, first: CameraFit, unknown: tuple[str, ...], focal: float
) -> tuple[CameraFit, TableEvidence, CushionReading | None]:
    """A first view, what is seen from it, and its likeliest reading."""
    seen = _seen(scene, first)
    return first, seen, read_noses(first.camera, seen, np.inf if scene.near else first.margin, unknown, focal)


def _seen(scene: TablePicture, first: CameraFit) -> TableEvidence:
    """What the picture, and single frames of it, show of the table."""
    if scene.near:
        low, high, margin, search = -MIN_REACH_M, CUSHION_REACH_M, CUSHION_REACH_M / 2, CUSHION_REACH_M / 4
    else:
        margin, search = first.margin, CLOTH_END_SEARCH_M
        low, high = margin - table_edges.INWARD_SEARCH_M, margin + table_edges.OUTWARD_SEARCH_M
    edges: dict[int, list[Edge]] = {}
    for rail in dict.fromkeys(first.rails.tolist()):
        farthest = table_edges.visible_extent(first.camera, rail, low, margin, high)
        strip = table_edges.strip(scene.light, first.camera, rail, low, farthest)
        edges[rail] = table_edges.edges(strip) if strip is not None else []
    # Cards lie over diamonds, and their cells look like some.
    diamonds = NO_DIAMONDS if scene.near else find_diamonds(scene.light, first.camera, margin)
    try:
        balls = find_balls([np.rint(scene.light).astype(np.uint8), *scene.stills], first.camera)
    except BadInput:  # the corners are known, but the cloth cannot be identified
        balls = NO_BALLS
    seen = what_is_seen(first.camera, edges, margin, diamonds, balls, scene.agreeing, search)
    return dataclasses.replace(seen, corners=scene.held)
