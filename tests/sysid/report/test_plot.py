"""`sysid plot`: pictures of tracks, of one shot, and of how far models miss it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from models.shot import Track
from sysid.cli.identification.demo import EXAMPLE_FOLDER
from sysid.cli.verbs import main
from sysid.clips import ClipSet, read_clip_set
from sysid.report.pictures.plot import _at, _speeds, shot_png, tracks_png


@pytest.fixture(scope="module")
def example() -> ClipSet:
    return read_clip_set(EXAMPLE_FOLDER)


def pixels(png: bytes) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture


def test_speeds_are_those_of_a_straight_track(example: ClipSet) -> None:
    seen = next(iter(example.clips[0].balls.values()))
    speed = _speeds(seen.time, np.column_stack([0.6 * seen.time, 0.8 * seen.time]))
    assert speed[3:-3] == pytest.approx(1.0)
    assert np.isnan(speed[:3]).all()


def test_a_model_s_places_are_those_at_the_measured_times() -> None:
    times = np.array([0.0, 1.0])
    position = np.array([[[0.0, 0.0]], [[1.0, 2.0]]])
    track = Track(("cue",), times, position, np.zeros((2, 1, 2)), np.zeros((2, 1, 3)), np.zeros((2, 1)), ())
    assert _at(track, "cue", np.array([0.25])) == pytest.approx(np.array([[0.25, 0.5]]))
    assert np.isnan(_at(track, "red", np.array([0.25]))).all()


def test_pictures_are_the_same_bytes_and_differ_by_shot(example: ClipSet) -> None:
    one, other = (shot_png(example.clips[k], example.table, example.ball) for k in (0, 2))
    assert one == shot_png(example.clips[0], example.table, example.ball)
    assert one != other
    assert pixels(tracks_png(example, "all")).shape[1] > 1000


def test_the_verb_draws_all_one_and_the_worst(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = Path(EXAMPLE_FOLDER.parent / "none.toml")
    assert main(["plot", str(EXAMPLE_FOLDER), "--out", str(tmp_path / "all.png")]) == 0
    assert main(["plot", str(EXAMPLE_FOLDER), "--clip", "0003", "--out", str(tmp_path / "one.png")]) == 0
    assert (tmp_path / "all.png").read_bytes() != (tmp_path / "one.png").read_bytes()
    capsys.readouterr()
    for words, said in (
        (["--clip", "99"], "from 1 to 12"),
        (["--clip", "x"], "no clips are called"),
        (["--model", str(model)], "none.toml"),
    ):
        assert main(["plot", str(EXAMPLE_FOLDER), *words, "--out", str(tmp_path / "no.png")]) == 2
        error = capsys.readouterr().err
        assert said in error
        assert error.count("\n") == 1
    assert not (tmp_path / "no.png").exists()
