"""A calibration in one picture: the model of the table drawn over the frame, its corners magnified, its figures below.

Nose lines, edge points by their residual, the holes of the pockets, diamonds, the baulk line and a grid on the plane of
the balls. A camera is right where the noses run along the noses, in the middle of a side as at its ends.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.files import write_whole
from models.shot import NOSE_HEIGHT
from models.table.snooker import BAULK_LINE_M, D_RADIUS_M, FULL_LENGTH, is_snooker
from sysid.vision.camera.calibrate import Calibration
from sysid.vision.camera.pictures.calibration_report import rows
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edges import nose_points
from sysid.vision.camera.table.noses import RAIL_RISE_M

Picture = NDArray[np.uint8]
Bgr = tuple[int, int, int]
NOSE_COLOUR: Bgr = (255, 0, 255)
POCKET_COLOUR: Bgr = (0, 165, 255)
DIAMOND_COLOUR: Bgr = (0, 255, 255)
BAULK_COLOUR: Bgr = (255, 255, 255)
GRID_COLOUR: Bgr = (225, 225, 225)
BALL_COLOUR: Bgr = (0, 0, 255)
GIVEN_COLOUR: Bgr = (255, 255, 255)
GRID_SPACING_M = 0.25  # of the lines drawn on the plane of the balls
MAX_LINE_CHARS = 140  # of text below a picture: what its width holds
MIN_PICTURE_WIDTH_PX = 1000  # below which the text is not legible
DETAIL_PX = 72  # side of what is magnified, in a picture 1280 wide
FRACTION_BITS = 4  # of positions in OpenCV's drawing functions


@dataclass(frozen=True)
class Canvas:
    """A part of the picture, magnified, to draw upon in pixels of the whole."""

    pixels: Picture
    corner: tuple[float, float] = (0.0, 0.0)  # of the part in the whole picture
    zoom: float = 1.0
    width: int = 1  # of lines

    def at(self, points: Array) -> NDArray[np.int32]:
        """Places (n, 2) of the whole picture in this one, as OpenCV draws them."""
        own = (np.asarray(points) + 0.5 - self.corner) * self.zoom - 0.5
        return np.rint(np.clip(own, -1e5, 1e5) * 2**FRACTION_BITS).astype(np.int32)

    def line(self, points: Array, colour: Bgr) -> None:
        """A line through points (n, 2)."""
        cv2.polylines(self.pixels, [self.at(points)], False, colour, self.width, cv2.LINE_AA, FRACTION_BITS)

    def cross(self, point: Array, colour: Bgr) -> None:
        """A cross at a point (2,)."""
        arm = 8.0 * self.width / self.zoom
        for way in np.array([[arm, arm], [arm, -arm]]):
            self.line(np.stack([point - way, point + way]), colour)

    def circle(self, centre: Array, radius: float, colour: Bgr, filled: bool = False) -> None:
        """A circle, its radius in pixels of this picture."""
        width, place = cv2.FILLED if filled else self.width, self.at(centre[None])[0].tolist()
        cv2.circle(self.pixels, place, round(radius * 2**FRACTION_BITS), colour, width, cv2.LINE_AA, FRACTION_BITS)


def draw(path: Path, picture: Picture, found: Calibration, given: Array | None = None) -> None:
    """Write the picture (height, width, 3) with the model over it, its details and its figures.

    Corners given by hand (4, 2) [pixels] are crosses.
    """
    whole = whole_canvas(picture)
    _grid(whole, found.camera)
    _model(whole, found)
    for point in given if given is not None else ():
        whole.cross(point, GIVEN_COLOUR)
    parts = [_detail(picture, found, place, whole.pixels.shape[1] // 4) for place in _details(found.camera)]
    details = [np.hstack(parts[k : k + 4]) for k in range(0, len(parts), 4)]
    wide = whole.pixels.shape[1]
    details = [cv2.copyMakeBorder(d, 0, 0, 0, wide - d.shape[1], cv2.BORDER_CONSTANT) for d in details]
    lines = [f"{name}: {text}" for name, text in rows(found)]
    words = text_below([*lines, *found.notes, *(f"NOT to be trusted: {doubt}" for doubt in found.doubts)], wide)
    write_whole(path, cv2.imencode(".png", np.vstack([whole.pixels, *details, words]))[1].tobytes())


def whole_canvas(picture: Picture) -> Canvas:
    """All of a picture to draw upon, magnified where it is small."""
    zoom = max(1, -(-MIN_PICTURE_WIDTH_PX // picture.shape[1]))
    pixels = np.array(cv2.resize(picture, None, fx=zoom, fy=zoom, interpolation=cv2.INTER_NEAREST))
    return Canvas(pixels, zoom=zoom, width=max(1, round(zoom * picture.shape[1] / 1000)))


def _projected(camera: Camera, points: Array) -> Array:
    """Pixels (m, 2) of those points (n, 3) [m] in view: far outside it, the distortion folds them back."""
    back = camera.on_plane(camera.project(points), float(points[0, 2]))
    return camera.project(points[np.abs(back - points[:, :2]).max(axis=1) < 1e-3])


def _grid(canvas: Canvas, camera: Camera) -> None:
    """Lines on the plane of the balls."""
    half = np.array([camera.table.length, camera.table.width]) / 2
    for axis in (0, 1):
        count = int(half[axis] / GRID_SPACING_M)
        for k in range(-count, count + 1):
            line = np.full((60, 3), camera.radius)
            line[:, axis], line[:, 1 - axis] = k * GRID_SPACING_M, np.linspace(-1, 1, 60) * half[1 - axis]
            canvas.line(_projected(camera, line), GRID_COLOUR)


def _model(canvas: Canvas, found: Calibration) -> None:
    """The table as the camera has it, and what was seen of it."""
    camera = found.camera
    half = np.array([camera.table.length, camera.table.width]) / 2
    unit = max(camera.residual_m, 1e-6)
    for pixel, away, kept in zip(found.lines.pixels, found.lines.away, found.lines.kept, strict=True):
        outlying = min(abs(away) / (3 * unit), 1.0)
        colour = (0, int(255 * (1 - outlying)), int(255 * outlying)) if kept else (160, 160, 160)
        canvas.circle(pixel, canvas.width + 1, colour, filled=True)
    for rail in range(4):
        along = np.linspace(-1, 1, 200) * half[1 - rail // 2]
        canvas.line(_projected(camera, nose_points(camera, rail, along, np.zeros(200))), NOSE_COLOUR)
    for ring in _pockets(camera):
        canvas.line(_projected(camera, ring), POCKET_COLOUR)
    for line in _baulk(camera):
        canvas.line(_projected(camera, line), BAULK_COLOUR)
    radius = 5.0 * canvas.width
    for pixel in _places_of_diamonds(found):
        canvas.circle(pixel, radius, DIAMOND_COLOUR)
        arm = np.array([[radius / canvas.zoom, 0.0], [0.0, radius / canvas.zoom]])
        for way in arm:
            canvas.line(np.stack([pixel - way, pixel + way]), DIAMOND_COLOUR)
    for pixel, size in zip(found.balls.pixels, found.balls.radius, strict=True):
        canvas.circle(pixel, size * canvas.zoom, BALL_COLOUR)


def _places_of_diamonds(found: Calibration) -> Array:
    """Where the camera expects the diamonds that were seen: (n, 2) [pixels]."""
    points = np.zeros((len(found.diamonds.pixels), 3))
    for k, (rail, along) in enumerate(zip(found.diamonds.rails.tolist(), found.diamonds.along, strict=True)):
        points[k] = nose_points(found.camera, rail, np.array([along]), np.array([found.diamond_margin]))[0]
    return found.camera.project(points + np.array([0.0, 0.0, RAIL_RISE_M[0]]))


def _pockets(camera: Camera) -> list[Array]:
    """Rims of the pockets in the slate, as wide as their mouths: (n, 3) [m] each."""
    if not camera.table.pockets:
        return []
    half, shapes = np.array([camera.table.length, camera.table.width]) / 2, camera.table.shapes
    angle = np.linspace(0, 2 * np.pi, 60)
    rings = []
    for sx in (-1, 0, 1):
        for sy in (-1, 1):
            shape = shapes.corner if sx else shapes.middle
            way = np.array([sx, sy]) / np.hypot(sx, sy)
            inward = shape.mouth / 2 if sx else 0.0  # of the middle of the mouth from where the nose lines meet
            middle = np.array([sx, sy]) * half + way * (shape.shelf + shape.edge_radius - inward)
            xy = middle + shape.edge_radius * np.column_stack([np.cos(angle), np.sin(angle)])
            rings.append(np.column_stack([xy, np.zeros(len(xy))]))
    return rings


def _baulk(camera: Camera) -> list[Array]:
    """The baulk line and the D of a snooker table, at its left end: (n, 3) [m] each; none on another table."""
    if not is_snooker(camera.table, camera.radius):
        return []
    length, width = camera.table.length, camera.table.width
    x, angle = (BAULK_LINE_M / FULL_LENGTH - 0.5) * length, np.linspace(np.pi / 2, 3 * np.pi / 2, 60)
    across = np.column_stack([np.full(60, x), np.linspace(-width / 2, width / 2, 60), np.zeros(60)])
    ring = D_RADIUS_M / FULL_LENGTH * length * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(60)])
    return [across, ring + np.array([x, 0.0, 0.0])]


def _details(camera: Camera) -> Array:
    """What is magnified: the corners of the noses, and a place on each of them: (8, 2) [pixels]."""
    half, nose = np.array([camera.table.length, camera.table.width]) / 2, NOSE_HEIGHT * camera.radius
    signs = [(-1, 1), (-0.4, 1), (0.4, 1), (1, 1), (-1, -1), (-1, 0.3), (1, 0.3), (1, -1)]
    return camera.project(np.array([[x * half[0], y * half[1], nose] for x, y in signs]))


def _detail(picture: Picture, found: Calibration, place: Array, width: int) -> Picture:
    """A magnified part of the picture around a place, with the model over it."""
    high, wide = picture.shape[:2]
    side = max(16, min(round(DETAIL_PX * wide / 1280), wide, high))
    x, y = (int(np.clip(v - side / 2, 0, size - side)) for v, size in zip(place, (wide, high), strict=True))
    zoom = width / side
    part = cv2.resize(picture[y : y + side, x : x + side], (width, width), interpolation=cv2.INTER_NEAREST)
    _model(Canvas(part, (x, y), zoom), found)
    cv2.rectangle(part, (0, 0), (width - 1, width - 1), (0, 0, 0), 1)
    return np.asarray(part)


def text_below(lines: Sequence[str], wide: int) -> Picture:
    """Lines of text on black, long ones continued below."""
    scale = wide / 1600
    lines = [part for line in lines for part in textwrap.wrap(line, MAX_LINE_CHARS, subsequent_indent="    ")]
    out = np.zeros((int((14 + 24 * len(lines)) * scale), wide, 3), np.uint8)
    for k, line in enumerate(lines):
        place = (int(12 * scale), int((26 + 24 * k) * scale))
        cv2.putText(out, line, place, cv2.FONT_HERSHEY_SIMPLEX, 0.6 * scale, (255, 255, 255), 1, cv2.LINE_AA)
    return out
