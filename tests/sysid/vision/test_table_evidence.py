"""What is seen of a plain table: no diamonds where there are none, edges up to the picture's end, the cloth's end."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from models.shot import Table
from sysid.vision.calibration import MEDIAN_FRAMES
from sysid.vision.camera.calibrate import calibrate
from sysid.vision.camera.footages import table_view
from sysid.vision.camera.pose import distances
from sysid.vision.camera.projection import Camera
from sysid.vision.camera.table import edges as table_edges
from sysid.vision.camera.table import lines as table_lines
from sysid.vision.camera.table import noses
from sysid.vision.camera.table.cloth_end import cloth_ends
from sysid.vision.camera.table.diamonds import find_diamonds
from sysid.vision.camera.table.edges import SIDE_PARTS, Edge
from sysid.vision.samples import spread_pictures
from tests.footage.__main__ import camera_over
from tests.footage.film import RUBBER, Look, Picture, developed, table_picture
from tests.footage.study import made, recipe
from tests.support.table_views import over_bed

PLAIN = Look(noise=1.5)  # of the median of some frames
TABLES = {
    "snooker": (Table(3.569, 1.778), 0.0525, (640, 400)), "pool": (Table(2.24, 1.12), 0.05715, (640, 360)),
    "small": (Table(1.881, 0.943), 0.0523, (640, 360)), "tiny": (Table(1.1, 0.6), 0.0525, (520, 320)),
}  # fmt: skip


def plain(name: str, seed: int = 0) -> tuple[Camera, Picture]:
    """A table as `python -m tests.footage` draws it when nothing else is said."""
    table, diameter, size = TABLES[name]
    camera = camera_over(table, diameter, size, 0.01, -0.08)
    return camera, developed(table_picture(camera, PLAIN), PLAIN, np.random.default_rng(seed))


@pytest.mark.parametrize("name", ["small", "tiny"])
def test_the_end_of_the_picture_and_ripples_along_an_edge_are_no_diamonds(name: str) -> None:
    camera, picture = plain(name)
    assert len(find_diamonds(picture.astype(np.float32), camera, RUBBER).pixels) == 0


@pytest.mark.slow
def test_diamonds_are_found_close_to_the_end_of_the_picture() -> None:
    camera, _ = plain("small")
    look = Look(noise=1.5, diamonds=0.012)
    picture = developed(table_picture(camera, look), look, np.random.default_rng(0)).astype(np.float32)
    assert len(find_diamonds(picture, camera, RUBBER).pixels) >= 16


def test_an_edge_much_weaker_than_another_is_hardly_a_nose() -> None:
    def edge(offset: float, grey: float) -> Edge:
        return Edge(offset, np.zeros(SIDE_PARTS), np.full((SIDE_PARTS, 3), grey / np.sqrt(3)))

    costs = {e.offset: cost for e, cost in noses._rated([edge(0.0, 20.0), edge(-0.04, 1.0)], 0.05, 4) if e}
    assert costs[0.0] == 0.0
    assert costs[-0.04] > 8.0
    costs = {e.offset: cost for e, cost in noses._rated([edge(0.0, 10.0), edge(-0.01, 20.0)], 0.05, 4) if e}
    assert costs[0.0] < 1.0, "a shadow's edge may be the stronger one"


def test_the_sides_of_the_cloth_end_where_it_does() -> None:
    camera, picture = plain("snooker")
    found = table_lines.at_edges(table_lines.sides(table_lines.cloth(picture)), picture)
    assert len(found) == 4
    for side in found:
        away = [distances(camera, side.points, np.full(len(side.points), rail), RUBBER) for rail in range(4)]
        assert min(abs(np.median(one)) for one in away) < 4e-3, "0.6 of a pixel"


@pytest.mark.slow
def test_the_sides_of_the_cloth_end_where_it_does_on_cushions_in_shade() -> None:
    camera, _ = plain("small")
    look = Look(noise=1.5, cloth_tops=True, lamps=0.7)  # one cushion half as bright as the bed
    picture = developed(table_picture(camera, look), look, np.random.default_rng(0))
    found = table_lines.at_edges(table_lines.sides(table_lines.cloth(picture)), picture)
    assert len(found) == 4
    for side in found:
        away = [distances(camera, side.points, np.full(len(side.points), rail), RUBBER) for rail in range(4)]
        assert min(abs(np.median(one)) for one in away) < 4e-3


def test_a_strip_goes_no_farther_than_the_picture() -> None:
    camera, picture = plain("tiny")
    for rail in range(4):
        far = table_edges.visible_extent(camera, rail, -0.06, RUBBER, RUBBER + 0.05)
        seen = table_edges.strip(picture.astype(np.float32), camera, rail, -0.06, far)
        assert seen is not None
        offsets = [edge.offset for edge in table_edges.edges(seen)]
        assert min(abs(np.array(offsets))) < 1e-3
        assert RUBBER <= far <= RUBBER + 0.05


@pytest.mark.slow
@pytest.mark.parametrize("name", [
    "snooker", "tiny", *(pytest.param(name, marks=pytest.mark.thorough) for name in ("pool", "small")),
])  # fmt: skip
def test_a_plain_table_is_calibrated_unaided(name: str) -> None:
    camera, picture = plain(name)
    found = calibrate(picture, camera.table, camera.diameter)
    assert found.doubts == ()
    assert over_bed(camera, found.camera) < 3.0


def test_a_table_that_goes_on_beyond_the_picture_is_said_so() -> None:
    camera, picture = plain("tiny")
    with pytest.raises(BadInput, match="beyond the left of the picture: film all of it"):
        calibrate(picture[:, 100:], camera.table, camera.diameter)


@pytest.mark.slow
def test_the_end_of_the_cloth_stands_in_for_a_nose_as_dark_as_its_shadow() -> None:
    table, diameter, size = TABLES["small"]
    camera = camera_over(table, diameter, size, 0.01, -0.08)
    look = Look(noise=1.5, cushion_shadow=0.016, cloth_tops=True)
    picture = developed(table_picture(camera, look), look, np.random.default_rng(0))
    found = calibrate(picture, camera.table, camera.diameter)
    assert found.doubts == ()
    assert any("no nose is seen at -x: the end of the cloth" in note for note in found.notes)
    assert over_bed(camera, found.camera) < 3.0


@pytest.mark.slow
def test_a_dark_cushion_whose_nose_seemed_the_end_of_the_cloth_is_looked_at_again(tmp_path: Path) -> None:
    film = recipe(137)  # under an arm; its diamonds and noses show, its left cushion is dark
    camera, _, video = made(film, tmp_path)
    view = table_view({video.name: list(spread_pictures(video, MEDIAN_FRAMES))})
    found = calibrate(view.picture, camera.table, camera.diameter, stills=view.stills)
    assert found.doubts == ()
    assert over_bed(camera, found.camera) < 1.0


@pytest.mark.slow
def test_the_cloth_ends_where_its_colour_does_however_dark() -> None:
    camera, _ = plain("small")
    look = Look(noise=1.5, cushion_shadow=0.009, cloth_tops=True)
    picture = developed(table_picture(camera, look), look, np.random.default_rng(0)).astype(np.float32)
    for rail in range(4):
        assert cloth_ends(picture, camera, rail, RUBBER)
        assert not cloth_ends(picture, camera, rail, 0.0), "its nose"
        assert not cloth_ends(picture, camera, rail, -0.018), "its shadow"
        assert not cloth_ends(picture, camera, rail, RUBBER + 0.03), "on the wood"
