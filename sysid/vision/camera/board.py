"""The intrinsic parameters of a camera from a board filmed in several places (Zhang 2000, by OpenCV).

In: pictures of a chessboard, or of a ChArUco board, whose white squares carry ArUco markers: of that any part may be in
view. Out: `Lens`: focal lengths, principal point, distortion, and how well they are known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
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
MIN_CORNERS = 6  # of a view: twice as many equations as its pose has unknowns
MARKER_DICTIONARIES = tuple(  # of markers, in families whose smaller sets begin alike
    getattr(cv2.aruco, f"DICT_{name}")
    for name in ("4X4_1000", "5X5_1000", "6X6_1000", "7X7_1000", "ARUCO_ORIGINAL", "APRILTAG_36h11")
)


@dataclass(frozen=True)
class Lens:
    """Intrinsic parameters of a camera."""

    size: tuple[int, int]  # width, height of its pictures [pixels]
    matrix: Array  # (3, 3) focal lengths and principal point [pixels]
    distortion: Array  # (5,) k1, k2, p1, p2, k3
    focal_sd: float  # of the focal length, relative
    rms: float  # reprojection error of the corners [pixels]
    views: int  # of the board


@dataclass(frozen=True)
class Board:
    """A chessboard by its inner corners; with markers a ChArUco board by its squares."""

    columns: int  # inner corners, or squares, along
    rows: int  # and across
    square: float  # side of a square [m]
    marker: float | None = None  # side of the markers in the white squares [m]; None for a chessboard

    @property
    def name(self) -> str:
        """As messages call it."""
        return f"{self.columns}x{self.rows} {'chessboard' if self.marker is None else 'ChArUco board'}"

    @property
    def counted(self) -> str:
        """What its numbers count."""
        return "inner corners" if self.marker is None else "squares"


Corners = tuple[
    NDArray[np.float32], NDArray[np.float32]
]  # of a view: (n, 3) on the board [m], (n, 1, 2) in the picture
Finder = Callable[[NDArray[np.uint8]], Corners | None]


def lens_of(
    pictures: Iterable[NDArray[np.uint8]], board: Board, progress: Callable[[str], None] = lambda line: None
) -> Lens:
    """Calibrate the lens from pictures of a board.

    Args:
        pictures: (height, width, 3) each, all of one size; those without the board are skipped.
        board: what is filmed.
        progress: receives a line on what is being done.

    Raises:
        BadInput: too few views, all from one direction, or inaccurate corners.
    """
    greys: list[NDArray[np.uint8]] = []
    for picture in pictures:
        if greys and picture.shape[:2] != greys[0].shape:
            size, other = greys[0].shape[::-1], picture.shape[1::-1]
            raise BadInput(f"pictures of the board are of {size} and {other} pixels: film all alike")
        greys.append(np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), np.uint8))
    find = _chessboard(board) if board.marker is None else _charuco(board, board.marker, greys)
    views: list[Corners] = []
    for count, grey in enumerate(greys, start=1):
        if (found := find(grey)) is not None:
            views.append(found)
        progress(f"{board.name}: {len(views)} views in {count} pictures")
    if not views:
        raise BadInput(
            f"no {board.name} in {len(greys)} pictures; count its {board.counted}, and film the whole board in focus"
        )
    size = (greys[0].shape[1], greys[0].shape[0])
    focal = max(size) / 2 / np.tan(np.radians(INITIAL_FOV_DEG) / 2)
    start = np.array([[focal, 0, (size[0] - 1) / 2], [0, focal, (size[1] - 1) / 2], [0, 0, 1.0]])
    few = cv2.CALIB_FIX_PRINCIPAL_POINT | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K2
    kind = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3 | (few if len(views) < MIN_FULL_VIEWS else 0)
    rms, matrix, distortion, _, _, sds, _, _ = cv2.calibrateCameraExtended(
        [places for places, _ in views], [pixels for _, pixels in views], size, start, np.zeros(5), flags=kind
    )
    focal_sd = float(np.max(np.ravel(sds)[:2]) / matrix[0, 0])  # with a fixed aspect only the second is filled in
    if rms > MAX_CORNER_RMS_PX:
        raise BadInput(f"the {board.name}'s corners miss by {rms:.1f} pixels: film a flat board, in focus")
    fov = 2 * np.degrees(np.arctan(max(size) / 2 / matrix[0, 0]))
    if not 0 < focal_sd < MAX_FOCAL_SD or not 5 < fov < 150:  # undetermined by views from straight above
        seen = f"{len(views)} views" if len(views) > 1 else "one view"
        raise BadInput(
            f"{seen} of the {board.name} do not determine the focal length to {100 * MAX_FOCAL_SD:.0f} %:"
            " film it in five places or more, tilted to all sides, or leave --board out"
        )
    return Lens(
        size, np.asarray(matrix, float), np.ravel(distortion)[:5].astype(float), focal_sd, float(rms), len(views)
    )


def _chessboard(board: Board) -> Finder:
    """What finds all inner corners of a chessboard in a grey picture."""
    pattern = board.columns, board.rows
    flags = cv2.CALIB_CB_ACCURACY | cv2.CALIB_CB_EXHAUSTIVE
    grid = np.zeros((board.columns * board.rows, 3), np.float32)
    grid[:, :2] = board.square * np.stack(np.meshgrid(range(pattern[0]), range(pattern[1])), axis=-1).reshape(-1, 2)

    def find(grey: NDArray[np.uint8]) -> Corners | None:
        found, corners = cv2.findChessboardCornersSB(grey, pattern, None, flags)
        return (grid, np.asarray(corners, np.float32).reshape(-1, 1, 2)) if found else None

    return find


def _charuco(board: Board, marker: float, greys: Sequence[NDArray[np.uint8]]) -> Finder:
    """What finds the inner corners of a ChArUco board in a grey picture, those that are in view.

    The markers' dictionary, and whether the first square is black, as OpenCV's before 4.6 were with an even number of
    rows, is that with which most corners are found in pictures.
    """
    if not 0 < marker < board.square:
        raise BadInput(f"--board-marker {marker:g}: markers lie within squares, of {board.square:g} m; measure both")
    best, most = None, 0
    for name in MARKER_DICTIONARIES:
        known = cv2.aruco.getPredefinedDictionary(name)
        codes = known.bytesList[: board.columns * board.rows // 2]  # each white square has one
        dictionary = cv2.aruco.Dictionary(codes, known.markerSize, known.maxCorrectionBits)
        for legacy in (False, True):
            made = cv2.aruco.CharucoBoard((board.columns, board.rows), board.square, marker, dictionary)
            made.setLegacyPattern(legacy)
            found = _charuco_finder(made)
            corners = sum(len(one[0]) for grey in greys if (one := found(grey)) is not None)
            if corners > most:
                best, most = found, corners
    return best if best is not None else lambda grey: None


def _charuco_finder(made: cv2.aruco.CharucoBoard) -> Finder:
    """The same of a board as OpenCV has it."""
    detector = cv2.aruco.CharucoDetector(made)
    places = np.asarray(made.getChessboardCorners(), np.float32)

    def find(grey: NDArray[np.uint8]) -> Corners | None:
        corners, numbers, _, _ = detector.detectBoard(grey)
        if numbers is None or len(numbers) < MIN_CORNERS:
            return None
        on_board = places[np.ravel(numbers)]
        flat = np.linalg.svd(on_board[:, :2] - on_board[:, :2].mean(axis=0), compute_uv=False)
        if flat[1] < made.getSquareLength():  # all in one row
            return None
        return on_board, np.asarray(corners, np.float32).reshape(-1, 1, 2)

    return find
