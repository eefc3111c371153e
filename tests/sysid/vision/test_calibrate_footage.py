"""Calibration on footage with the difficulties of real films: cushions' shadows, cloth tops, lamps, a player."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import NOSE_HEIGHT, Table
from sysid.vision.camera.calibrate import Calibration, calibrate
from sysid.vision.camera.footages import table_view
from sysid.vision.camera.pictures.calibration_picture import draw
from sysid.vision.camera.projection import Camera, read_camera
from sysid.vision.camera.table.reading import CameraHints
from tests.footage import film
from tests.footage.film import Look, Picture
from tests.footage.motion import Motion
from tests.support.table_views import DIAMETER, errors, over_table, rms, run, taken

REAL = Look(
    noise=3.0, uneven=0.3, cushion_shadow=0.018, cloth=(0.40, 0.52, 0.46), cloth_tops=True, diamonds=0.012, lamps=1.0,
    player=True,
)  # fmt: skip
SIZE = (960, 540)


@pytest.fixture(scope="module")
def view() -> tuple[Camera, Picture]:
    """A camera with a wide lens 1.6 m over a table, and what it sees."""
    camera = over_table((0.01, -0.02), size=SIZE, span=2.45, height=1.6, k1=0.01)
    return camera, taken(camera, REAL)


@pytest.fixture(scope="module")
def found(view: tuple[Camera, Picture]) -> Calibration:
    camera, picture = view
    return calibrate(picture, camera.table, DIAMETER)


@pytest.mark.slow
def test_the_nose_is_neither_its_shadow_nor_the_end_of_the_cloth(
    view: tuple[Camera, Picture], found: Calibration
) -> None:
    camera, _ = view
    assert found.doubts == ()
    assert rms(errors(camera, found)) < 2.5, "2.5 mm are a pixel"
    assert len(found.diamonds.pixels) >= 15
    assert "diamonds" in found.notes[-1]


@pytest.mark.slow
@pytest.mark.parametrize("off", [3, pytest.param(4, marks=pytest.mark.thorough)])
def test_corners_ten_pixels_off_are_enough(view: tuple[Camera, Picture], off: int) -> None:
    camera, picture = view
    signs = np.array([[1, 1], [-1, 1], [1, -1], [-1, -1.0]])
    nose = np.full((4, 1), NOSE_HEIGHT * camera.radius)
    corners = camera.project(np.hstack([signs * [1.0, 0.5], nose]))
    corners += np.random.default_rng(off).uniform(-10, 10, (4, 2))
    found = calibrate(picture, camera.table, DIAMETER, CameraHints(corners=corners))
    assert found.doubts == ()
    assert rms(errors(camera, found)) < 2.5
    assert "the corners given lie" in found.notes[-1]


@pytest.mark.slow
@pytest.mark.parametrize("length", [1.94, pytest.param(2.1, marks=pytest.mark.thorough)])
def test_a_table_of_another_shape_is_refused(view: tuple[Camera, Picture], length: float) -> None:
    assert calibrate(view[1], Table(length, 1.0), DIAMETER).doubts


@pytest.mark.slow
def test_balls_of_another_size_are_refused() -> None:
    camera = over_table((0.01, -0.02), size=SIZE, span=2.45, height=1.6, k1=0.01)
    place = np.random.default_rng(2).uniform((-0.8, -0.35), (0.8, 0.0), (6, 2))
    still = np.tile([0.0, 0.0, 0.0, 1.0], (2, 6, 1))
    names = tuple(f"white_{k}" for k in range(6))
    motion = Motion(names, np.array([0.0, 1.0]), np.stack([place, place]), still)
    (picture,) = film.film(camera, motion, np.array([0.5]), REAL)
    wrong = calibrate(picture, camera.table, 0.82 * DIAMETER)
    assert any("check the sizes of balls and table" in doubt for doubt in wrong.doubts)


@pytest.mark.slow
def test_videos_of_one_camera_go_together(view: tuple[Camera, Picture]) -> None:
    picture, rng = view[1], np.random.default_rng(0)

    def frames(base: Picture) -> list[Picture]:
        return [np.clip(base + rng.normal(0, 2, base.shape), 0, 255).astype(np.uint8) for _ in range(3)]

    moved = taken(over_table((0.01, -0.02), size=SIZE, span=2.45, height=1.6, k1=0.01, aim=(0.008, 0.0)), REAL)
    seen = table_view({"a": frames(picture), "b": frames(picture), "c": frames(moved)})
    assert seen.used == ("a", "b")
    assert "c: the camera stood elsewhere" in seen.notes[0]
    assert table_view({"a": frames(picture), "c": frames(moved)}).used == ("a",)
    with pytest.raises(BadInput, match="480x270"):
        table_view({"a": frames(picture), "small": [cv2.resize(picture, (480, 270))]})


@pytest.mark.slow
def test_the_command_takes_several_pictures(
    view: tuple[Camera, Picture], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera, picture = view
    paths = [tmp_path / name for name in ("a.png", "b.png", "c.png")]
    for path, dy in zip(paths, (0, 0, 4), strict=True):
        cv2.imwrite(str(path), np.roll(picture, dy, axis=0))
    table = ("--length", "2.0", "--width", "1.0", "--diameter", str(DIAMETER), "--out", str(tmp_path / "cam.toml"))
    assert run(*map(str, paths), *table) == 0
    assert "c.png: the camera stood elsewhere; left out" in capsys.readouterr().out
    found = read_camera(tmp_path / "cam.toml")
    assert "a.png" in found.source and "b.png" in found.source
    grid = np.array([[x, y] for x in (-0.9, 0.0, 0.9) for y in (-0.4, 0.4)])
    assert rms(1e3 * np.linalg.norm(found.centres(camera.outline(grid)) - grid, axis=1)) < 2.5


def test_a_camera_that_moves_is_told(view: tuple[Camera, Picture]) -> None:
    later = np.roll(view[1], 3, axis=1)
    assert "moves" in table_view({"a": [view[1], later]}).notes[0]


@pytest.mark.slow
def test_the_picture_shows_model_details_and_figures(
    view: tuple[Camera, Picture], found: Calibration, tmp_path: Path
) -> None:
    draw(tmp_path / "cam.png", view[1], found)
    drawn = cv2.imread(str(tmp_path / "cam.png"))
    assert drawn.shape[1] == 2 * SIZE[0]
    assert drawn.shape[0] > 2 * SIZE[1] + SIZE[0]
    magenta = (drawn[..., 0] > 150) & (drawn[..., 1] < 100) & (drawn[..., 2] > 150)
    assert magenta[: 2 * SIZE[1]].sum() > 2000
    assert magenta[2 * SIZE[1] : 2 * SIZE[1] + SIZE[0]].sum() > 1000, "the noses are in the details, too"
