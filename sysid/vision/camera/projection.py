"""The calibrated camera over the table: table coordinates to pixels and back, and the camera's file.

Pinhole with the distortion of Brown and Conrady as OpenCV has it. Table frame as in models/shot.py, z = 0 on the cloth;
pixel (0, 0) is the centre of the first pixel. Positions of balls are those on the plane of their centres, z = R: seen
at 45 degrees, the point of the cloth behind a centre is a radius away from the ball.
"""

from __future__ import annotations

import base64
import binascii
import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tomli_w
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import read_toml, write_whole
from models.files.decode import Allowed
from models.shot import Ball, Table

Array = NDArray[np.float64]
FILE_FORMAT = "billiard-camera/1"
DOUBTED_SOURCE = "not to be trusted"  # in the `source` of files without `trusted`
UNKNOWN_DOUBT = "its file does not say why"
MIN_FOCAL_PX = 10.0  # focal length of a camera
SIDE_PROFILES = (40, 43)  # places at the sides and samples across the noses of `Camera.sides`
OUTLINE_POINTS = 24  # of a ball
CENTRE_ROUNDS = 3  # of the fixed-point iteration from the centre of an outline to that of the ball


@dataclass(frozen=True)
class Camera:
    """A calibrated camera: intrinsic parameters, pose, and the table and balls that it was calibrated with."""

    size: tuple[int, int]  # width, height [pixels]
    matrix: Array  # (3, 3) focal lengths and principal point [pixels]
    distortion: Array  # (5,) k1, k2, p1, p2, k3
    rotation: Array  # (3,) Rodrigues vector that takes table axes to camera axes [rad]
    translation: Array  # (3,) of the table's centre in the camera's frame [m]
    table: Table
    diameter: float  # of the balls [m]
    residual_m: float = math.nan  # rms of the calibration, on the table [m]
    readout: float = math.nan  # time from the first row to the last of a rolling shutter [s]; NaN where it is unknown
    place_sd_m: float = math.nan  # of balls' places over the table, as its calibration estimates, rms [m]
    source: str = ""  # what it was calibrated from
    sides: NDArray[np.uint8] | None = None  # SIDE_PROFILES, brightness across the noses, see camera_motion.py
    doubts: tuple[str, ...] = ()  # why it is not to be trusted; none where it is

    @property
    def trusted(self) -> bool:
        """Whether its calibration left no doubt."""
        return not self.doubts

    @property
    def radius(self) -> float:
        """Radius of a ball [m]."""
        return self.diameter / 2

    @property
    def axes(self) -> Array:
        """Rotation from table to camera axes: (3, 3)."""
        return np.asarray(cv2.Rodrigues(np.asarray(self.rotation, float))[0])

    @property
    def eye(self) -> Array:
        """Position of the camera: (3,) [m], table frame."""
        return np.asarray(-self.axes.T @ self.translation)

    @property
    def pixel(self) -> float:
        """Size of a pixel at the balls, in the middle of the table [m]."""
        return self.radius / float(self.radius_px(np.zeros((1, 2)))[0])

    def row_delay(self, rows: Array | float) -> Array:
        """When rows of a picture are exposed after its middle row (n,) [s]; 0 where the readout is unknown."""
        readout = self.readout if math.isfinite(self.readout) else 0.0
        return np.asarray(readout * (np.asarray(rows) / max(self.size[1] - 1, 1) - 0.5))

    def project(self, points: Array) -> Array:
        """Pixels (n, 2) of points (n, 3) [m]."""
        points = np.asarray(points, float).reshape(-1, 3)
        if len(points) == 0:
            return np.zeros((0, 2))
        pixels, _ = cv2.projectPoints(points, self.rotation, self.translation, self.matrix, self.distortion)
        return np.asarray(pixels, float).reshape(-1, 2)

    def rays(self, pixels: Array) -> Array:
        """Unit vectors (n, 3), table frame, along the lines of sight of pixels (n, 2)."""
        pixels = np.asarray(pixels, float).reshape(-1, 1, 2)
        if len(pixels) == 0:
            return np.zeros((0, 3))
        stop = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 60, 1e-10)
        flat = cv2.undistortPoints(pixels, self.matrix, self.distortion, criteria=stop).reshape(-1, 2)
        rays = np.column_stack([flat, np.ones(len(flat))]) @ self.axes
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def on_plane(self, pixels: Array, height: float) -> Array:
        """Where lines of sight of pixels (n, 2) meet the plane z = height [m]: (n, 2) [m]; NaN where they do not."""
        return meet_plane(self.eye, self.rays(pixels), height)

    def outline(self, xy: Array) -> Array:
        """Centres of the outlines of balls at (n, 2) [m], as a circle fit sees them: (n, 2) [pixels].

        A sphere's outline is an ellipse whose centre lies farther out than the image of the sphere's centre.
        """
        rim = self.rims(xy)
        return np.asarray(rim.mean(axis=1))

    def rims(self, xy: Array) -> Array:
        """Points on the outlines of balls at (n, 2) [m]: (n, OUTLINE_POINTS, 2) [pixels]."""
        centres = np.column_stack([np.asarray(xy, float).reshape(-1, 2), np.full(len(xy), self.radius)])
        line_of_sight = centres - self.eye
        away = np.linalg.norm(line_of_sight, axis=1, keepdims=True)
        along = line_of_sight / away
        # The cone of sight touches the sphere in a circle, R^2 / d before its centre.
        middle = centres - along * self.radius**2 / away
        spread = self.radius * np.sqrt(1.0 - (self.radius / away) ** 2)
        across = np.cross(along, [1.0, 0.0, 0.0])
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        up = np.cross(along, across)
        angle = np.linspace(0, 2 * np.pi, OUTLINE_POINTS, endpoint=False)
        ring = across[:, None] * np.cos(angle)[:, None] + up[:, None] * np.sin(angle)[:, None]
        points = middle[:, None] + spread[:, None] * ring
        return self.project(points.reshape(-1, 3)).reshape(len(centres), OUTLINE_POINTS, 2)

    def centres(self, pixels: Array) -> Array:
        """Positions of balls whose outlines are centred at pixels (n, 2): (n, 2) [m]."""
        pixels = np.asarray(pixels, float).reshape(-1, 2)
        straight = self.on_plane(pixels, self.radius)
        found = straight
        for _ in range(CENTRE_ROUNDS):
            found = found + straight - self.on_plane(self.outline(found), self.radius)
        return np.asarray(found)

    def radius_px(self, xy: Array) -> Array:
        """Mean radius of the outlines of balls at (n, 2) [m]: (n,) [pixels]."""
        rim = self.rims(xy)
        return np.asarray(np.linalg.norm(rim - rim.mean(axis=1, keepdims=True), axis=2).mean(axis=1))


def meet_plane(eye: Array, rays: Array, height: float) -> Array:
    """Where rays (n, 3) from an eye (3,) [m] meet the plane z = height [m]: (n, 2) [m]; NaN where they do not."""
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = (height - eye[2]) / rays[:, 2]
    distance = np.where(distance > 0, distance, np.nan)
    return np.asarray(eye[:2] + distance[:, None] * rays[:, :2])


def write_camera(path: Path | str, camera: Camera) -> None:
    """Write a camera file, whole or not at all."""
    known: dict[str, Any] = {
        "format": FILE_FORMAT,
        "size": list(camera.size),
        "matrix": np.asarray(camera.matrix, float).tolist(),
        "distortion": np.asarray(camera.distortion, float).tolist(),
        "rotation": np.asarray(camera.rotation, float).tolist(),
        "translation": np.asarray(camera.translation, float).tolist(),
        "source": camera.source,
        "trusted": camera.trusted,
        "doubts": list(camera.doubts),
        "table": dataclasses.asdict(camera.table),
        "ball": {"diameter": camera.diameter},
    }
    for key in ("residual_m", "readout", "place_sd_m"):
        if math.isfinite(value := getattr(camera, key)):
            known[key] = float(value)
    if camera.sides is not None:
        known["sides"] = base64.b64encode(camera.sides.tobytes()).decode()
    scalars = {k: v for k, v in known.items() if not isinstance(v, dict)}
    sections = {k: v for k, v in known.items() if isinstance(v, dict)}
    write_whole(path, tomli_w.dumps(scalars | sections).encode())


@dataclass(frozen=True)
class BallSize:
    """The keys of a camera file's [ball]."""

    diameter: Annotated[float, Allowed(0.02, 0.1, "m")]


def _read_sides(value: Any) -> NDArray[np.uint8]:
    """Profiles of the sides from their text; BadInput where it holds none."""
    try:
        held = np.frombuffer(base64.b64decode(value, validate=True), np.uint8)
        return held.reshape(SIDE_PROFILES)
    except (TypeError, ValueError, binascii.Error):
        count = SIDE_PROFILES[0] * SIDE_PROFILES[1]
        raise BadInput(f"sides is not {count} bytes in base64: remove it, or calibrate the camera again") from None


@dataclass(frozen=True)
class CameraFile:
    """The keys of a camera file, as `Camera` has them."""

    size: Annotated[tuple[int, int], Allowed(1, 1e5, "pixels", shape=(2,))]
    matrix: Annotated[Array, Allowed(-1e6, 1e6, shape=(3, 3))]
    distortion: Annotated[Array, Allowed(-100.0, 100.0, shape=(5,))]
    rotation: Annotated[Array, Allowed(-10.0, 10.0, "rad", shape=(3,))]
    translation: Annotated[Array, Allowed(-100.0, 100.0, "m", shape=(3,))]
    table: Table
    ball: BallSize
    residual_m: Annotated[float, Allowed(nan=True)] = math.nan
    readout: Annotated[float, Allowed(0.0, 1.0, "s")] = math.nan
    place_sd_m: Annotated[float, Allowed(0.0, 1.0, "m")] = math.nan
    source: str = ""
    sides: Annotated[NDArray[np.uint8] | None, Allowed(reader=_read_sides)] = None
    trusted: bool | None = None  # None in files of versions that wrote it into the source
    doubts: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """BadInput for no matrix of a camera, one that does not look at the table, or one both trusted and doubted."""
        if self.trusted and self.doubts:
            raise BadInput("trusted = true contradicts doubts: remove one of the two")
        (fx, _, _), (below, fy, _), last = self.matrix.tolist()
        if min(fx, fy) < MIN_FOCAL_PX or below != 0 or last != [0.0, 0.0, 1.0]:
            raise BadInput("matrix is none of a camera: write [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] in pixels")
        if not self.translation[2] > 0:
            raise BadInput(
                "translation has the table's centre behind the camera: make a camera file with: sysid calibrate"
            )


def read_camera(path: Path | str) -> Camera:
    """Read a camera file; BadInput names the entry that is missing or wrong, and the remedy."""
    found = dict(vars(read_toml(path, CameraFile, FILE_FORMAT, "make a camera file with: sysid calibrate", more=True)))
    trusted = found.pop("trusted")
    if trusted is None:
        trusted = DOUBTED_SOURCE not in found["source"]
    if not trusted and not found["doubts"]:
        found["doubts"] = (UNKNOWN_DOUBT,)
    return Camera(diameter=found.pop("ball").diameter, **found)


def ball_of(camera: Camera, mass: float) -> Ball:
    """The ball that the camera was calibrated for."""
    return Ball(camera.diameter, mass)
