"""Where no camera is found, or one that is not to be trusted: what was seen is drawn, and what to type next is said."""

from __future__ import annotations

import dataclasses
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest

from models.shot import Table
from sysid.cli import main
from sysid.vision.camera.pictures.seen_picture import seen_table
from tests.footage.film import Picture
from tests.support.table_views import DIAMETER, over_table, taken

SIZES = ("--length", "2", "--width", "1", "--diameter", "0.0525")
CORNERS = "140,60 500,60 520,340 120,340"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def from_aside() -> Picture:
    """A table of 2 x 1 m seen at 65 degrees off the vertical."""
    camera = over_table((0.0, np.radians(65)), height=3.0)
    return taken(dataclasses.replace(camera, translation=np.array([0.0, 0.0, 3.0])))


def next_command(text: str) -> list[str]:
    """The words of the command that is to be typed next, after its program."""
    (line,) = (line for line in text.splitlines() if line.startswith("next: "))
    return shlex.split(line)[2:]


def test_a_refusal_shows_what_was_seen_and_names_the_next_command(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    grey = np.full((240, 320, 3), 90, np.uint8)
    cv2.imwrite("cam.png", grey)
    words = ["calibrate", "cam.png", *SIZES, "--out", "cam.toml"]
    assert main(words) == 2
    seen = capsys.readouterr()
    assert seen.err.count("\n") == 1 and "no table found" in seen.err
    assert next_command(seen.out) == [*words, "--click"]
    assert np.array_equal(cv2.imread("cam.png"), grey), "it is what was read"
    assert cv2.imread("cam.seen.png").shape[0] > 3 * 240, "the words stand below"
    assert not Path("cam.toml").exists()
    assert main([*words, "--report", "asked.png", f"--corners={CORNERS.replace('500,60', '140,60')}"]) == 2
    assert Path("asked.png").is_file()
    assert next_command(capsys.readouterr().out) == [*words, "--report", "asked.png", "--click"]


def test_a_camera_in_doubt_names_a_command_that_replaces_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cv2.imwrite("grey.png", np.full((400, 640, 3), 90, np.uint8))
    words = ["calibrate", "grey.png", *SIZES, "--out", "cam.toml"]
    assert main([*words, "--corners", CORNERS]) == 1
    told = capsys.readouterr().out
    assert "report: cam.seen.png" in told and Path("cam.seen.png").is_file()
    assert next_command(told) == [*words, "--click", "--overwrite"], "no edge goes with these corners: others"


def test_the_sides_in_view_are_named_where_the_picture_cuts_one_off(
    place: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    cv2.imwrite("cut.png", taken(over_table(aim=(-0.8, 0.0))))
    words = ["calibrate", "cut.png", *SIZES, "--out", "cam.toml"]
    assert main(words) == 2
    assert next_command(capsys.readouterr().out) == [*words, "--sees=+x,+y,-y"]
    turned = seen_table(
        cv2.rotate(taken(over_table(aim=(-0.8, 0.0))), cv2.ROTATE_90_COUNTERCLOCKWISE), Table(2, 1), DIAMETER
    )
    assert turned.cut == ("bottom",) and turned.sides_in_view() == ["+x", "+y", "-y"]


def test_a_view_from_aside_is_said_to_be_one() -> None:
    seen = seen_table(from_aside(), Table(2.0, 1.0), DIAMETER)
    assert len(seen.sides) == len(seen.corners) == 4
    assert "an oblique view" in seen.lines()[-1] and "film from higher up" in seen.lines()[-1]
    above = seen_table(taken(over_table()), Table(2.0, 1.0), DIAMETER)
    assert not any("aside" in line for line in above.lines())


@pytest.mark.parametrize("size", [(1, 1), (1, 40), (3, 3), (30, 20)])
def test_pictures_of_nothing_show_nothing(size: tuple[int, int]) -> None:
    for level in (0, 90, 255):
        picture = np.full((*size, 3), level, np.uint8)
        assert seen_table(picture, Table(2.0, 1.0), DIAMETER).cloth is None
        green = np.tile(np.array([40, 120, 30], np.uint8), (*size, 1))
        assert not seen_table(green, Table(2.0, 1.0), DIAMETER).sides
