"""The intrinsic parameters of a camera from a chessboard filmed in several places (Zhang 2000, by OpenCV).

In: pictures of the board. Out: `Lens`: focal lengths, principal point, distortion, and how well they are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.camera.projection import Array

MIN_FULL_VIEWS = 5  # from which on the principal point and all of the distortion are fitted
MAX_FOCAL_SD = 0.03  # of the focal length, relative
MAX_CORNER_RMS_PX = 1.0  # reprojection error of the corners
INITIAL_FOV_DEG = 60.0


@dataclass(frozen=True)
class Lens:
    """Intrinsic parameters of a camera."""

    size: tuple[int, int]  # width, height of its pictures [pixels]
    matrix: Array  # (3, 3) focal lengths and principal point [pixels]
    distortion: Array  # (5,) k1, k2, p1, p2, k3
    focal_sd: float  # of the focal length, relative
    rms: float  # reprojection error of the corners [pixels]
    views: int  # of the board


def lens_of(
    pictures: Iterable[NDArray[np.uint8]], pattern: tuple[int, int], square: float,
    progress: Callable[[str], None] = lambda line: None,
) -> Lens:  # fmt: skip
    """Calibrate the lens from pictures of a chessboard.

    Args:
        pictures: (height, width, 3) each, all of one size; those without the board are skipped.
        pattern: inner corners along and across the board.
        square: side of its squares [m].
        progress: receives a line on what is being done.

    Raises:
        BadInput: too few views, all from one direction, or inaccurate corners.
    """
    name = f"{pattern[0]}x{pattern[1]}"
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    seen: list[NDArray[np.float32]] = []
    size: tuple[int, int] | None = None
    count = 0
    for count, picture in enumerate(pictures, start=1):
        if size is not None and size != picture.shape[1::-1]:
            raise BadInput(f"pictures of the board are of {size} and {picture.shape[1::-1]} pixels: film all alike")
        size = (picture.shape[1], picture.shape[0])
        found, corners = cv2.findChessboardCornersSB(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), pattern, None, flags)
        if found:
            seen.append(np.asarray(corners, np.float32).reshape(-1, 1, 2))
        progress(f"chessboard: {len(seen)} views in {count} pictures")
    if size is None or not seen:
        raise BadInput(f"no {name} chessboard in {count} pictures; count its inner corners, and film all of it, sharp")
    grid = np.zeros((pattern[0] * pattern[1], 3), np.float32)
    grid[:, :2] = square * np.stack(np.meshgrid(range(pattern[0]), range(pattern[1])), axis=-1).reshape(-1, 2)
    focal = max(size) / 2 / np.tan(np.radians(INITIAL_FOV_DEG) / 2)
    start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    few = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2
    kind = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3 | (few if len(seen) < MIN_FULL_VIEWS else 0)
    rms, matrix, distortion, _, _, sds, _, _ = cv2.calibrateCameraExtended(
        [grid] * len(seen), seen, size, start, np.zeros(5), flags=kind
    )
    focal_sd = float(np.max(np.ravel(sds)[:2]) / matrix[0, 0])  # with a fixed aspect only the second is filled in
    if rms > MAX_CORNER_RMS_PX:
        raise BadInput(f"the {name} chessboard's corners miss by {rms:.1f} pixels: a flat, sharp board is needed")
    fov = 2 * np.degrees(np.arctan(max(size) / 2 / matrix[0, 0]))
    if not 0 < focal_sd < MAX_FOCAL_SD or not 5 < fov < 150:  # undetermined by views from straight above
        views = f"{len(seen)} views" if len(seen) > 1 else "one view"
        raise BadInput(
            f"{views} of the {name} chessboard do not determine the focal length to {100 * MAX_FOCAL_SD:.0f} %:"
            " film it in five places or more, tilted to all sides, or leave --board out"
        )
    return Lens(
        size, np.asarray(matrix, float), np.ravel(distortion)[:5].astype(float), focal_sd, float(rms), len(seen)
    )
