"""The `review` verbs: a recording is shown by a viewer that listens to this machine alone, saved, or drawn."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import pytest

import models.recording.viewer as viewer
from models.commands.console import Progress
from models.errors import BadInput
from models.recording.shots import write_review
from models.recording.viewer import own_settings
from planner.cli.verbs import main as planner
from robot.cli.verbs import main as robot
from sysid.cli import main as sysid
from sysid.cli.viewing import Live
from tests.support.reviewed_clips import BALL, TABLE, clip


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The viewer's command lines; its first call ends well, the second does not."""
    calls: list[list[str]] = []

    def pretend(words: list[str], check: bool, env: dict[str, str]) -> subprocess.CompletedProcess[bytes]:
        assert Path(words[1]).is_file()
        assert env["RUST_LOG"] == "warn", "the viewer's own log is not for its user"
        assert env["XDG_CONFIG_HOME"] == "own"
        calls.append(words)
        return subprocess.CompletedProcess(words, len(calls) - 1)

    monkeypatch.setattr("models.recording.viewer.own_settings", lambda: {"XDG_CONFIG_HOME": "own"})
    monkeypatch.setattr("models.recording.viewer.subprocess.run", pretend)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("RUST_LOG", raising=False)
    return calls


def test_a_recording_is_shown_to_this_machine_alone(
    tmp_path: Path, called: list[list[str]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert sysid(["review", str(tmp_path)]) == 2
    assert "review.rrd: no such recording" in capsys.readouterr().err
    (tmp_path / "found").mkdir()
    (tmp_path / "found" / "review.rrd").write_bytes(b"as it is")
    assert sysid(["review", str(tmp_path)]) == 0, "what sysid doctor wrote"
    assert sysid(["review", str(tmp_path / "found" / "review.rrd"), "--web"]) == 1, "the viewer's failure is told"
    for words in called:
        assert words[2:5] == ["--bind", "127.0.0.1", "--port"]
    port, (option, of_page, page) = called[1][5], called[1][6:]
    assert (option, of_page) == ("--web-viewer", "--web-viewer-port")
    told = capsys.readouterr().out
    assert f"http://127.0.0.1:{page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{port}%2Fproxy" in told
    assert not Path(called[0][1]).exists(), "nothing is left behind"


def test_the_viewer_sends_no_usage_data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its settings are its own: those of the user stay as they are."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "users"))
    own = own_settings()
    settings = Path(own["XDG_CONFIG_HOME"]) / "rerun" / "analytics.json"
    assert json.loads(settings.read_text())["analytics_enabled"] is False
    assert not (tmp_path / "users").exists()
    assert own_settings() == own


def test_a_recording_is_saved_as_it_is(tmp_path: Path, called: list[list[str]]) -> None:
    (tmp_path / "review.rrd").write_bytes(b"as it is")
    assert sysid(["review", str(tmp_path), "--save", str(tmp_path / "copy.rrd")]) == 0
    assert (tmp_path / "copy.rrd").read_bytes() == b"as it is"
    assert called == []


@pytest.mark.parametrize("main", [sysid, planner, robot])
def test_what_cannot_be_shown_is_told_before_the_work(
    main: Callable[[list[str]], int], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for words, said in (
        ([], "there is no display (DISPLAY is not set); give --web for a browser, --picture FILE.png or --save FILE"),
        (["--web", "--save", "x.rrd"], "--web and --save exclude each other"),
        (["--web", "--picture", "x.png"], "--web and --picture exclude each other"),
        (["--picture", "x.gif"], "x.gif: name a picture (.png) or a film (.mp4)"),
        (["--save", "nowhere/x.rrd"], "nowhere/x.rrd: its folder does not exist"),
    ):
        assert main(["review", "nothing", *words]) == 2
        told = capsys.readouterr().err.splitlines()
        assert len(told) == 1 and said in told[0]


def test_options_of_a_clip_set_are_refused_for_a_finished_recording(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "review.rrd").write_bytes(b"as it is")
    for more in (["--video", "."], ["--model", "m.toml"]):
        assert sysid(["review", str(tmp_path), *more, "--save", str(tmp_path / "x.rrd")]) == 2
        assert "is finished; for a new one give the clip set" in capsys.readouterr().err


def test_no_viewer_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    monkeypatch.setenv("PATH", "/nowhere")
    with pytest.raises(BadInput, match="not installed; pip install rerun-sdk"):
        viewer.viewer_program()


def test_live_needs_a_display_or_a_browser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(BadInput, match=r"--live: there is no display.*; add --web"), Live(live=True).feed():
        pass
    with pytest.raises(BadInput, match="--web requires --live"), Live(web=True).feed():
        pass
    with Live().feed() as feed:
        assert feed is None


def test_a_viewer_that_does_not_start_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "rerun"
    program.write_text("#!/bin/sh\necho first\necho Error: No graphics adapter was found >&2\necho last\nexit 3\n")
    program.chmod(0o755)
    monkeypatch.setattr(viewer, "viewer_program", lambda: str(program))
    monkeypatch.setenv("DISPLAY", ":0")
    with (
        pytest.raises(BadInput, match=r"--live: the viewer does not start \(Error: No graphics adapter was found\)$"),
        viewer.live_viewer(web=False),
    ):
        pass
    with pytest.raises(BadInput, match=r"x\.png: the viewer does not start .*; on Debian: apt install mesa"):
        viewer.draw_recording(tmp_path / "x.png", tmp_path / "r.rrd", Progress())
    assert not (tmp_path / "x.png").exists()


def test_a_viewer_that_can_open_no_window_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It listens before it tries."""
    program = tmp_path / "rerun"
    program.write_text(
        f"#!{sys.executable}\nimport socket, sys, time\n"
        "server = socket.create_server(('127.0.0.1', int(sys.argv[4])))\ntime.sleep(0.4)\n"
        "sys.exit('Error: no window')\n"
    )
    program.chmod(0o755)
    monkeypatch.setattr(viewer, "viewer_program", lambda: str(program))
    monkeypatch.setenv("DISPLAY", ":0")
    with pytest.raises(BadInput, match=r"does not start \(Error: no window\)$"), viewer.live_viewer(web=False):
        pass


def test_a_page_is_fed_and_its_server_ends_with_the_work(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BROWSER", "true")  # the program that does nothing
    monkeypatch.setenv("PATH", str(tmp_path))
    with viewer.live_viewer(web=True) as feed:
        stream = feed.stream("cuelab_test", "a title", None)
        stream.set_time("shot", sequence=1)
        stream.flush()
        said = capsys.readouterr().out
        ports = [int(feed.url.rpartition(":")[2].split("/")[0]), int(said.split("?")[0].rpartition(":")[2])]
        assert said.startswith("live: http://127.0.0.1:")
        assert viewer._until(lambda: all(map(viewer._listens, ports)), 5.0)
    assert not any(map(viewer._listens, ports))


@pytest.mark.slow
def test_a_recording_is_drawn_without_a_window(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer, "FILM_S", 0.2)
    monkeypatch.setattr(viewer, "SETTLE_S", 0.5)
    write_review(tmp_path / "r.rrd", TABLE, BALL, [clip("one")], title="t")
    try:
        viewer.draw_recording(tmp_path / "x.png", tmp_path / "r.rrd", Progress())
    except BadInput as error:
        pytest.skip(str(error))
    picture = cv2.imread(str(tmp_path / "x.png"))
    assert picture.shape == (900, 1600, 3) and picture.std() > 10
    shutil.copy(tmp_path / "r.rrd", tmp_path / "review.rrd")
    assert sysid(["review", str(tmp_path), "--picture", str(tmp_path / "x.mp4")]) == 0
    film = cv2.VideoCapture(str(tmp_path / "x.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 3 and film.get(cv2.CAP_PROP_FRAME_WIDTH) == 1280
