"""Sides weighed by how straight their points lie, and noses shifted by the blur of what lies beside them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.shot import Table
from sysid.vision.camera.pose import Rails, distances, fit_camera
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.edge_blur import blur_shift
from sysid.vision.camera.table.edges import Edge, edge_points, edges, nose_points, strip
from sysid.vision.camera.table.weighed_sides import weighed
from sysid.vision.camera.trust import uncertainty
from tests.footage.__main__ import camera_over
from tests.footage.film import RUBBER, Look, developed, table_picture
from tests.support.table_views import over_bed

SIDE = 100  # points of a side


@pytest.fixture
def camera() -> Camera:
    """Over a large table, which pictures of few pixels show."""
    return camera_over(Table(3.569, 1.778), 0.0525, (640, 360), 0.06, -0.02)


def along(camera: Camera, out: dict[int, Array]) -> tuple[Array, Rails]:
    """Pixels (n, 2) so far out of each rail's nose [m], and their rails (n,)."""
    pixels = []
    for rail, away in out.items():
        half = (camera.table.length, camera.table.width)[1 - rail // 2] / 2
        pixels.append(camera.project(nose_points(camera, rail, np.linspace(-0.9, 0.9, SIDE) * half, away)))
    return np.concatenate(pixels), np.repeat(np.array(list(out), np.intp), SIDE)


def test_a_weak_edge_that_wanders_counts_less_than_the_end_of_the_cloth_behind_it(camera: Camera) -> None:
    rng = np.random.default_rng(3)
    before, after, told = [], [], []
    for _ in range(6):
        scatter = dict(zip(range(4), (2e-3, 3e-4, 3e-3, 1.5e-3), strict=True))  # of stretches: three weak edges
        wander = {rail: np.repeat(rng.normal(0, sd, SIDE // 10), 10) for rail, sd in scatter.items()}
        noses, rails = along(camera, {rail: w + rng.normal(0, 3e-4, SIDE) for rail, w in wander.items()})
        ends, behind = along(camera, {rail: RUBBER + 2e-3 * rail + rng.normal(0, 5e-4, SIDE) for rail in range(4)})
        lines = fit_camera(camera, noses, rails, ("k1", "focal"), prior={"focal": (0.0, 0.3), "k1": (0.0, 0.2)})
        found = weighed(lines, {rail: ends[behind == rail] for rail in range(4)}, {})
        before.append(over_bed(camera, lines.camera))
        after.append(over_bed(camera, found.camera))
        told.append(1e3 * uncertainty(found)[0])
    assert np.sqrt(np.mean(np.square(after))) < 0.6 * np.sqrt(np.mean(np.square(before)))
    assert 0.4 < np.sqrt(np.mean(np.square(told)) / np.mean(np.square(after))) < 2.5


def test_what_is_left_of_a_shift_by_blur_is_told(camera: Camera) -> None:
    noses, rails = along(camera, {rail: np.random.default_rng(rail).normal(0, 3e-4, SIDE) for rail in range(4)})
    lines = fit_camera(camera, noses, rails, ("k1",), prior={"k1": (0.0, 0.2)})
    sure, unsure = (uncertainty(weighed(lines, {}, dict.fromkeys(range(4), shift)))[0] for shift in (0.0, 4e-3))
    assert sure < 5e-4
    assert unsure > 1e-3


def test_a_nose_is_not_pushed_out_by_a_shadow_too_narrow_for_the_picture(camera: Camera) -> None:
    look = Look(noise=0.5, blur=0.9, cushion_shadow=0.0086)
    picture = developed(table_picture(camera, look), look, np.random.default_rng(0)).astype(np.float32)
    plain = replace(look, cushion_shadow=0.0)
    lit = developed(table_picture(camera, plain), plain, np.random.default_rng(0)).astype(np.float32)
    for rail in (0, 3):
        seen = strip(picture, camera, rail, -0.04, 0.02)
        assert seen is not None
        nose = min(edges(seen), key=lambda edge: abs(edge.offset - 3e-3))
        found = edge_points(picture, camera, rail, nose, 2.0)
        out = float(np.median(distances(camera, found, np.full(len(found), rail))))
        assert out > 2e-3, "a third of a pixel"
        assert abs(out - blur_shift(picture, camera, rail, replace(nose, offset=out))) < 0.6 * out
        alone = Edge(0.0, nose.places, -nose.steps)
        assert abs(blur_shift(lit, camera, rail, alone)) < 1e-3, "an edge beside which there is nothing"
