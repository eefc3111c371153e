"""The lens from a ChArUco board, drawn through a known lens; a part of it may be in view."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from sysid.cli.clips.calibrate import BoardOptions
from sysid.vision.camera.board import Board, lens_of
from sysid.vision.camera.projection import Camera
from tests.footage.film import Picture
from tests.support.table_views import TILTS, over_table

SQUARE_M, MARKER_M = 0.04, 0.03
FINE = 5000.0  # pixels of the drawn board in a metre


def views(camera: Camera, squares: tuple[int, int], dictionary: int, legacy: bool, aside: float) -> list[Picture]:
    """A board as a camera sees it from several sides, moved to the left of its picture [m]."""
    made = cv2.aruco.CharucoBoard(squares, SQUARE_M, MARKER_M, cv2.aruco.getPredefinedDictionary(dictionary))
    made.setLegacyPattern(legacy)
    printed = made.generateImage((round(squares[0] * SQUARE_M * FINE), round(squares[1] * SQUARE_M * FINE)))
    width, height = camera.size
    found = []
    for k, (a, b) in enumerate(TILTS):
        shift = np.array([-0.14 + 0.1 * np.sin(7 * k) - aside, -0.1 + 0.04 * np.cos(5 * k), 0.75])
        seen = dataclasses.replace(camera, rotation=np.array([a, b, 0.1]), translation=shift)
        light = np.zeros((height, width))
        for du, dv in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
            pixels = np.stack(np.meshgrid(np.arange(width) + du, np.arange(height) + dv), axis=-1).reshape(-1, 2)
            at = (seen.on_plane(pixels, 0.0) * FINE - 0.5).astype(np.float32).reshape(height, width, 2)
            light += cv2.remap(printed, at[..., 0], at[..., 1], cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, 200) / 4
        found.append(np.repeat(light[..., None], 3, axis=2).astype(np.uint8))
    return found


@pytest.mark.parametrize(
    ("squares", "dictionary", "legacy", "aside"),
    [((7, 5), cv2.aruco.DICT_5X5_100, False, 0.12), ((8, 6), cv2.aruco.DICT_4X4_50, True, 0.0)],
)
def test_a_charuco_board_tells_the_lens(
    squares: tuple[int, int], dictionary: int, legacy: bool, aside: float
) -> None:  # fmt: skip
    camera = over_table(size=(640, 416))
    lens = lens_of(views(camera, squares, dictionary, legacy, aside), Board(*squares, SQUARE_M, MARKER_M))
    assert lens.views == len(TILTS) and lens.rms < 0.2
    assert lens.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.01)
    assert lens.distortion[0] == pytest.approx(camera.distortion[0], abs=0.03)


def test_a_board_that_is_not_there_is_refused() -> None:
    grey = np.full((260, 400, 3), 90, np.uint8)
    with pytest.raises(BadInput, match="no 7x5 ChArUco board in 1 pictures; count its squares"):
        lens_of([grey], Board(7, 5, SQUARE_M, MARKER_M))
    with pytest.raises(BadInput, match="markers lie within squares"):
        lens_of([grey], Board(7, 5, SQUARE_M, SQUARE_M))


def test_how_a_board_is_named() -> None:
    assert BoardOptions("charuco:8x11", 0.015, 0.011).value() == Board(8, 11, 0.015, 0.011)
    assert BoardOptions("9x6", 0.03).value() == Board(9, 6, 0.03)
    for options, told in (
        (BoardOptions("charuco:8x11", 0.015), "requires --board-marker"),
        (BoardOptions("8x11", 0.015, 0.011), "write --board charuco:8x11"),
        (BoardOptions("aruco:8x11", 0.015, 0.011), "such as charuco:8x11"),
        (BoardOptions(None, None, 0.011), "give --board"),
    ):
        with pytest.raises(BadInput, match=told):
            options.value()
