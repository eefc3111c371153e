"""An initial camera near the truth: from corners given by hand, or from markers.

Corners ten pixels off leave each side of the table tilted and shifted. Edges along a side are averaged over its length,
which a tilt would smear: so each side is first turned to where the edges along it are sharpest, whichever they are. The
outermost clear one is the end of the cloth. What follows is the same as where the cloth is found by its colour.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from scipy.ndimage import gaussian_filter1d

from sysid.vision.camera.pose import CameraFit, fit_camera
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edges import Image, edges, nose_crossings, nose_points, strip
from sysid.vision.camera.table.first_view import CLOTH_MARGIN_M
from sysid.vision.camera.table.lines import Side

CORNER_REACH_PX = 12.0  # of corners given by hand, from the edges beside them
CORNER_REACH_WIDTHS = 0.03  # and from the corners that were found in the end [widths of the picture]
MIN_REACH_M = 0.03  # and at least of places on the table: a shadow beside a nose must be seen to be known
CUSHION_REACH_M = 0.08  # from a nose, in which the cloth of the cushions ends
CLEAR_EDGE = 0.4  # of the strongest edge of a side
TILT_COUNT = 49  # tried of a side
TILT_BLOCKS = 60  # of a side
LINE_POINTS = 40  # of a side


def cloth_sides(light: Image, first: CameraFit) -> tuple[list[Side], bool]:
    """Where the cloth ends at each side, beside rough corners, and whether edges are seen at three of them at least.

    Args:
        light: the picture, (height, width, 3).
        first: a camera from the corners.
    """
    camera = first.camera
    far = max(MIN_REACH_M, CORNER_REACH_PX * float(camera.eye[2]) / camera.matrix[0, 0])
    middle = camera.project(np.zeros((1, 3)))[0]
    sides, seen = [], 0
    for rail in dict.fromkeys(first.rails.tolist()):
        half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
        along = np.linspace(-0.98, 0.98, LINE_POINTS) * half
        slope = _tilt(light, camera, rail, far)
        turned = strip(light, camera, rail, -far, far + CUSHION_REACH_M, slope=slope)
        found = edges(turned) if turned is not None else []
        clear = [e for e in found if e.strength > CLEAR_EDGE * max(one.strength for one in found)]
        seen += bool(clear)
        offset = max((e.offset for e in clear), default=CLOTH_MARGIN_M)
        sides.append(_side(camera.project(nose_points(camera, rail, along, offset + slope * along)), middle))
    return sorted(sides, key=lambda side: side.bearing % (2 * np.pi)), seen >= min(3, len(sides))


def _side(points: Array, middle: Array) -> Side:
    """The side along points (n, 2), of a table whose middle is seen at (2,) [pixels]."""
    way = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    normal = np.array([way[1], -way[0]])
    centre = points.mean(axis=0)
    normal = normal * np.sign(normal @ (centre - middle))
    return Side(normal, float(normal @ centre), points)


def _tilt(light: Image, camera: Camera, rail: int, far: float) -> float:
    """Slope against a rail [m/m] at which the edges beside it are sharpest; 0 where it is not in view."""
    seen = strip(light, camera, rail, -2 * far, 2 * far)
    if seen is None:
        return 0.0
    step = float(seen.across[1] - seen.across[0])
    blocks = np.array_split(np.arange(len(seen.along)), min(TILT_BLOCKS, len(seen.along)))
    # The roots of steps count, so that many blocks with an edge outweigh one with a ball.
    rows = gaussian_filter1d(np.stack([seen.colours[k].mean(axis=0) for k in blocks]), 1.0, axis=1, order=1)
    rows = np.sign(rows) * np.sqrt(np.abs(rows))
    places = np.array([seen.along[k].mean() for k in blocks])
    most = 2 * far / float(np.abs(seen.along).max())
    core = np.abs(seen.across) < far
    sharpness = []
    slopes = np.linspace(-most, most, TILT_COUNT)
    for slope in slopes:
        shifts = np.rint(slope * places / step).astype(int)
        mean = np.mean([np.roll(row, -shift, axis=0) for row, shift in zip(rows, shifts, strict=True)], axis=0)
        sharpness.append(float(np.sum(mean[core] ** 2)))
    return float(slopes[int(np.argmax(sharpness))])


def on_noses(camera: Camera, rails: Sequence[int]) -> CameraFit:
    """A camera as a fit to points on its own noses."""
    pixels = []
    for rail in rails:
        half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
        along = np.linspace(-0.98, 0.98, LINE_POINTS) * half
        pixels.append(camera.project(nose_points(camera, rail, along, np.zeros(LINE_POINTS))))
    names = np.repeat(np.array(rails, np.intp), LINE_POINTS)
    fit = fit_camera(camera, np.concatenate(pixels), names, max_evaluations=1)
    return dataclasses.replace(fit, camera=camera)


def corners_compared(camera: Camera, given: Array) -> tuple[list[str], list[str]]:
    """How far corners given by hand (4, 2) are from those of a camera: a note, or a doubt where that is too far."""
    away = np.linalg.norm(nose_crossings(camera)[:, None] - given, axis=2).min(axis=1)
    if away.max() > CORNER_REACH_WIDTHS * camera.size[0]:
        return [], [f"a corner given lies {float(away.max()):.0f} pixels from the one found: give them anew"]
    return [f"the corners given lie {float(away.mean()):.1f} pixels from those found"], []
