"""The Python interface: names load lazily, results are those of the commands."""

from __future__ import annotations

import dataclasses
import importlib
import json
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import models
import planner
import sysid
import sysid.vision
from models.messages import OptionError, option
from models.report.sheet import Presented, Sheet
from sysid.cli.identification.demo import EXAMPLE_FOLDER
from sysid.foreign.columns import named
from sysid.vision import write_camera
from tests.architecture.source import ROOT
from tests.footage.cameras import overhead


@pytest.mark.parametrize("package", [models, sysid, sysid.vision, planner], ids=lambda p: str(p.__name__))
def test_every_public_name_is_there(package: object) -> None:
    module = importlib.import_module(str(getattr(package, "__name__", "")))
    names = module.__all__
    assert sorted(names) == dir(module)
    for name in names:
        assert getattr(module, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        _ = module.nothing


def test_importing_loads_and_compiles_nothing() -> None:
    """Nor does a command that only helps."""
    heavy = "print([m for m in ('numpy', 'numba', 'mujoco', 'cv2') if m in sys.modules])"
    code = f"import sys, models, sysid, sysid.cli, sysid.vision, planner.cli, robot.cli; {heavy}"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_a_shot_in_three_lines() -> None:
    model = models.full_model(models.Table(2.84, 1.42), models.Ball(0.0615, 0.21))
    shot = models.Shot(("white",), np.zeros((1, 2)), np.array([[1.0, 0.0]]), np.zeros((1, 3)), np.linspace(0.0, 0.5, 6))
    track = models.simulate(model, [shot])[0]
    assert 0.5 * 5 / 7 < track.position[-1, 0, 0] < 0.5  # it slides into rolling, and slows a little


def test_a_fit_has_blas_on_one_thread_and_leaves_its_user_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    """What it computes must not depend on how many cores there are."""
    room = importlib.import_module("sysid.estimation.clip_fit")
    seen = list[set[int]]()

    def threads() -> set[int]:
        return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}

    class Counted(Exception):
        """Threads were counted."""

    def count(*_: object) -> None:
        seen.append(threads())
        raise Counted

    monkeypatch.setattr(room, "split", count)
    clips = sysid.read_clips(EXAMPLE_FOLDER)
    with threadpool_limits(2, "blas"):
        with pytest.raises(Counted):
            sysid.fit(clips)
        assert seen == [{1}] and threads() == {2}


@pytest.mark.slow
def test_a_fit_from_python_is_that_of_the_command(tmp_path: Path) -> None:
    clips = sysid.read_clips(EXAMPLE_FOLDER)
    fitted = sysid.fit(clips)
    out, figures = tmp_path / "m.toml", tmp_path / "fit.json"
    words = [sys.executable, "-m", "sysid.cli", "fit", str(EXAMPLE_FOLDER), "--out", str(out), "--json", str(figures)]
    subprocess.run(words, cwd=ROOT, capture_output=True, check=False)
    constants = json.loads(figures.read_text())["parameters"]
    assert {n: c["value"] for n, c in constants.items()} == {n: value for n, (value, _) in fitted.constants.items()}
    assert models.load_model(out).parameters() == fitted.model.parameters()
    comparison = fitted.comparison
    assert comparison.plot().svg.startswith("<?xml")
    assert len(comparison.samples.time) > 1000
    assert len(comparison.clips) == len(clips.clips)
    names = list(fitted.constants)
    assert "95 % interval" in str(fitted) and all(name in str(fitted) for name in names)
    assert "<th>95 % interval</th>" in fitted._repr_html_()
    assert repr(fitted) == str(fitted), "the prompt shows the table, not the arrays"
    assert list(fitted.sheet().columns["constant"]) == names
    low, high = (fitted.sheet().columns[k][0] for k in ("low", "high"))
    assert low < fitted.constants[names[0]][0] < high
    assert "Worst clips" in str(comparison)
    assert len(comparison.sheet().columns["file"]) == len(clips.clips)
    with pytest.raises(dataclasses.FrozenInstanceError):
        fitted.clips = clips  # type: ignore[misc]
    track = models.simulate(fitted, speed=1.0, azimuth=0.2)
    assert np.array_equal(track.position, models.simulate(fitted.model, speed=1.0, azimuth=0.2).position)


def test_a_stroke_is_played_until_all_balls_rest() -> None:
    model = models.full_model(models.Table(2.84, 1.42, pockets=False), models.Ball(0.0615, 0.21))
    track = models.simulate(model, speed=0.8, azimuth=0.1, side=0.01, balls={"white": (-0.9, 0.0), "red": (-0.3, 0.06)})
    assert track.names == ("white", "red")
    assert track.velocity[0, 0] == pytest.approx([0.8 * np.cos(0.1), 0.8 * np.sin(0.1)])
    assert track.spin[0, 0, 2] == pytest.approx(2.5 * 0.01 * 0.8 / model.ball.radius**2)
    assert np.abs(track.velocity[-1]).max() == 0.0 < np.abs(track.velocity[-3]).max()
    assert "white" in str(track) and "red" in str(track)
    assert track.plot().svg.startswith("<?xml") and "</svg>" in track.plot()._repr_svg_()
    assert '<svg style="max-width:100%;height:auto" ' in track.plot()._repr_svg_(), "no wider than a notebook's column"
    columns = track.sheet().columns
    assert len(columns["x"]) == 2 * len(track.times) and columns["x"][len(track.times)] == -0.3
    resting = models.simulate(model, speed=0.0)
    assert len(resting.times) == 1
    with pytest.raises(TypeError, match="sped"):
        models.simulate(model, sped=1.0)


MODEL = models.full_model(models.Table(2.84, 1.42, pockets=False), models.Ball(0.0615, 0.21))


def test_what_is_struck_is_what_is_said() -> None:
    balls = {"red": (0.3, 0.1), "white": (-0.6, 0.0)}
    for struck, moves in ((None, "white"), ("red", "red")):
        track = models.simulate(MODEL, speed=0.5, azimuth=1.5, balls=balls, struck=struck)
        assert track.names[0] == moves and np.hypot(*track.velocity[0, 0]) == pytest.approx(0.5)
    with pytest.raises(models.BadInput, match="did you mean 'white'"):
        models.simulate(MODEL, speed=0.5, balls=balls, struck="whte")
    with pytest.raises(models.BadInput, match=r"has only 'red', which is not a cue ball: .* struck='red'"):
        models.simulate(MODEL, speed=0.5, balls={"red": (0.3, 0.1)})
    with pytest.raises(models.BadInput, match="none of the balls 'red', 'blue' is called cue or white"):
        models.simulate(MODEL, speed=0.5, balls={"red": (0.3, 0.1), "blue": (0.6, 0.1)})


def test_an_inclined_cue_makes_a_ball_swerve() -> None:
    """To the side that is struck, as sidespin then turns about the way as well; a level one leaves it straight."""
    level, right, left = (
        models.simulate(MODEL, speed=1.5, side=side, elevation=up).position[-1, 0]
        for side, up in ((0.01, 0.0), (0.01, 0.3), (-0.01, 0.3))
    )
    assert abs(level[1]) < 1e-9 and right[1] < -0.01 and left[1] == pytest.approx(-right[1])


@pytest.mark.parametrize(
    ("change", "says"),
    [({"speed": 400.0}, "speed is 400 m/s: give 0 to 30"), ({"speed": -1.0}, "give 0 to 30"),
     ({"balls": {"white": (5.0, 0.0)}}, r"ball 'white' at 5, 0 m is not on the table: give x within \+-1\.392 m"),
     ({"balls": {"white": (0.0,)}}, r"ball 'white' at \(0\.0,\): give x, y"),
     ({"balls": {"white": (0.0, 0.0), "red": (0.05, 0.0)}}, "balls 'white' and 'red' overlap: place them 0.0615 m"),
     ({"side": 10.0}, "misses the ball"), ({"elevation": 17.0}, "elevation is 17 rad"),
     ({"azimuth": np.nan}, "finite")],
)  # fmt: skip
def test_strokes_beyond_reason_are_refused(change: dict[str, Any], says: str) -> None:
    with pytest.raises(models.BadInput, match=says):
        models.simulate(MODEL, **({"speed": 1.0} | change))


def test_constants_and_speeds_beyond_their_bounds_are_refused() -> None:
    shot = models.Shot(("cue",), np.zeros((1, 2)), np.array([[400.0, 0.0]]), np.zeros((1, 3)), np.linspace(0, 0.1, 3))
    with pytest.raises(models.BadInput, match="shot 0: a ball has 400 m/s"):
        models.simulate(MODEL, [shot])
    with pytest.raises(models.BadInput, match=r"ball_impact.restitution is 1.7: give 0.5 to 1"):
        models.simulate(MODEL.with_values({"ball_impact.restitution": 1.7}), speed=1.0)


def test_a_path_in_place_of_clips_or_a_model_is_refused_with_what_reads_it() -> None:
    clips: Any = "clips"
    with pytest.raises(models.BadInput, match=r"clips is 'clips': give a clip set, such as sysid\.read_clips"):
        sysid.fit(clips)
    with pytest.raises(models.BadInput, match=r"model is 'm.toml': give a model, such as models\.load_model"):
        sysid.compare(sysid.read_clips(EXAMPLE_FOLDER), clips.replace("clips", "m.toml"))


def test_results_show_themselves_in_a_line_or_a_short_table() -> None:
    clips, track = sysid.read_clips(EXAMPLE_FOLDER), models.simulate(MODEL, speed=1.0)
    shot = models.Shot(("cue",), np.zeros((1, 2)), np.zeros((1, 2)), np.zeros((1, 3)), np.linspace(0, 9, 999))
    scene = planner.read_scene(ROOT / "planner" / "example.toml")
    assert repr(scene) == "<Scene of white, red, black: red into the pocket corner +x +y>"
    for one in (MODEL, clips, clips.clips[0], clips.clips[0].balls, shot, MODEL.add("speed_drag")):
        assert len(repr(one)) < 200 and "\n" not in repr(one)
    assert len(repr(track).splitlines()) < 5
    assert MODEL.add("speed_drag").effects[-1].name() == "speed_drag"


def test_pictures_are_saved_as_their_names_say(tmp_path: Path) -> None:
    picture = models.simulate(MODEL, speed=0.3).plot()
    picture.save(tmp_path / "a.png")
    picture.save(tmp_path / "a.svg")
    assert (tmp_path / "a.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "a.svg").read_bytes().startswith(b"<?xml")
    with pytest.raises(models.BadInput, match=r"ends in \.svg or \.png"):
        picture.save(tmp_path / "a.jpg")


def test_tracks_of_other_programs_are_read_as_by_the_command(tmp_path: Path) -> None:
    rows = [f"{k / 60:.5f},cue,{-1.0 + 0.03 * k:.4f},{0.1 + 0.01 * k:.4f}" for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["t,ball,x,y", *rows]) + "\n")
    clips = sysid.import_tracks(tmp_path / "a.csv", "snooker")
    assert clips.clips[0].balls["cue"].xy[-1] == pytest.approx([0.17, 0.49])
    with pytest.raises(models.BadInput, match="origin = 'middle': give 'centre' or 'corner'"):
        sysid.import_tracks(tmp_path / "a.csv", "snooker", origin="middle")
    with pytest.raises(TypeError, match=r"import_tracks has no argument 'frames'; it has .*fps"):
        sysid.import_tracks(tmp_path / "a.csv", "snooker", frames=60)
    pandas = pytest.importorskip("pandas")
    frame = clips.frame()
    assert isinstance(frame, pandas.DataFrame) and list(frame) == ["clip", "ball", "time", "x", "y", "theta"]
    assert len(frame) == len(clips.clips[0].balls["cue"].time)


def test_an_import_says_what_it_assumes_and_asks_for_arguments(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As the command does, but for arguments in place of options."""
    rows = [f"{k},cue,{500 + 9 * k},{300 + 3 * k}" for k in range(40)]
    (tmp_path / "a.csv").write_text("\n".join(["frame,ball,x,y", *rows]) + "\n")
    with pytest.raises(models.BadInput, match=r"times count frames: give the frame rate with fps=F$"):
        sysid.import_tracks(tmp_path / "a.csv", "snooker")
    with pytest.raises(models.BadInput, match=r"state it with .*; if they are pixels, give camera=.CAM\.toml. \("):
        sysid.import_tracks(tmp_path / "a.csv", "snooker", fps=60.0)
    camera = overhead(models.Table(3.569, 1.778), 0.0525, (1920, 1080), 3.0, 4.0)
    write_camera(tmp_path / "cam.toml", camera)
    capsys.readouterr()
    sysid.import_tracks(tmp_path / "a.csv", camera=tmp_path / "cam.toml", fps=60.0)
    assert "assumed: y is taken to point down" in (said := capsys.readouterr().err) and 'give y="up"' in said
    with pytest.raises(models.BadInput, match=r"^unit: the camera's file determines this"):
        sysid.import_tracks(tmp_path / "a.csv", camera=tmp_path / "cam.toml", fps=60.0, unit="mm")


def test_a_message_names_options_and_arguments() -> None:
    parts = ("state it with ", option("x_along", "length", "width"), ", or ", named(t="NAME", ball="NAME"))
    with pytest.raises(models.BadInput) as caught:
        raise OptionError(*parts, "; correct ", option("table"))
    assert str(caught.value) == ("state it with --x-along length|width, or --columns t=NAME,ball=NAME; correct --table")
    assert isinstance(again := pickle.loads(pickle.dumps(caught.value)), OptionError), "from another process"
    assert again.message.for_python() == (
        'state it with x_along="length"|"width", or columns={"t": "NAME", "ball": "NAME"}; correct table'
    )


def test_tracking_asks_for_arguments(tmp_path: Path) -> None:
    write_camera(tmp_path / "cam.toml", overhead(models.Table(3.569, 1.778), 0.0525, (64, 48), 3.0, 4.0))
    for number in range(2):
        cv2.imwrite(str(tmp_path / f"{number}.png"), np.zeros((48, 64, 3), np.uint8))
    with pytest.raises(models.BadInput, match="or give their frame rate with fps"):
        sysid.track(tmp_path, tmp_path / "cam.toml")
    with pytest.raises(models.BadInput, match="fps is -1: give the number of frames"):
        sysid.track(tmp_path, tmp_path / "cam.toml", fps=-1)


def test_data_frames_are_of_what_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    sheet = Sheet({"a": [1.0, 2.0]}, ("a",), (("1",),), ("of <two>",))

    class Two(Presented):
        def sheet(self) -> Sheet:
            return sheet

    assert str(Two()) == "of <two>\na\n1"
    assert "of &lt;two&gt;" in Two()._repr_html_()
    monkeypatch.setattr("models.report.sheet.find_spec", lambda name: None)
    with pytest.raises(models.BadInput, match="pip install pandas"):
        Two().frame()
    monkeypatch.undo()
    pandas = pytest.importorskip("pandas")
    assert isinstance(Two().frame(), pandas.DataFrame)
    assert list(Two().frame()["a"]) == [1.0, 2.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param("find_a_hidden_effect", marks=pytest.mark.thorough), "write_an_effect"]
)  # of the first, test_the_python_of_the_pages_runs shows as much
def test_the_notebooks_run(name: str) -> None:
    nbclient = pytest.importorskip("nbclient", reason="notebooks run with nbclient and ipykernel")
    pytest.importorskip("ipykernel", reason="notebooks run with nbclient and ipykernel")
    import nbformat

    folder = ROOT / "docs" / "notebooks"
    book = nbformat.read(folder / f"{name}.ipynb", as_version=4)
    kept = [cell.get("outputs") for cell in book.cells if cell.cell_type == "code"]
    assert any(kept), "it shows what comes out, where nothing is run"
    client = nbclient.NotebookClient(book, timeout=120, kernel_name="python3", resources={"metadata": {"path": folder}})
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(ROOT))
        client.execute()
    shown = [out for cell in book.cells for out in cell.get("outputs", ()) if "data" in out]
    assert any("text/html" in out["data"] for out in shown)
