"""Calibration of a camera from a picture of the table: nose lines, corners given by hand, printed markers.

In: a picture, the sizes of table and balls, and what is known of the camera. Out: `Calibration`, the camera with its
uncertainty. A view from straight above does not determine the focal length: from twice the height, with twice the focal
length, a plane looks the same. Tracks need the plane of the balls' centres, 2/5 of a radius below that of the noses, so
little depends on it; how little is computed. A tilted view determines the focal length by the aspect of the table, as
well as its length and width are known; it is accepted only if its standard deviation, including that of the table, is
small. Otherwise it is the most likely one given all that is seen (noses.py): outlines of balls away from the middle
determine it (ball_outlines.py); without such balls it is about that of a usual lens.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import RAIL_NAMES, Table
from sysid.vision.camera.final_lens import MAX_FITTED_FOCAL_SD, with_lens
from sysid.vision.camera.pose import CameraFit
from sysid.vision.camera.printed.marker_camera import MIN_MARKERS, marker_notes, marker_view
from sysid.vision.camera.printed.markers import Markers, find_markers
from sysid.vision.camera.projection import MIN_FOCAL_PX, Camera
from sysid.vision.camera.table.ball_outlines import NO_BALLS, BallOutlines
from sysid.vision.camera.table.cloth_end import cloth_ends
from sysid.vision.camera.table.diamonds import NO_DIAMONDS, Diamonds
from sysid.vision.camera.table.edge_blur import blur_notes
from sysid.vision.camera.table.evidence import CUSHION_WIDTHS_M, evidence, evidence_doubts
from sysid.vision.camera.table.first_view import initial_camera
from sysid.vision.camera.table.near_view import corners_compared
from sysid.vision.camera.table.noses import (
    CLOTH_EDGE_M,
    CushionReading,
    TableEvidence,
)
from sysid.vision.camera.table.reading import NO_HINTS, CameraHints, TablePicture, first_fit, from_corners, read_table
from sysid.vision.camera.table.side_points import fitted_to_edges, side_edges
from sysid.vision.camera.table.weighed_sides import weighed
from sysid.vision.camera.trust import (
    FOCAL_ERROR,
    TABLE_SIZE_REMEDY,
    assumed_focal_doubts,
    corner_doubts,
    doubts,
    oblique_notes,
    outline_doubts,
    parallax,
    tilt,
    uncertainty,
)

MAX_CUSHION_SPREAD_M = 8e-3  # of the widths of the cushions, up to which edges may be noses
ONLY_EDGE = "the end of the cloth, the only edge seen"
BY_HAND = "none: from the corners given alone"
BY_MARKERS = "none: from the markers alone"


@dataclass(frozen=True)
class Calibration:
    """A camera, its uncertainty, and doubts about it."""

    camera: Camera
    lines: CameraFit
    focal_from: str  # "found", "assumed", "given" or "board"
    focal_sd: float  # relative; NaN where it was not measured
    edge: str  # which edge of the cushions was used
    spread: tuple[float, float]  # rms and worst standard deviation of places on the balls' plane [m]
    parallax: tuple[float, float]  # rms and worst error there if the focal length is 10 % off [m]
    apart_sd: float  # relative, of a focal length that is not among the parameters of the lines; 0 where it is
    notes: tuple[str, ...]
    diamonds: Diamonds = NO_DIAMONDS
    balls: BallOutlines = NO_BALLS
    diamond_margin: float = np.nan  # of their rows outside the noses [m]
    markers: Markers | None = None  # seen

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust it."""
        return self.camera.doubts

    @property
    def fov(self) -> float:
        """Field of view across the longer side of the picture [degrees]."""
        return float(np.degrees(2 * np.arctan(max(self.camera.size) / 2 / self.camera.matrix[0, 0])))

    @property
    def tilt(self) -> float:
        """Of the camera's axis against the vertical [degrees]."""
        return tilt(self.camera)

    @property
    def edges(self) -> bool:
        """Whether edges were seen; otherwise all is from corners or markers, and no uncertainty is known."""
        return self.edge not in (BY_HAND, BY_MARKERS)

    @property
    def rails(self) -> dict[str, float]:
        """Residual of each side seen [m]."""
        return {RAIL_NAMES[k]: self.lines.rms_of(k) for k in range(4) if (self.lines.rails == k).any()}


def calibrate(
    picture: NDArray[np.generic], table: Table, diameter: float, hints: CameraHints = NO_HINTS, *,
    stills: Sequence[NDArray[np.uint8]] = (), source: str = "", progress: Callable[[str], None] = lambda line: None,
) -> Calibration:  # fmt: skip
    """Calibrate a camera from a picture of the table.

    Args:
        picture: (height, width, 3), blue, green, red, 0 to 255; best the median of several frames.
        table: nose to nose.
        diameter: of the balls [m].
        hints: what is known of the camera. Printed markers that agree with each other are the start, whatever else
            is given. Its corners are found if not given; where three sides are seen they are a
            point of the first, the two corners, and a point of the last. Corners are a start only, unless they hold:
            what is found without them, beyond doubt and near them, is preferred.
        stills: single frames in which balls rest, whose sizes are compared.
        source: what the picture is, for the camera file.
        progress: receives a line on what is being done.

    Raises:
        BadInput: no table is found, or too few of its sides.
    """
    light, unknown = np.asarray(picture, np.float32), hints.unknown
    start = initial_camera((picture.shape[1], picture.shape[0]), table, diameter, hints.fov, hints.lens)
    markers = find_markers(np.rint(light).astype(np.uint8), table, hints.marker_size)
    view = marker_view(start, markers, unknown) if len(markers) >= MIN_MARKERS else None
    if hints.corners is not None and not hints.hold and len(hints.sees) == 4 and view is None:
        alone = _unaided(picture, table, diameter, hints, stills, source, progress)
        if alone is not None:
            return alone
    progress("finding the table")
    held = np.asarray(hints.corners, float) if hints.hold and hints.corners is not None else np.zeros((0, 2))
    scene = TablePicture(light, stills, markers, view, view is None and hints.corners is not None, held)
    first = first_fit(scene, start, hints)
    progress("finding the noses of the cushions")
    first, seen, reading = read_table(scene, first, unknown, float(start.matrix[0, 0]))
    if reading is None:
        first = from_corners(start, hints) if scene.by_hand else first
        return _without_edges(first, scene, hints.focal_from, source)
    return _calibrated(scene, first, seen, reading, hints, source, progress)


def _calibrated(
    scene: TablePicture, first: CameraFit, seen: TableEvidence, reading: CushionReading, hints: CameraHints,
    source: str, progress: Callable[[str], None],
) -> Calibration:  # fmt: skip
    """The camera that fits the edges of a reading best, and what speaks for it and against it."""
    unknown = hints.unknown
    edge, warnings = _edge_taken(seen, reading, first) if not scene.near else (scene.near, [])
    sides = side_edges(reading, seen, first.camera, scene.agreeing)
    points = fitted_to_edges(scene.light, reading.camera, sides, unknown, progress)
    progress("least squares")
    lines, focal_sd = with_lens(points.lines, float(reading.camera.matrix[0, 0]), unknown, points.sure)
    lines = lines if scene.near else weighed(lines, points.ends, points.shifts)
    if not (lines.camera.matrix[0, 0] > MIN_FOCAL_PX and lines.camera.translation[2] > 0):
        raise BadInput("no camera sees such a table like this: check the table's length and width, or give --corners")
    by_sides = bool(np.isfinite(focal_sd))
    found = by_sides or reading.focal_sd < MAX_FITTED_FOCAL_SD
    focal_sd = focal_sd if by_sides or not found else reading.focal_sd
    notes, of_sides = _side_left_out(lines, first, reading, scene)
    warnings = [*warnings, *doubts(lines, by_sides, edge == ONLY_EDGE), *evidence_doubts(lines.camera, seen, reading)]
    notes, warnings = [*notes, *blur_notes(points.shifts)], [*warnings, *of_sides]
    said, against = marker_notes(lines.camera, scene.markers, scene.view, len(reading.noses))
    shifts, apart_sd = parallax(lines), _apart_sd(lines, reading, hints)
    if not found and hints.focal_from == "assumed" and not len(seen.diamonds.pixels) + len(seen.markers):
        warnings += assumed_focal_doubts(shifts[0], reading.focal_sd, uncertainty(lines)[0])
    if scene.by_hand and len(hints.sees) == 4:
        their_notes, their_doubts = corners_compared(lines.camera, np.asarray(hints.corners, float))
        notes, against = [*notes, *their_notes], [*against, *their_doubts]
    warnings += against
    text = f"{len(set(lines.rails.tolist()))} cushion lines, {int(lines.kept.sum())} edge points, from {source}"
    return Calibration(
        dataclasses.replace(lines.camera, residual_m=lines.rms, source=text, doubts=tuple(warnings)), lines,
        "found" if found else hints.focal_from, hints.lens.focal_sd if hints.lens else focal_sd, edge,
        uncertainty(lines), shifts, apart_sd,
        (*notes, *said, *evidence(lines.camera, seen, reading), *oblique_notes(lines.camera)),
        seen.diamonds, seen.balls, reading.diamond_margin, scene.markers,
    )  # fmt: skip


def _apart_sd(lines: CameraFit, reading: CushionReading, hints: CameraHints) -> float:
    """Of a focal length that is not among the parameters of the lines, relative; 0 where it is."""
    if "focal" in lines.free:
        return 0.0
    if hints.lens:
        return hints.lens.focal_sd
    return reading.focal_sd if np.isfinite(reading.focal_sd) else FOCAL_ERROR


def _side_left_out(
    lines: CameraFit, first: CameraFit, reading: CushionReading, scene: TablePicture
) -> tuple[list[str], list[str]]:
    """What is to be said of a side at which no nose was found, and what it makes doubtful."""
    fitted = {*lines.rails.tolist()}
    unseen = [rail for rail in dict.fromkeys(first.rails.tolist()) if rail not in reading.noses.keys() & fitted]
    what = "markers there are" if scene.view else "end of the cloth is"
    notes = [f"no nose is seen at {RAIL_NAMES[rail]}: the {what} used instead" for rail in unseen if rail in fitted]
    notes += [
        f"no edge at {RAIL_NAMES[rail]} agrees with the others: that side is left out"
        for rail in unseen if rail not in fitted
    ]  # fmt: skip
    dark = [rail for rail in unseen if cloth_ends(scene.light, lines.camera, rail, reading.cushion_width)]
    outline = [rail for rail in unseen if rail not in dark and not scene.view]
    return notes, [doubt for rail in outline for doubt in outline_doubts(lines, first, rail)]


def _unaided(
    picture: NDArray[np.generic], table: Table, diameter: float, hints: CameraHints,
    stills: Sequence[NDArray[np.uint8]], source: str, progress: Callable[[str], None],
) -> Calibration | None:  # fmt: skip
    """The calibration without the corners given, if it is beyond doubt and its corners are near those."""
    try:
        found = calibrate(
            picture, table, diameter, dataclasses.replace(hints, corners=None), stills=stills, source=source,
            progress=progress,
        )  # fmt: skip
    except BadInput:
        return None
    notes, against = corners_compared(found.camera, np.asarray(hints.corners, float))
    if found.doubts or against:
        return None
    return dataclasses.replace(found, notes=(*found.notes, *notes))


def _edge_taken(seen: TableEvidence, reading: CushionReading, first: CameraFit) -> tuple[str, list[str]]:
    """A description of the edges that are taken as noses, and doubts about them."""
    outline = first.margin
    inward = outline - float(np.mean([e.offset for e in reading.noses.values()]))
    if inward >= CLOTH_EDGE_M:
        width = reading.cushion_width if len(seen.cloth_rails) else inward
        return f"between bed and cushion; the cloth extends {1e3 * width:.0f} mm behind it", []
    farther = [
        [outline - e.offset for e in edges if e.offset < outline - CLOTH_EDGE_M] for edges in seen.edges.values()
    ]
    widths = [w for w in itertools.chain(*farther) if CUSHION_WIDTHS_M[0] < w < CUSHION_WIDTHS_M[1]]
    alike = [[w for w in widths if abs(w - middle) < MAX_CUSHION_SPREAD_M / 2] for middle in widths]
    inner = max(alike, key=len, default=[])
    if len(inner) < 3:
        return ONLY_EDGE, []
    text = f"edges {1e3 * float(np.mean(inner)):.0f} mm farther in do not fit the table's proportions"
    return "the end of the cloth", [f"{text}, though they look like the noses: {TABLE_SIZE_REMEDY}"]


def _without_edges(first: CameraFit, scene: TablePicture, focal_from: str, source: str) -> Calibration:
    """The result where no noses are found: never to be trusted, as nothing shows how good corners or markers are."""
    what = "4 corners by hand" if scene.by_hand else f"{len(scene.agreeing)} markers"
    camera = dataclasses.replace(first.camera, residual_m=first.rms, source=f"{what}, from {source}")
    pixel = 1e3 * camera.eye[2] / camera.matrix[0, 0]
    doubt = f"no edges confirm the {'corners' if scene.by_hand else 'markers'}: positions are only as accurate as these"
    doubt += f", and a pixel is {pixel:.1f} mm" * scene.by_hand + "; light the table so that the noses show"
    notes, against = marker_notes(camera, scene.markers, scene.view, 0)
    warnings = (*(corner_doubts(first) if scene.by_hand else ()), doubt, *against)
    edge, unknown = BY_HAND if scene.by_hand else BY_MARKERS, (np.nan, np.nan)
    return Calibration(
        dataclasses.replace(camera, doubts=warnings), first, focal_from, np.nan, edge, unknown, parallax(first),
        FOCAL_ERROR, (*notes, *oblique_notes(camera)),
        markers=scene.markers,
    )  # fmt: skip
