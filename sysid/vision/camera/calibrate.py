"""A camera from a picture of the table itself: its four nose lines, three of them, or four corners given by hand.

A view from straight above does not tell the focal length: from twice as high, with twice the focal length, a plane
looks the same. Tracks need the plane of the balls' centres, 2/5 of a radius below that of the noses, so little depends
on it; how little is computed. A tilted view tells the focal length by the table's aspect, as well as its length and
width are known: so it is believed only when its standard deviation, these doubts included, is small.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import RAIL_NAMES, Table
from sysid.vision.camera import table_edges, table_lines
from sysid.vision.camera.board import Lens
from sysid.vision.camera.first_view import first_view, lens_only, sides_of
from sysid.vision.camera.pose import Fit, Rails, fit
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table_edges import Edge
from sysid.vision.camera.trust import (
    K1,
    REMEDY,
    corner_doubts,
    doubts,
    outline_doubts,
    parallax,
    uncertainty,
    with_focal,
)

TOLD = 0.2  # standard deviation of the focal length from which it is rather assumed [fraction]
REACHES = (5.0, 3.0, 2.0)  # within which edges are sought, round by round [pixels]
NEAR = 0.02  # of corners given by hand that edges are sought [m]
ALIKE = 6e-3  # spread of the cushions' widths up to which edges look like noses [m]
LEAST_POINTS = 8  # of a side
K2_GAIN = 0.8  # what k2 must do to the scatter to be believed
ONLY = "the end of the cloth, the only edge seen"
BY_HAND = "none: from the corners given alone"


@dataclass(frozen=True)
class Calibration:
    """A camera, and how far it is to be trusted."""

    camera: Camera
    lines: Fit
    focal_from: str  # "found", "assumed", "given" or "board"
    focal_sd: float  # [fraction]; NaN where it was not measured
    edge: str  # which edge of the cushions was taken
    spread: tuple[float, float]  # rms and worst standard deviation of places on the balls' plane [m]
    parallax: tuple[float, float]  # rms and worst error there if the focal length is 10 % off [m]
    notes: tuple[str, ...]
    doubts: tuple[str, ...]  # why not to trust it

    @property
    def fov(self) -> float:
        """Field of view across the longer side of the picture [degrees]."""
        return float(np.degrees(2 * np.arctan(max(self.camera.size) / 2 / self.camera.matrix[0, 0])))

    @property
    def tilt(self) -> float:
        """Of the camera's axis against the vertical [degrees]."""
        return float(np.degrees(np.arccos(np.clip(-self.camera.axes[2, 2], -1, 1))))

    @property
    def edges(self) -> bool:
        """Whether edges were seen; if not, all is from corners given by hand, and no uncertainty is known."""
        return self.edge != BY_HAND

    @property
    def rails(self) -> dict[str, float]:
        """Residual of each side seen [m]."""
        return {RAIL_NAMES[k]: self.lines.rms_of(k) for k in range(4) if (self.lines.rails == k).any()}


def calibrate(
    picture: NDArray[np.generic], table: Table, diameter: float, *, fov: float | None = None, lens: Lens | None = None,
    corners: Array | None = None, sees: Sequence[str] = RAIL_NAMES, source: str = "",
    progress: Callable[[str], None] = lambda line: None,
) -> Calibration:  # fmt: skip
    """Calibrate a camera from a picture of the table.

    Args:
        picture: (height, width, 3), blue, green, red, 0 to 255; best the median of several frames.
        table: nose to nose.
        diameter: of the balls [m].
        fov: field of view across the longer side of the picture, where it is known [degrees].
        lens: from a board, where there was one.
        corners: (4, 2) where the nose lines cross, in any order [pixels]; where three sides are seen a point of the
            first, the two corners, and a point of the last. The sides are found if not given.
        sees: rails that are in the picture.
        source: what the picture is, for the camera's file.
        progress: is told what is being done.

    Raises:
        BadInput: no table is found, or too few of its sides.
    """
    start = lens_only((picture.shape[1], picture.shape[0]), table, diameter, fov, lens)
    light = np.asarray(picture, np.float32)
    own: tuple[str, ...] = () if lens else ("k1",) if fov else ("k1", "focal")
    progress("looking for the table")
    by_hand = corners is not None
    if corners is not None:
        sides = sides_of(np.asarray(corners, float), len(sees))
    else:
        sides = table_lines.sides(table_lines.cloth(np.rint(light).astype(np.uint8)))
    first = first_view(start, sides, sees, own if not by_hand else own[:1], by_hand)
    progress("looking for the noses")
    noses, edge, said = _noses(light, first, "focal" not in own, by_hand)
    if len(noses) < 3:
        return _by_hand(first, _source_of(fov, lens), source)
    expected = {"focal": (0.0, 0.3), **K1}
    lines = first
    for k, reach in enumerate(REACHES):
        progress(f"edge points, round {k + 1} of {len(REACHES)}")
        camera = lines.camera
        pixels, rails = _points(light, camera, noses, reach)
        free = own if len(set(rails.tolist())) == 4 else tuple(n for n in own if n != "focal")
        expected["focal"] = (float(np.log(start.matrix[0, 0] / camera.matrix[0, 0])), 0.3)
        lines = fit(camera, pixels, rails, free, prior=expected)
        noses = {rail: dataclasses.replace(nose, offset=0.0) for rail, nose in noses.items()}
    progress("least squares")
    lines, focal_sd = _with_lens(lines, start, own)
    found = bool(np.isfinite(focal_sd))
    left = next((rail for rail in set(first.rails.tolist()) if rail not in lines.rails), None)
    notes = () if left is None else (f"no edge at {RAIL_NAMES[left]} goes with the others: that side is left out",)
    said = [*said, *doubts(lines, found, edge == ONLY)]
    if left is not None and not by_hand:
        said += outline_doubts(lines, first, left)
    count = len(set(lines.rails.tolist()))
    text = f"{count} cushion lines, {int(lines.kept.sum())} edge points, from {source}"
    text += "; not to be trusted" if said else ""
    return Calibration(
        dataclasses.replace(lines.camera, residual_m=lines.rms, source=text), lines,
        "found" if found else _source_of(fov, lens), lens.focal_sd if lens else focal_sd, edge,
        uncertainty(lines), parallax(lines), notes, tuple(said),
    )  # fmt: skip


def _by_hand(first: Fit, focal_from: str, source: str) -> Calibration:
    """The result where no edges are found beside corners given by hand."""
    camera = dataclasses.replace(first.camera, residual_m=first.rms, source=f"4 corners by hand, from {source}")
    pixel = 1e3 * camera.eye[2] / camera.matrix[0, 0]
    note = f"no edges beside the corners: places are as good as those are, a pixel being {pixel:.1f} mm"
    unknown, said = (np.nan, np.nan), tuple(corner_doubts(first))
    return Calibration(camera, first, focal_from, np.nan, BY_HAND, unknown, parallax(first), (note,), said)


def _source_of(fov: float | None, lens: Lens | None) -> str:
    """Where a focal length is from that is not found."""
    return "board" if lens else "given" if fov else "assumed"


def _with_lens(lines: Fit, start: Camera, own: tuple[str, ...]) -> tuple[Fit, float]:
    """The last fit, with as much of the lens as the lines tell; the focal length's uncertainty, NaN if not told."""
    pixels, rails, focal_sd = lines.pixels, lines.rails, np.nan
    free = tuple(name for name in own if name != "focal")
    if "focal" in own:
        if "focal" in lines.free:
            lines = fit(lines.camera, pixels, rails, own, prior={"focal": (0.0, 1.0), **K1})
            focal_sd = lines.wide["focal"]
        if focal_sd < TOLD:
            free = own
        else:
            focal_sd = np.nan
            lines = fit(with_focal(lines.camera, start.matrix[0, 0]), pixels, rails, free, prior=K1)
    if "k1" in own:
        more = fit(lines.camera, pixels, rails, (*free, "k2"), prior=K1)
        if more.noise < K2_GAIN * lines.noise and more.kept.sum() >= 0.98 * lines.kept.sum():
            return more, focal_sd
    return lines, focal_sd


def _noses(
    light: NDArray[np.float32], first: Fit, fixed: bool, by_hand: bool
) -> tuple[dict[int, Edge], str, list[str]]:
    """The noses by rail, which edges they are, and what speaks against them."""
    outline, found = first.margin, {}
    for rail in dict.fromkeys(first.rails.tolist()):
        low, high = outline - table_edges.INWARD, outline + table_edges.OUTWARD
        seen = table_edges.strip(light, first.camera, rail, low, high)
        found[rail] = table_edges.edges(seen) if seen is not None else []
    if by_hand:
        near = {rail: [e for e in some if abs(e.offset) < NEAR] for rail, some in found.items()}
        best = {r: max(e, key=lambda e: e.strength * np.exp(-abs(e.offset) / (NEAR / 2))) for r, e in near.items() if e}
        return best, "those nearest to the corners given", []
    tilt = np.arccos(np.clip(-first.camera.axes[2, 2], -1, 1))
    aspect_sd = 0.006 if fixed else float(np.hypot(0.006, 0.3 * tilt**2))  # a wrong focal length distorts it
    table = first.camera.table
    lengths = (table.length, table.width)
    chosen = table_edges.choose(found, outline, lengths, aspect_sd)
    if len(chosen) < 3:
        raise BadInput("the cushions' noses do not show against the bed; give --corners, or light the table evenly")
    inward = outline - float(np.mean([e.offset for e in chosen.values()]))
    if inward >= table_edges.LAST:
        return chosen, f"bed/cushion; the cloth goes on {1e3 * inward:.0f} mm behind it", []
    farther = {rail: [e for e in some if e.offset < outline - table_edges.LAST] for rail, some in found.items()}
    inner = [outline - e.offset for e in table_edges.choose(farther, outline, lengths, np.inf).values()]
    if len(inner) < 3 or np.ptp(inner) > ALIKE:
        return chosen, ONLY, []
    text = f"edges {1e3 * float(np.mean(inner)):.0f} mm farther in do not fit the table's aspect"
    return chosen, "the end of the cloth", [f"{text}, though they look like the noses: {REMEDY}"]


def _points(light: NDArray[np.float32], camera: Camera, noses: dict[int, Edge], reach: float) -> tuple[Array, Rails]:
    """Edge points (n, 2) along the rails, and whose they are (n,)."""
    pixels = {rail: table_edges.edge_points(light, camera, rail, edge, reach) for rail, edge in noses.items()}
    pixels = {rail: own for rail, own in pixels.items() if len(own) >= LEAST_POINTS}
    if len(pixels) < 3:
        raise BadInput("the cushions' edges are too faint to be followed; film with more light, or more frames")
    rails = np.repeat(np.array(list(pixels)), [len(own) for own in pixels.values()])
    return np.concatenate(list(pixels.values())), rails.astype(np.intp)
