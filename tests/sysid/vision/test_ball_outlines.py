"""Outlines of balls in pictures: their size and length, and what these say of a camera."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
import pytest

from sysid.vision.camera.calibrate import calibrate
from sysid.vision.camera.projection import Camera
from sysid.vision.camera.table.ball_outlines import NO_BALLS, find_balls
from sysid.vision.camera.table.reading import CameraHints
from sysid.vision.camera.trust import with_focal
from tests.footage.film import Look, Picture, film
from tests.footage.motion import Motion
from tests.support.table_views import errors, over_table, rms

cv2.setNumThreads(1)

LOOK = Look(noise=4.0, uneven=0.2, light=(0.2, -0.3, 1.0), cushion_shadow=0.01, cloth_tops=True, diamonds=0.012)
NAMES = ("white", "red", "yellow", "blue", "black")
PLACES = np.array([[-0.75, 0.3], [0.8, -0.35], [0.75, 0.3], [-0.8, -0.33], [0.05, 0.02]])


@lru_cache
def view(height: float) -> tuple[Camera, Picture]:
    """A camera straight over a table, whose lens is the longer the higher it hangs, and balls at rest."""
    camera = over_table((0.004, -0.003), size=(960, 540), span=2.45, height=height, k1=0.0)
    still = Motion(
        NAMES, np.array([0.0, 1.0]), np.stack([PLACES, PLACES]), np.tile([0.0, 0, 0, 1], (2, len(PLACES), 1))
    )
    return camera, next(film(camera, still, np.zeros(1), LOOK))


@pytest.mark.parametrize("height", [1.5, 3.5])
def test_outlines_are_as_large_and_as_long_as_the_camera_says(height: float) -> None:
    camera, picture = view(height)
    seen = find_balls([picture], camera)
    assert len(seen.radius) >= 4
    away = np.linalg.norm(seen.pixels[:, None] - camera.outline(PLACES), axis=2).min(axis=1)
    assert (away < 0.5).all()
    ratio, sd = seen.ratio(camera)
    assert abs(ratio - 1) < 2.5 * sd
    assert np.abs(seen.elongation_errors(camera)).max() < 3
    wide = with_focal(camera, 0.5 * camera.matrix[0, 0])
    assert np.sum(seen.elongation_errors(wide) ** 2) > 4 * np.sum(seen.elongation_errors(camera) ** 2)


@pytest.mark.slow
@pytest.mark.parametrize("height", [1.5, pytest.param(3.5, marks=pytest.mark.thorough)])
def test_balls_tell_the_focal_length_of_a_straight_view(height: float) -> None:
    camera, picture = view(height)
    found = calibrate(picture, camera.table, camera.diameter, CameraHints())
    assert found.doubts == () and found.focal_from == "found"
    assert found.camera.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=2.5 * found.focal_sd)
    assert 0.02 < found.focal_sd < 0.2
    assert rms(errors(camera, found)) < 1.3, "half a pixel"


def test_the_same_ball_in_many_pictures_counts_once() -> None:
    camera, picture = view(1.5)
    once, often = (find_balls([picture] * n, camera).elongation_errors(camera) for n in (1, 4))
    assert len(often) == 4 * len(once)
    assert np.sum(often**2) == pytest.approx(np.sum(once**2), rel=0.5)


def test_what_is_no_ball_tells_nothing() -> None:
    camera, picture = view(1.5)
    other = picture.copy()
    for u, v in np.rint(camera.outline(PLACES)).astype(int):
        cv2.rectangle(other, (u - 11, v - 11), (u + 11, v + 11), (200, 210, 220), cv2.FILLED)
    assert len(find_balls([other], camera).radius) == 0
    assert NO_BALLS.elongation_errors(camera).size == 0
    assert np.isnan(NO_BALLS.ratio(camera)).all()
