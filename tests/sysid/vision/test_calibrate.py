"""Calibration on drawn pictures of a table whose camera is known."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.errors import BadInput
from models.shot import NOSE_HEIGHT, RAIL_NAMES, Table
from sysid.vision.camera.board import Board, lens_of
from sysid.vision.camera.calibrate import calibrate
from sysid.vision.camera.pictures import calibration_report
from sysid.vision.camera.projection import Array, Camera, meet_plane, read_camera
from sysid.vision.camera.table.reading import CameraHints
from sysid.vision.samples import spread_pictures
from tests.footage import film
from tests.footage.film import Picture
from tests.footage.motion import Motion
from tests.support.table_views import DIAMETER, LOOK, TILTS, calibrated, errors, fov, over_table, rms, run, taken

cv2.setNumThreads(1)


@pytest.fixture(scope="module")
def straight() -> tuple[Camera, Picture]:
    camera = over_table()
    return camera, taken(camera)


def test_a_known_focal_length_gives_places_to_a_fraction_of_a_pixel(straight: tuple[Camera, Picture]) -> None:
    camera, picture = straight
    found = calibrated(camera, picture, fov=fov(camera))
    assert found.focal_from == "given"
    assert found.doubts == ()
    assert set(found.rails) == set(RAIL_NAMES)
    assert "between bed and cushion" in found.edge
    assert rms(errors(camera, found)) < 0.6, "4 mm are a pixel"
    assert found.camera.eye[2] == pytest.approx(camera.eye[2], abs=0.01)
    assert found.camera.residual_m < 2e-3
    assert "4 cushion lines" in found.camera.source


def test_a_straight_view_does_not_tell_the_focal_length_and_it_hardly_matters(
    straight: tuple[Camera, Picture],
) -> None:
    camera, picture = straight
    found = calibrated(camera, picture)
    assert found.focal_from == "assumed"
    assert np.isnan(found.focal_sd)
    off = abs(found.camera.matrix[0, 0] / camera.matrix[0, 0] - 1)
    assert off > 0.1, "else this shows nothing"
    assert rms(errors(camera, found)) < 0.6 + 1e3 * found.parallax[0] * off / 0.1
    assert 0.1e-3 < found.parallax[0] < 1e-3


@pytest.mark.slow
def test_a_tilted_view_tells_the_focal_length() -> None:
    camera = over_table((0.05, 0.4), span=3.0, pockets=False)
    found = calibrated(camera, taken(camera))
    assert found.focal_from == "found"
    assert found.camera.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=3 * found.focal_sd)
    assert found.focal_sd < 0.05
    assert found.tilt == pytest.approx(np.degrees(np.arccos(-camera.axes[2, 2])), abs=0.3)
    assert rms(errors(camera, found)) < 1.0
    apart = dataclasses.replace(found, apart_sd=0.02)  # as where something else than the sides tells the focal length
    known = calibration_report.place_sd(apart)
    assert known[0] > found.spread[0] and known[1] > found.spread[1]
    assert dict(calibration_report.rows(apart))["ball positions"].startswith(f"sd {1e3 * known[0]:.2f} mm rms")
    assert calibration_report.to_json(apart)["place_sd_m"] == {"rms": known[0], "worst": known[1]}


@pytest.mark.slow
def test_x_points_right_or_up_and_nothing_is_mirrored() -> None:
    upright = over_table(turn=-np.pi / 2, size=(300, 480))
    assert upright.project(np.array([[0.5, 0, 0]]))[0, 1] < upright.project(np.zeros((1, 3)))[0, 1]
    found = calibrated(upright, taken(upright), fov=fov(upright))
    assert rms(errors(upright, found)) < 1.2, "5.4 mm are a pixel"
    # Turned by half a turn the same table gets its axes from the picture again.
    turned = over_table(turn=np.pi, size=(480, 300))
    found = calibrated(turned, taken(turned), fov=fov(turned))
    origin, x, y = found.camera.project(np.array([[0, 0, 0], [0.3, 0, 0], [0, 0.3, 0.0]]))
    assert x[0] - origin[0] > 35
    assert y[1] - origin[1] < -35
    half_turn = dataclasses.replace(turned, rotation=cv2.Rodrigues(turned.axes @ np.diag([-1.0, -1, 1]))[0].ravel())
    assert rms(errors(half_turn, found)) < 1.2


@pytest.mark.slow
def test_weak_cushions_projected_lines_balls_and_a_hand(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "CUSHION", tuple(0.85 * c for c in film.CLOTH))
    camera = over_table()
    picture = taken(camera)
    for ends in (((-0.99, 0.44), (0.99, 0.44)), ((-0.9, -0.4), (0.9, 0.3)), ((-0.6, -0.49), (-0.6, 0.49))):
        a, b = np.rint(camera.project(np.array([[*end, 0.0] for end in ends]))).astype(int).tolist()
        cv2.line(picture, a, b, (200, 255, 200), 1, cv2.LINE_AA)
    for u, v in camera.project(np.array([[x, 0.474, 0.026] for x in np.arange(-0.8, -0.3, 0.06)])):
        cv2.circle(picture, (round(u), round(v)), 6, (20, 20, 180), cv2.FILLED, cv2.LINE_AA)
    cv2.fillPoly(picture, [np.array([[300, 0], [340, 150], [380, 140], [360, 0]])], (120, 150, 210))
    found = calibrated(camera, picture, fov=fov(camera))
    assert found.doubts == ()
    assert "between bed and cushion" in found.edge
    assert rms(errors(camera, found)) < 1.0


@pytest.mark.slow
def test_a_cushion_brighter_than_the_bed_and_a_shadow_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    ground = film._ground

    def lit(camera: Camera, rays: Array) -> Array:
        out = ground(camera, rays)
        xy = np.nan_to_num(meet_plane(camera.eye, rays, NOSE_HEIGHT * camera.radius), nan=9.0)
        out[(xy[:, 1] > 0.5) & (xy[:, 1] < 0.55) & (np.abs(xy[:, 0]) < 1.05)] = 1.3 * np.array(film.CLOTH)
        out[(xy[:, 1] > 0.47) & (xy[:, 1] < 0.5)] *= 0.7
        return out

    monkeypatch.setattr(film, "_ground", lit)
    camera = over_table()
    found = calibrated(camera, taken(camera), fov=fov(camera))
    assert found.doubts == ()
    assert rms(errors(camera, found)) < 0.8, "the shadow's edge is not the nose"


@pytest.mark.slow
def test_the_cloths_end_alone_is_not_trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(film, "CUSHION", film.CLOTH)
    camera = over_table(pockets=False)
    found = calibrated(camera, taken(camera), fov=fov(camera))
    assert any("longer and wider" in doubt for doubt in found.doubts)
    assert not found.camera.trusted


@pytest.mark.parametrize("width", [0.97, 1.05])
def test_a_wrong_width_is_not_trusted(straight: tuple[Camera, Picture], width: float) -> None:
    camera, picture = straight
    found = calibrate(picture, Table(2.0, width), DIAMETER, CameraHints(fov=fov(camera)))
    assert found.doubts, "at 1.05 m the cushions' outer edges have the aspect of such a table"
    assert all("length and width" in doubt for doubt in found.doubts)


@pytest.mark.slow
def test_three_sides_with_a_known_focal_length() -> None:
    camera = over_table(aim=(-0.8, 0.0))
    picture = taken(camera)
    found = calibrated(camera, picture, fov=fov(camera), sees=("+x", "+y", "-y"))
    assert set(found.rails) == {"+x", "+y", "-y"}
    assert rms(errors(camera, found)) < 2.0
    with pytest.raises(BadInput, match="--sees"):
        calibrated(camera, picture)


def test_corners_by_hand(straight: tuple[Camera, Picture]) -> None:
    camera, picture = straight
    nose = NOSE_HEIGHT * camera.radius
    corners = camera.project(np.array([[x, y, nose] for x, y in ((1, 0.5), (-1, 0.5), (1, -0.5), (-1, -0.5))]))
    off = np.array([[1.0, -1], [1, 2], [-1, -2], [1, 1]])
    found = calibrated(camera, picture, fov=fov(camera), corners=corners + off)
    assert rms(errors(camera, found)) < 0.6, "the edges beside them mend what the hand got wrong"
    nothing = np.full_like(picture, 90)
    flat = dataclasses.replace(camera, distortion=np.zeros(5))
    corners = flat.project(np.array([[x, y, nose] for x, y in ((1, 0.5), (-1, 0.5), (1, -0.5), (-1, -0.5))]))
    found = calibrated(flat, nothing, fov=fov(camera), corners=corners)
    assert not found.edges
    assert np.isnan(found.spread).all()
    assert rms(errors(flat, found)) < 0.1
    assert "only as accurate as" in found.doubts[0], "nothing tells how good they are"
    wrong = calibrated(flat, nothing, fov=fov(camera), corners=corners + np.array([[80.0, 0], [0, 0], [0, 60], [0, 0]]))
    assert "the corners given miss" in wrong.doubts[0]


def test_no_table_is_refused() -> None:
    rng = np.random.default_rng(0)
    grey = np.full((240, 320, 3), 90, np.uint8)
    noise = rng.integers(0, 255, (240, 320, 3)).astype(np.uint8)
    green = np.tile(np.array([40, 120, 30], np.uint8), (240, 320, 1))
    for picture in (grey, noise, green):
        with pytest.raises(BadInput, match="--corners") as caught:
            calibrate(picture, Table(2.0, 1.0), DIAMETER)
        assert "\n" not in str(caught.value)


def board_view(camera: Camera, turn: tuple[float, float, float], shift: tuple[float, float, float]) -> Picture:
    """A chessboard of 8 x 6 squares of 4 cm, its first inner corner at the origin of its own axes."""
    seen = dataclasses.replace(camera, rotation=np.array(turn), translation=np.array(shift))
    w, h = camera.size
    total = np.zeros(w * h)
    for du, dv in ((-0.25, -0.25), (0.25, -0.25), (-0.25, 0.25), (0.25, 0.25)):
        grid = np.stack(np.meshgrid(np.arange(w) + du, np.arange(h) + dv), axis=-1).reshape(-1, 2)
        squares = np.floor(seen.on_plane(grid, 0.0) / 0.04)
        on = (squares >= -1).all(axis=1) & (squares[:, 0] < 7) & (squares[:, 1] < 5)
        total += np.where(on & (squares.sum(axis=1) % 2 == 0), 20.0, 220.0) / 4
    return np.repeat(total.reshape(h, w, 1), 3, axis=2).astype(np.uint8)


def board_views(camera: Camera, tilts: list[tuple[float, float]]) -> list[Picture]:
    # on_plane needs a plane before the camera: the board's z axis points away from it.
    return [
        board_view(camera, (a, b, 0.1), (-0.12 + 0.1 * np.sin(7 * k), -0.08 + 0.04 * np.cos(5 * k), 0.75))
        for k, (a, b) in enumerate(tilts)
    ]


@pytest.fixture(scope="module")
def board() -> list[Picture]:
    return board_views(over_table(size=(400, 260)), TILTS)


def test_a_board_tells_the_lens(board: list[Picture]) -> None:
    camera = over_table(size=(400, 260))
    lens = lens_of(board, Board(7, 5, 0.04))
    assert lens.views == len(TILTS)
    assert lens.matrix[0, 0] == pytest.approx(camera.matrix[0, 0], rel=0.01)
    assert lens.distortion[0] == pytest.approx(camera.distortion[0], abs=0.03)
    found = calibrated(camera, taken(camera), lens=lens)
    assert found.focal_from == "board"
    assert rms(errors(camera, found)) < 1.5, "6.5 mm are a pixel"
    with pytest.raises(BadInput, match="use one size"):
        calibrate(np.zeros((100, 100, 3), np.uint8), camera.table, DIAMETER, CameraHints(lens=lens))


def test_a_board_seen_from_one_side_or_not_at_all_is_refused(board: list[Picture]) -> None:
    camera = over_table(size=(400, 260))
    with pytest.raises(BadInput, match="focal length"):
        lens_of(board_views(camera, [(0.0, 0.0)]), Board(7, 5, 0.04))
    with pytest.raises(BadInput, match="no 6x4 chessboard"):
        lens_of([np.full((260, 400, 3), 90, np.uint8)], Board(6, 4, 0.04))


def test_the_command_writes_camera_report_and_figures(
    straight: tuple[Camera, Picture], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    camera, picture = straight
    rng = np.random.default_rng(1)
    video = cv2.VideoWriter(
        str(tmp_path / "v.avi"), cv2.VideoWriter.fourcc(*"FFV1"), 30, (picture.shape[1], picture.shape[0])
    )
    for _ in range(5):
        frame = picture.copy()
        for u, v in rng.uniform((100, 100), (540, 300), (20, 2)):
            cv2.circle(frame, (round(u), round(v)), 9, (30, 30, 200), cv2.FILLED)
        video.write(frame)
    video.release()
    out, report, figures = (str(tmp_path / name) for name in ("cam.toml", "cam.png", "cam.json"))
    table = ("--length", "2.0", "--width", "1.0", "--diameter", "0.0525", "--out", out)
    assert run(str(tmp_path / "v.avi"), *table, "--fov", f"{fov(camera)}", "--report", report, "--json", figures) == 0
    text = capsys.readouterr().out
    assert "residual" in text
    assert "focal length 10 % off" in text
    written = read_camera(out)
    assert written.table == camera.table
    assert "v.avi" in written.source
    pixels = camera.outline(np.array([[0.8, 0.3], [-0.9, -0.4]]))
    assert written.centres(pixels) == pytest.approx(np.array([[0.8, 0.3], [-0.9, -0.4]]), abs=1e-3)
    drawn = cv2.imread(report).shape
    assert drawn[1] >= 1000 and drawn[1] % picture.shape[1] == 0, "small pictures are drawn larger"
    assert drawn[0] > picture.shape[0] * drawn[1] // picture.shape[1], "the figures stand below"
    told = json.loads(Path(figures).read_text())
    assert told["residual_m"] == pytest.approx(written.residual_m)
    assert told["doubts"] == []
    assert told["focal_sd"] is None


@pytest.mark.slow
def test_the_command_says_when_it_is_not_to_be_trusted(
    straight: tuple[Camera, Picture], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _, picture = straight
    cv2.imwrite(str(tmp_path / "p.png"), picture)
    out = str(tmp_path / "cam.toml")
    arguments = (str(tmp_path / "p.png"), "--length", "2.0", "--width", "1.1", "--diameter", "0.0525", "--out", out)
    assert run(*arguments) == 1
    told = [line.partition("NOT to be trusted: ")[2] for line in capsys.readouterr().out.splitlines()]
    assert read_camera(out).doubts == tuple(line for line in told if line) != ()


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"--diameter": "52.5"}, "metres"),
        ({"--length": "0.9"}, "exchange"),
        ({"--corners": "1,2 3,4"}, "four points"),
        ({"--sees": "+x,+z"}, "--sees"),
        ({"--board": "9by6"}, "--board"),
        ({"--board": "9x6"}, "--square"),
        ({"--square": "0.03"}, "--board"),
        ({"--board": "9x6", "--square": "0.03", "--fov": "60"}, "one of them"),
        ({"--out": "nowhere/at/all/cam.toml"}, "folder"),
        ({}, "does not exist"),
    ],
)
def test_bad_arguments_are_told_in_one_line(change: dict[str, str], match: str, tmp_path: Path) -> None:
    usual = {"--length": "2.0", "--width": "1.0", "--diameter": "0.0525", "--out": str(tmp_path / "cam.toml")} | change
    with pytest.raises(BadInput, match=match) as caught:
        run(str(tmp_path / "none.mp4"), *(part for pair in usual.items() for part in pair))
    assert "\n" not in str(caught.value)


def test_what_is_no_picture_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "text.mp4").write_text("no video")
    (tmp_path / "text.png").write_text("no picture")
    for name in ("folder", "text.mp4", "text.png"):
        with pytest.raises(BadInput, match=name):
            list(spread_pictures(tmp_path / name, 3))


@pytest.mark.slow
@pytest.mark.parametrize(("tilt", "told"), [((0.02, -0.05), True), ((0.05, 0.35), False)])
def test_half_a_millimetre_at_two_millimetres_a_pixel(tilt: tuple[float, float], told: bool) -> None:
    camera = over_table(tilt, size=(1280, 800), span=2.6 if told else 2.9)
    place = np.random.default_rng(2).uniform((-0.95, -0.45), (0.95, 0.45), (12, 2))
    still = np.tile([0.0, 0.0, 0.0, 1.0], (2, 12, 1))
    motion = Motion(tuple(f"red_{k}" for k in range(12)), np.array([0.0, 1.0]), np.stack([place, place]), still)
    (picture,) = film.film(camera, motion, np.array([0.5]), LOOK)
    found = calibrated(camera, picture, fov=fov(camera) if told else None)
    assert found.focal_from == ("given" if told else "found")
    assert rms(errors(camera, found)) < 0.5
