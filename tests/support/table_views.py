"""Pictures of a table whose camera is known, and how far off a camera that was found is."""

from __future__ import annotations

import cv2
import numpy as np

from models.commands.console import Progress
from models.shot import Table
from sysid.cli.clips.calibrate import calibrate as cli_calibrate
from sysid.vision.camera.calibrate import Calibration, calibrate
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.reading import CameraHints
from tests.footage.film import Look, Picture, developed, table_picture

DIAMETER = 0.0525
LOOK = Look(noise=5.0, uneven=0.3)


def over_table(
    tilt: tuple[float, float] = (0.03, -0.04), *, size: tuple[int, int] = (640, 400), span: float = 2.6,
    height: float = 2.6, aim: tuple[float, float] = (0.0, 0.0), turn: float = 0.0, k1: float = -0.1,
    pockets: bool = True,
) -> Camera:  # fmt: skip
    """A camera over a table of 2 x 1 m, tilted about its own axes [rad], with a lens that bends lines."""
    focal = max(size) * height / span
    matrix = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    axes = np.diag([1.0, -1.0, -1.0])
    for way in ((0.0, 0.0, turn), (0.0, tilt[0], 0.0), (-tilt[1], 0.0, 0.0)):
        axes = cv2.Rodrigues(np.array(way))[0] @ axes
    distortion = np.array([k1, 0.2 * k1**2, 0.0, 0.0, 0.0])
    shift = np.array([*aim, height])
    return Camera(size, matrix, distortion, cv2.Rodrigues(axes)[0].ravel(), shift, Table(2.0, 1.0, pockets), DIAMETER)


def fov(camera: Camera) -> float:
    return float(np.degrees(2 * np.arctan(max(camera.size) / 2 / camera.matrix[0, 0])))


def taken(camera: Camera, look: Look = LOOK, seed: int = 0) -> Picture:
    return developed(table_picture(camera, look), look, np.random.default_rng(seed))


def errors(truth: Camera, found: Calibration) -> Array:
    """How far balls seen by the true camera are placed wrongly [mm], all over the table that it sees."""
    half = np.array([truth.table.length, truth.table.width]) / 2 - truth.radius
    xy = np.stack(np.meshgrid(np.linspace(-1, 1, 11), np.linspace(-1, 1, 7)), axis=-1).reshape(-1, 2) * half
    pixels = truth.outline(xy)
    seen = ((pixels > 0) & (pixels < np.array(truth.size) - 1)).all(axis=1)
    return 1e3 * np.linalg.norm(found.camera.centres(pixels[seen]) - xy[seen], axis=1)


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def calibrated(camera: Camera, picture: Picture, **options: object) -> Calibration:
    return calibrate(picture, camera.table, camera.diameter, CameraHints(**options))  # type: ignore[arg-type]


TILTS = [(0.0, 0.4), (0.4, 0.0), (-0.4, 0.1), (0.1, -0.4), (0.3, 0.3), (-0.3, -0.3)]


def run(*arguments: str) -> int:
    return int(cli_calibrate.main(arguments, standalone_mode=False, obj=Progress()))


def over_bed(camera: Camera, found: Camera) -> float:
    """Error of places over the table: rms [mm]."""
    half = np.array([camera.table.length, camera.table.width]) / 2 - camera.radius
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 11), np.linspace(-1, 1, 7)), axis=-1).reshape(-1, 2) * half
    return rms(1e3 * np.linalg.norm(found.centres(camera.outline(grid)) - grid, axis=1))
