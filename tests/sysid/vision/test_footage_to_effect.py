"""End to end: shots of a table with a hidden effect are filmed, tracked and given to discover."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from sysid import cli
from sysid.clips import read_clip_set
from sysid.vision.camera.projection import read_camera
from tests.footage.__main__ import main as film
from tests.footage.score import score
from tests.truth.__main__ import main as generate

SHOTS = ("--clips", "6", "--seconds", "1.2", "--fps", "60", "--length", "1.1", "--width", "0.6", "--no-cue", "--open")


@pytest.mark.slow
def test_a_hidden_effect_is_found_in_footage(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    played, video, camera = tmp_path / "played", tmp_path / "film.mkv", tmp_path / "film.camera.toml"
    kinds = ("--kind", "roll,stun,follow")
    assert generate([str(played), "--seed", "5", *SHOTS, *kinds, "--effect", "table_tilt=0.002,-0.003"]) == 0
    assert film([str(played), str(video), "--size", "520x320"]) == 0
    tracked, told = tmp_path / "tracked", tmp_path / "track.json"
    words = ("track", str(video), "--camera", str(camera), "--out", str(tracked), "--json", str(told))
    assert cli.main([*words]) == 0
    found = score(played, told, tracked, camera)
    assert found.clips == found.shots
    assert found.lost == found.swapped == 0
    free = np.concatenate(found.free)
    error = float(np.sqrt(np.mean(free**2)))
    assert error < 0.15
    lens = read_camera(camera)
    scale = lens.radius / float(lens.radius_px(np.zeros((1, 2)))[0])  # of a pixel on the table [m]
    assert read_clip_set(tracked).sigma == pytest.approx(error * scale, rel=0.4)
    assert np.median(np.abs(found.speed)) < 0.01
    assert np.degrees(np.median(np.abs(found.azimuth))) < 0.1
    capsys.readouterr()
    assert cli.main(["discover", str(tracked), "--out", str(tmp_path / "out")]) in (0, 1)
    outcome = json.loads((tmp_path / "out" / "result.json").read_text())
    assert outcome["verdict"] == ["table_tilt"]
    assert outcome["parameters"]["table_tilt.slope_y"]["value"] == pytest.approx(-0.003, rel=0.1)
