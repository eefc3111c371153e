"""A scene from a picture ends with a scene or with one line that says what to do, whatever the picture."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from planner.cli import main
from sysid.vision import read_camera
from tests.fuzz.verbs import SEEDS

WIDE, HIGH = read_camera(SEEDS / "camera.toml").size
GREEN = np.tile(np.array([40, 120, 30], np.uint8), (HIGH, WIDE, 1))
PICTURES = {
    "grey": np.full((HIGH, WIDE), 90, np.uint8),
    "black": np.zeros((HIGH, WIDE, 3), np.uint8),
    "deep": np.full((HIGH, WIDE, 3), 40000, np.uint16),
    "noise": np.random.default_rng(0).integers(0, 255, (HIGH, WIDE, 3)).astype(np.uint8),
    "cloth": GREEN,
    "one": np.zeros((1, 1, 3), np.uint8),
    "other size": np.zeros((HIGH, WIDE + 2, 3), np.uint8),
}


def said(source: str, capsys: pytest.CaptureFixture[str]) -> str:
    """The one line about a picture that gives no scene."""
    words = ["scene", source, "--camera", str(SEEDS / "camera.toml"), "--object", "red", "--out", "new.toml"]
    words.append("--quiet")
    assert main(words) == 2
    error = capsys.readouterr().err
    assert error.startswith("planner scene: ") and error.count("\n") == 1
    return error


@pytest.mark.parametrize("name", PICTURES)
def test_a_picture_without_balls(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    cv2.imwrite("a.png", PICTURES[name])
    told = said("a.png", capsys)
    assert ("calibrate with pictures of this size" if name in ("one", "other size") else "no ball is seen") in told


def test_a_film_without_balls(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    film = cv2.VideoWriter("a.avi", cv2.VideoWriter.fourcc(*"FFV1"), 30, (WIDE, HIGH))
    for _ in range(9):
        film.write(GREEN)
    film.release()
    assert "no ball is seen" in said("a.avi", capsys)
    whole = Path("a.avi").read_bytes()
    Path("a.avi").write_bytes(whole[:200])
    assert "is not a readable video" in said("a.avi", capsys)
