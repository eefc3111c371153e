"""Corners that a person gave and holds; how uncertain places are."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import NOSE_HEIGHT
from sysid.vision.camera.pose import Rails, fit_camera
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.trust import doubts, outline_doubts, uncertainty
from tests.support.table_views import calibrated, errors, fov, over_table, rms, run, taken


def test_corners_that_hold_are_kept_to_some_pixels_and_the_edges_near_them_taken() -> None:
    """Eight pixels off they lead to the noses; where there are none near them, other edges are not taken instead."""
    camera = over_table()
    picture = taken(camera)
    nose = NOSE_HEIGHT * camera.radius
    corners = camera.project(np.array([[x, y, nose] for x, y in ((1, 0.5), (-1, 0.5), (1, -0.5), (-1, -0.5))]))
    off = np.array([[5.0, -6.0], [-6.0, 4.0], [3.0, 7.0], [-7.0, -3.0]])
    found = calibrated(camera, picture, fov=fov(camera), corners=corners + off, hold=True)
    assert rms(errors(camera, found)) < 0.6
    middle = corners.mean(axis=0)
    inward = middle + 0.8 * (corners - middle)  # on the cloth, where no edges are
    far = calibrated(camera, picture, fov=fov(camera), corners=inward, hold=True)
    there = far.camera.project(np.hstack([camera.table.corners(), np.full((4, 1), nose)]))
    assert np.linalg.norm(there[:, None] - inward, axis=2).min(axis=1).max() < 15.0
    assert far.doubts


def test_places_are_uncertain_in_proportion_to_the_scatter_of_edges() -> None:
    """From far above the focal length is hardly known, and places do not depend on it."""
    camera = over_table((0.0, 0.02), size=(1920, 1080), span=2.4, height=6.0, k1=0.0)
    lines = fit_camera(camera, *_edge_points(camera, 0.3), ("k1", "focal"))
    doubled = uncertainty(dataclasses.replace(lines, covariance=4.0 * lines.covariance))
    np.testing.assert_allclose(doubled, 2.0 * np.array(uncertainty(lines)), rtol=0.05)


def _edge_points(camera: Camera, off: float, seed: int = 0) -> tuple[Array, Rails]:
    """Points on the noses of a table of 2 m x 1 m, which err by so many pixels; 180 of each rail."""
    along, nose = np.linspace(-0.45, 0.45, 180), NOSE_HEIGHT * camera.radius
    points = [[[s, t, nose] for t in along] for s in (1.0, -1.0)]
    points += [[[2 * t, s, nose] for t in along] for s in (0.5, -0.5)]
    pixels, rails = camera.project(np.concatenate(points)), np.repeat(np.arange(4), len(along))
    return pixels + np.random.default_rng(seed).normal(0, off, pixels.shape), rails


def test_a_side_without_a_nose_ends_farther_in_or_out_than_the_others() -> None:
    camera = over_table()
    pixels, rails = _edge_points(camera, 0.1)
    lines = fit_camera(camera, pixels, rails)
    middle = pixels.mean(axis=0)
    for share, way in ((0.95, "in"), (1.05, "out")):
        ends = np.where((rails == 0)[:, None], middle + share * (pixels - middle), pixels)
        (doubt,) = outline_doubts(lines, dataclasses.replace(lines, pixels=ends), 0)
        assert f"mm farther {way} than" in doubt and "-" not in doubt.split("mm")[0].removeprefix("at +x")


def test_another_size_of_the_table_must_explain_more_than_edges_err_by() -> None:
    """A section of a side that is a fifth of a pixel off is no reason to doubt a size; sides of another one are."""
    camera = over_table((0.0, -1.1), height=3.0)
    pixels, rails = _edge_points(camera, 0.05)
    bent = pixels.copy()
    bent[:60, 0] += 0.2
    lines = fit_camera(camera, bent, rails, ("k1", "focal"))
    assert not [doubt for doubt in doubts(lines, True, False) if "would fit the sides better" in doubt]
    camera = over_table()
    other = dataclasses.replace(camera, table=dataclasses.replace(camera.table, width=1.03))
    lines = fit_camera(other, *_edge_points(camera, 0.05), ("k1",))
    assert [doubt for doubt in doubts(lines, False, False) if "would fit the sides better" in doubt]


def test_what_holds_must_be_given(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "p.png"), np.zeros((80, 100, 3), np.uint8))
    words = (str(tmp_path / "p.png"), "--table", "snooker", "--out", str(tmp_path / "cam.toml"))
    with pytest.raises(BadInput, match="--hold: requires --corners or --click"):
        run(*words, "--hold")
