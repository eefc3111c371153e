"""An initial camera from the sides of the cloth: which rail each side is, and an approximate pose.

In: the sides of the cloth, or corners given by hand. Out: `CameraFit`. The outline of the cloth may be a cushion's
width outside the noses. With all four sides that margin is fitted, too: the aspect of the table determines it.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence

import cv2
import numpy as np

from models.errors import BadInput
from models.shot import NOSE_HEIGHT, RAIL_NAMES, Table
from sysid.vision.camera.board import Lens
from sysid.vision.camera.pose import CameraFit, fit_camera
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.lines import Side

ASSUMED_FOV_DEG = 60.0  # of an unknown camera, across the longer side of its picture
RAILS_AROUND = (0, 2, 1, 3)  # rails counter-clockwise, from +x
CLOTH_MARGIN_M = 0.04  # usual margin of the outline of the cloth outside the noses
TRIED_TILTS_RAD = ((0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4))  # where three sides are seen
MAX_SIDE_POINTS = 80  # used of a side


def initial_camera(
    size: tuple[int, int], table: Table, diameter: float, fov: float | None, lens: Lens | None
) -> Camera:
    """A camera without pose, whose lens is that of a board, of a field of view [degrees], or an assumed one."""
    if lens is not None:
        if lens.size != size:
            w, h = lens.size
            raise BadInput(f"the board was filmed at {w}x{h} pixels, the table at {size[0]}x{size[1]}: use one size")
        matrix, distortion = lens.matrix.copy(), lens.distortion.copy()
    else:
        focal = max(size) / 2 / np.tan(np.radians(fov or ASSUMED_FOV_DEG) / 2)
        matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
        distortion = np.zeros(5)
    return Camera(size, matrix, distortion, np.zeros(3), np.zeros(3), table, diameter)


def sides_of(corners: Array, count: int) -> list[Side]:
    """Four sides between corners (4, 2) in any order, or three sides along the points (4, 2) in order."""
    middle = corners.mean(axis=0)
    around = np.argsort(np.arctan2(-(corners - middle)[:, 1], (corners - middle)[:, 0]))
    ring = np.concatenate([corners[around], corners[around[:1]]]) if count == 4 else corners
    found = []
    for a, b in itertools.pairwise(ring):
        length = float(np.linalg.norm(b - a))
        normal = np.array([a[1] - b[1], b[0] - a[0]]) / max(length, 1e-9)
        out = float(normal @ (a - middle))
        if length < 10 or abs(out) < 5:
            raise BadInput(
                "--corners: two of them coincide, or three lie on a line; give the four crossings of the nose lines"
            )
        normal = normal * np.sign(out)
        found.append(Side(normal, float(normal @ a), a + np.linspace(0.02, 0.98, 40)[:, None] * (b - a)))
    return sorted(found, key=lambda side: side.bearing % (2 * np.pi))


def first_view(
    start: Camera, sides: list[Side], sees: Sequence[str], free: tuple[str, ...], by_hand: bool
) -> CameraFit:
    """Fit an initial camera.

    Args:
        start: with its lens.
        sides: of the cloth, or of the noses where they were given by hand.
        sees: rails in view, three or four.
        free: unknown intrinsic parameters: "k1", "focal".
        by_hand: whether the sides are those of the noses.
    """
    sides, assignments = _rail_assignments(sides, sees)
    if len(sides) == 3:  # focal length, margin and height are confounded
        free = tuple(name for name in free if name != "focal")
    elif not by_hand:
        free = (*free, "margin")
    prior = {"k1": (0.0, 1e-3 if by_hand else 0.2), "margin": (CLOTH_MARGIN_M, 0.04), "focal": (0.0, 0.3)}
    picked = [side.points[:: max(1, len(side.points) // MAX_SIDE_POINTS)] for side in sides]
    pixels = np.concatenate(picked)
    found = []
    for assignment in assignments:
        rails = np.repeat(np.asarray(assignment), [len(points) for points in picked])
        margin = 0.0 if by_hand else CLOTH_MARGIN_M
        tries = [
            fit_camera(camera, pixels, rails, free, margin=margin, prior=prior)
            for camera in _initial_poses(start, sides, assignment)
        ]
        lengths = [
            np.linalg.norm(np.ptp(points, axis=0)) for points, rail in zip(picked, assignment, strict=True) if rail >= 2
        ]
        found.append((min(tries, key=_misfit), float(np.mean(lengths))))
    found.sort(key=lambda pair: _misfit(pair[0]))
    if len(found) == 2 and _misfit(found[1][0]) < 2 * _misfit(found[0][0]):
        found.sort(key=lambda pair: -pair[1])  # if either pair may be the length, it is the longer one in the picture
    if found[0][0].camera.eye[2] <= 0:
        raise BadInput("the sides found do not form a table seen from above; give --corners")
    return found[0][0]


def _rail_assignments(sides: list[Side], sees: Sequence[str]) -> tuple[list[Side], list[tuple[int, ...]]]:
    """The sides used, and the rails that they may be."""
    if len(sees) == 3:
        if len(sides) < 3:
            raise BadInput(f"only {len(sides)} of the three sides found; mark points along them with --corners")
        sides = sorted(
            sorted(sides, key=lambda side: len(side.points))[-3:], key=lambda side: side.bearing % (2 * np.pi)
        )
        bearings = [side.bearing for side in sides]
        gaps = np.diff([*bearings, bearings[0]]) % (2 * np.pi)
        first = (int(np.argmax(gaps)) + 1) % 3  # after the side that is missing
        missing = next(k for k, rail in enumerate(RAILS_AROUND) if RAIL_NAMES[rail] not in sees)
        return sides[first:] + sides[:first], [tuple(RAILS_AROUND[(missing + 1 + k) % 4] for k in range(3))]
    if len(sides) < 4:
        text = f"only {len(sides)} of four straight sides of the cloth found; give --corners"
        raise BadInput(text + ", or --sees if only three are in view")
    assignments = []
    for shift in range(4):
        rails = tuple(RAILS_AROUND[(k + shift) % 4] for k in range(4))
        u, v = sides[rails.index(0)].normal
        if (u > 0) if abs(u) >= abs(v) else (v < 0):  # +x points right, or up
            assignments.append(rails)
    return sides, assignments


def _misfit(one: CameraFit) -> float:
    """Mean distance of all points from their lines [m]."""
    return float(np.mean(np.minimum(np.abs(one.away), 1.0)))


def _initial_poses(start: Camera, sides: list[Side], rails: tuple[int, ...]) -> list[Camera]:
    """Initial poses: one from four corners, or several from two."""
    half = np.array([start.table.length, start.table.width]) / 2
    corners, pixels = [], []
    for k in range(4 if len(sides) == 4 else 2):
        pair = (k, (k + 1) % len(sides))
        corner = np.array([0.0, 0.0, NOSE_HEIGHT * start.radius])
        for rail in (rails[side] for side in pair):
            corner[rail // 2] = half[rail // 2] * (1 - 2 * (rail % 2))
        corners.append(corner)
        pixels.append(sides[pair[0]].meets(sides[pair[1]]))
    objects, seen = np.array(corners), np.array(pixels)
    if len(sides) == 4:
        _, turn, shift = cv2.solvePnP(objects, seen, start.matrix, start.distortion)
        return [dataclasses.replace(start, rotation=turn.ravel(), translation=shift.ravel())]
    # Two corners fix a view from straight above; tilted ones keep the point midway between the corners.
    flat = (seen - start.matrix[:2, 2]) / start.matrix[0, 0] * [1, -1]
    (u, v), (x, y) = flat[1] - flat[0], objects[1, :2] - objects[0, :2]
    height = float(np.hypot(x, y) / np.hypot(u, v))
    turned = np.arctan2(v, u) - np.arctan2(y, x)
    c, s = np.cos(turned), np.sin(turned)
    above = np.array([[c, -s, 0.0], [-s, -c, 0.0], [0.0, 0.0, -1.0]])
    middle = np.append(flat.mean(axis=0) * [1, -1], 1.0) * height
    found = []
    for tilt in TRIED_TILTS_RAD:
        axes = cv2.Rodrigues(np.array([*tilt, 0.0]))[0] @ above
        shift = middle - axes @ objects.mean(axis=0)
        found.append(dataclasses.replace(start, rotation=cv2.Rodrigues(axes)[0].ravel(), translation=shift))
    return found
