"""What is seen of a table where no camera over it could be found: in a picture, and in words.

In: a picture, the sizes of table and balls, and what was given. Out: `SeenTable`: the cloth, its straight sides and
where they meet, what lies on it as large as a ball, printed markers, and how oblique the view is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import write_whole
from models.messages import counted
from models.shot import RAIL_NAMES, Table
from sysid.vision.camera.pictures.calibration_picture import (
    BALL_COLOUR,
    GIVEN_COLOUR,
    Bgr,
    Picture,
    text_below,
    whole_canvas,
)
from sysid.vision.camera.printed.markers import MARKER_SIZE_M, Markers, find_markers
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table import lines as table_lines
from sysid.vision.camera.table.first_view import first_view, initial_camera
from sysid.vision.camera.table.lines import Side
from sysid.vision.camera.trust import oblique_notes

CLOTH_COLOUR: Bgr = (255, 255, 0)
SIDE_COLOUR: Bgr = (255, 0, 255)
CORNER_COLOUR: Bgr = (0, 255, 255)
BALL_AREAS = (0.4, 2.6)  # of what may be a ball, over that of one in the middle of the table
BALL_ASPECT = 1.5  # of its length to its width, at most


@dataclass(frozen=True)
class SeenTable:
    """What a picture shows of a table."""

    picture: Picture
    given: Array  # (n, 2) corners given by hand [pixels]
    cloth: NDArray[np.uint8] | None  # (height, width), 255 inside; None where no cloth is seen
    sides: tuple[Side, ...]
    cut: tuple[str, ...]  # borders of the picture beyond which the cloth goes on
    balls: Array  # (n, 3) middle and radius of what may be balls [pixels]
    markers: Markers
    camera: Camera | None  # a rough one, where four sides are seen

    @property
    def corners(self) -> Array:
        """Where sides beside each other meet: (n, 2) [pixels]."""
        pairs = zip(self.sides, (*self.sides[1:], *self.sides[:1]), strict=True) if len(self.sides) > 2 else ()
        return np.array([one.meets(other) for one, other in pairs if abs(_cross(one, other)) > 0.1]).reshape(-1, 2)

    def sides_in_view(self) -> list[str]:
        """The rails that are not beyond a border of the picture, if x points to its right, or up where it is high."""
        around = ("right", "top", "left", "bottom")
        wide = self.picture.shape[1] >= self.picture.shape[0]
        rails = dict(zip(around, ("+x", "+y", "-x", "-y") if wide else ("-y", "+x", "+y", "-x"), strict=True))
        beyond = {rails[border] for border in self.cut}
        return [rail for rail in RAIL_NAMES if rail not in beyond]

    def lines(self) -> list[str]:
        """The same in words."""
        text = [f"corners given (white): {_as_text(self.given)}"] if len(self.given) else []
        if len(self.markers):
            text.append(f"printed markers (yellow): {', '.join(map(str, self.markers.numbers.tolist()))}")
        if self.cloth is None:
            return [*text, "no cloth is seen: no area of one colour fills the middle of the picture"]
        share = 100 * float((self.cloth > 0).mean())
        text.append(f"cloth (cyan): {share:.0f} % of the picture; {len(self.sides)} straight sides (magenta)")
        if self.cut:
            text.append(f"the cloth extends beyond the {' and the '.join(self.cut)} of the picture")
        if len(corners := self.corners):
            text.append(f"the sides of the cloth meet (yellow) at {_as_text(corners)}: its outer edges, not the noses")
        text.append(f"{counted(len(self.balls), 'object')} of a ball's size on the cloth (red)")
        return text + (oblique_notes(self.camera) if self.camera is not None else [])

    def draw(self, path: Path, why: str) -> None:
        """Write the picture with all that was seen, and why that was not enough."""
        canvas = whole_canvas(self.picture)
        if self.cloth is not None:
            outlines, _ = cv2.findContours(self.cloth, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
            for outline in outlines:
                canvas.line(outline.reshape(-1, 2), CLOTH_COLOUR)
        for side in self.sides:
            canvas.line(_ends(side), SIDE_COLOUR)
        for corner in self.corners:
            canvas.circle(corner, 6.0 * canvas.width, CORNER_COLOUR)
        for corners in self.markers.pixels:
            canvas.line(np.concatenate([corners, corners[:1]]), CORNER_COLOUR)
        for u, v, radius in self.balls:
            canvas.circle(np.array([u, v]), radius * canvas.zoom, BALL_COLOUR)
        for point in self.given:
            canvas.cross(point, GIVEN_COLOUR)
        words = text_below([f"no camera: {why}", *self.lines()], canvas.pixels.shape[1])
        write_whole(path, cv2.imencode(".png", np.vstack([canvas.pixels, words]))[1].tobytes())


def seen_table(
    picture: Picture, table: Table, diameter: float, given: Array | None = None, marker_size: float = MARKER_SIZE_M
) -> SeenTable:
    """What a picture shows of a table.

    Args:
        picture: (height, width, 3), blue, green, red.
        table: nose to nose.
        diameter: of the balls [m].
        given: (4, 2) corners given by hand [pixels].
        marker_size: side of printed markers [m].
    """
    markers = find_markers(picture, table, marker_size)
    none = np.zeros((0, 2)) if given is None else np.asarray(given, float)
    try:
        cloth = table_lines.cloth(picture)
    except BadInput:
        return SeenTable(picture, none, None, (), (), np.zeros((0, 3)), markers, None)
    sides = tuple(table_lines.sides(cloth))
    camera = None
    try:  # with the focal length of a usual lens: sides alone hardly determine it
        start = initial_camera((picture.shape[1], picture.shape[0]), table, diameter, None, None)
        camera = first_view(start, list(sides), RAIL_NAMES, (), False).camera
    except BadInput:
        pass
    scale = float(np.sqrt((cloth > 0).sum() / (table.length * table.width)))  # [pixels/m], as if seen from above
    balls = _ball_sized(picture, cloth, camera, scale * diameter / 2)
    return SeenTable(picture, none, cloth, sides, tuple(table_lines.cut_off(cloth)), balls, markers, camera)


def _ball_sized(picture: Picture, cloth: NDArray[np.uint8], camera: Camera | None, radius: float) -> Array:
    """Middle and radius (n, 3) [pixels] of what lies on the cloth, has not its colour, and has about a ball's size.

    A ball has the radius that a rough camera gives it there; without one everywhere `radius` [pixels].
    """
    other = ((cloth > 0) & ~table_lines.cloth_coloured(picture)).astype(np.uint8)
    _, _, stats, middles = cv2.connectedComponentsWithStats(other)
    found = []
    for (_, _, wide, high, area), middle in zip(stats[1:].tolist(), middles[1:], strict=True):
        expected = radius if camera is None else float(camera.radius_px(camera.centres(middle[None]))[0])
        alike = BALL_AREAS[0] < area / (np.pi * expected**2) < BALL_AREAS[1]
        if alike and max(wide, high) < BALL_ASPECT * min(wide, high):
            found.append([*middle, expected])
    return np.array(found).reshape(-1, 3)


def _cross(one: Side, other: Side) -> float:
    """Sine of the angle between two sides."""
    return float(one.normal[0] * other.normal[1] - one.normal[1] * other.normal[0])


def _ends(side: Side) -> Array:
    """The line of a side, from its first point to its last: (2, 2) [pixels]."""
    way = np.array([-side.normal[1], side.normal[0]])
    along = side.points @ way
    return side.normal * side.offset + np.array([along.min(), along.max()])[:, None] * way


def _as_text(points: Array) -> str:
    return " ".join(f"{u:.0f},{v:.0f}" for u, v in points)
