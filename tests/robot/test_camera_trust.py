"""A camera that is not to be trusted is told by every command that goes by it, and stops what moves a launcher."""

from __future__ import annotations

import functools
import json
import shutil
from pathlib import Path

import pytest

import planner.cli
import planner.planning
import robot.cli
import sysid
import sysid.cli
from models.errors import BadInput
from planner.cli.view import GivenStroke, Shown, setup
from planner.scene import read_scene
from sysid.clips import read_clip_set, write_clip_set
from sysid.clips.trust import camera_doubts, with_doubts
from sysid.vision.camera.projection import read_camera, write_camera
from tests.fuzz.verbs import SEEDS
from tests.support.quick_plans import QUICK

DOUBT = "edges 40 mm farther in do not fit the table's proportions"
TOLD = f"cam.toml: the camera is not to be trusted: {DOUBT}"
REMEDY = "continue with --accept-camera"
SEEN = ("--camera", "cam.toml", "--palette", "palette.toml")


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The inputs of tests/fuzz, with the camera in doubt as cam.toml, in the working folder."""
    shutil.copytree(SEEDS, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    Path("cam.toml").write_text(f'trusted = false\ndoubts = ["{DOUBT}"]\n' + Path("camera.toml").read_text())
    return tmp_path


def test_doubts_are_fields_of_the_file(place: Path) -> None:
    camera = read_camera("cam.toml")
    assert not camera.trusted and camera.doubts == (DOUBT,)
    write_camera("again.toml", camera)
    assert "trusted = false" in Path("again.toml").read_text() and read_camera("again.toml").doubts == (DOUBT,)
    write_camera("sure.toml", read_camera("camera.toml"))
    assert "trusted = true" in Path("sure.toml").read_text() and read_camera("sure.toml").trusted


def test_files_of_earlier_versions_tell_it_in_their_source(place: Path) -> None:
    text = Path("camera.toml").read_text()
    assert read_camera("camera.toml").trusted
    Path("old.toml").write_text(
        text.replace('source = ""', 'source = "4 cushion lines, from a.mp4; not to be trusted"')
    )
    assert read_camera("old.toml").doubts == ("its file does not say why",)
    Path("bare.toml").write_text("trusted = false\n" + text)
    assert not read_camera("bare.toml").trusted
    Path("both.toml").write_text('trusted = true\ndoubts = ["a"]\n' + text)
    with pytest.raises(BadInput, match="remove one of the two"):
        read_camera("both.toml")


def test_tracking_tells_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    sysid.cli.main(["track", "film.avi", *SEEN, "--out", "tracked"])
    assert f"warning: {TOLD}\n" in capsys.readouterr().err


def test_clips_that_were_seen_by_it_tell_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_clip_set(with_doubts(read_clip_set("clips"), (DOUBT,)), "tracked")
    assert camera_doubts(read_clip_set("tracked")) == (DOUBT,)
    told = f"warning: clips.toml: the camera is not to be trusted: {DOUBT}\n"
    sysid.cli.main(["check", "tracked"])
    assert told in capsys.readouterr().out
    sysid.cli.main(["measure", "tracked"])
    assert told in capsys.readouterr().err
    words = ["scene", "tracked", "--clip", "3", "--cue", "cue", "--object", "red", "--out", "new.toml"]
    assert planner.cli.main(words) == 2
    assert f"planner scene: tracked: the camera is not to be trusted: {DOUBT}: calibrate" in capsys.readouterr().err
    assert planner.cli.main([*words, "--accept-camera"]) == 0 and read_scene("new.toml").camera_doubts == (DOUBT,)


def write_pixels() -> None:
    """A ball that rolls, in pixels of the camera, as pixels.csv."""
    camera, rows = read_camera("cam.toml"), ["t,ball,x,y"]
    for k in range(60):
        x, y = camera.outline([[-0.4 + 0.01 * max(k - 5, 0), 0.1]])[0]
        rows.append(f"{k / 60:.4f},white,{x:.2f},{y:.2f}")
    Path("pixels.csv").write_text("\n".join(rows) + "\n")


def test_imported_pixels_tell_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_pixels()
    sysid.cli.main(["import", "pixels.csv", "--camera", "cam.toml", "--y", "down", "--fps", "60", "--out", "imported"])
    assert f"warning: {TOLD}\n" in capsys.readouterr().err
    assert camera_doubts(read_clip_set("imported")) == (DOUBT,)


def test_functions_tell_it_and_carry_it_as_commands_do(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_pixels()
    clips = sysid.import_tracks("pixels.csv", camera="cam.toml", y="down", fps=60.0)
    assert camera_doubts(clips) == (DOUBT,) and f"warning: {TOLD}\n" in capsys.readouterr().err
    with pytest.raises(BadInput):  # no shot is in it
        sysid.track("film.avi", "cam.toml")
    said = capsys.readouterr().err
    assert f"warning: {TOLD}\n" in said and " ball of this size: give the true one with mass\n" in said


def test_views_tell_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_clip_set(with_doubts(read_clip_set("clips"), (DOUBT,)), "tracked")
    assert sysid.cli.main(["review", "tracked", "--save", "a.rrd"]) == 0
    assert f"warning: tracked: the camera is not to be trusted: {DOUBT}\n" in capsys.readouterr().err
    Path("new.toml").write_text(f'camera_doubts = ["{DOUBT}"]\n' + Path("scene.toml").read_text())
    plan = json.loads(Path("plan.json").read_text())
    plan["scene"]["camera_doubts"] = [DOUBT]
    Path("new.json").write_text(json.dumps(plan))
    for source in ("tracked", "new.toml", "new.json"):
        setup(Shown(Path(source)), GivenStroke())
        assert f"warning: {source}: the camera is not to be trusted: {DOUBT}\n" in capsys.readouterr().err
    assert planner.cli.main(["review", "new.json", "--save", "b.rrd"]) == 0
    assert f"warning: new.json: the camera is not to be trusted: {DOUBT}\n" in capsys.readouterr().err


def test_a_scene_for_a_plan_is_refused_before_the_work(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copy("pictures/0000.png", "picture.png")
    words = ["scene", "picture.png", "--camera", "cam.toml", "--object", "red", "--out", "new.toml"]
    assert planner.cli.main(words) == 2
    assert capsys.readouterr().err == f"planner scene: {TOLD}: calibrate it again, or {REMEDY}\n"
    planner.cli.main([*words, "--accept-camera"])  # there are no balls in it
    error = capsys.readouterr().err
    assert f"warning: {TOLD}\n" in error and "no ball is seen" in error


def test_a_plan_tells_what_its_scene_carries(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(planner.planning, "make_plan", functools.partial(planner.planning.make_plan, effort=QUICK))
    Path("new.toml").write_text(f'camera_doubts = ["{DOUBT}"]\n' + Path("scene.toml").read_text())
    planner.cli.main(["plan", "new.toml", "--model", "model.toml", "--out", "new.json"])
    assert f"warning: new.toml: the camera is not to be trusted: {DOUBT}\n" in capsys.readouterr().err
    assert json.loads(Path("new.json").read_text())["scene"]["camera_doubts"] == [DOUBT]


def test_a_launcher_does_not_move_by_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    filming = ["--camera", "cam.toml", "--video", "film.avi"]
    at_port = ["--port", "nowhere", *filming, "--yes"]
    for words in (
        ["align", *filming, "--plan", "plan.json"],
        ["play", "plan.json", *at_port],
        ["learn", "--out", "series", *at_port],
        ["campaign", "shots.csv", *at_port],
        ["repeat", *at_port],
    ):
        assert robot.cli.main(words) == 2
        assert f"{TOLD}: calibrate it again, or {REMEDY}\n" in capsys.readouterr().err
    assert robot.cli.main(["align", *filming, "--plan", "plan.json", "--accept-camera"]) == 2  # no cue is in that film
    error = capsys.readouterr().err
    assert f"warning: {TOLD}\n" in error and REMEDY not in error


def test_a_plan_by_it_does_not_move_a_launcher(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    plan = json.loads(Path("plan.json").read_text())
    plan["scene"]["camera_doubts"] = [DOUBT]
    Path("doubted.json").write_text(json.dumps(plan))
    words = ["play", "doubted.json", "--settings", "launcher.toml"]
    assert robot.cli.main([*words, "--port", "nowhere", "--yes"]) == 2
    assert f"doubted.json: the camera is not to be trusted: {DOUBT}: calibrate" in capsys.readouterr().err
    assert robot.cli.main([*words, "--dry-run"]) == 0
    assert "warning: doubted.json: the camera is not to be trusted" in capsys.readouterr().err


def test_doctor_does_not_go_on_with_it(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    Path("all").mkdir()
    shutil.copy("cam.toml", "all/camera.toml")
    words = ["doctor", "film.avi", "--table", "1.881x0.943", "--diameter", "0.0615", "--palette", "palette.toml"]
    assert sysid.cli.main([*words, "--out", "all"]) == 1
    assert f"stopped: all/{TOLD.replace('cam', 'camera', 1)}; delete it" in capsys.readouterr().out
    sysid.cli.main([*words, "--out", "all", "--accept-camera"])
    assert "$ sysid track" in capsys.readouterr().out
