"""The `robot` command: exit statuses, one-line errors, a launcher at a port, an interrupt that stops it first."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot.cli.play
from models.model_file import write_model
from planner.scene import scene_from, write_scene
from robot.cli import strings as verbs
from robot.cli.first_byte import begin_stop
from robot.cli.verbs import main
from robot.cueing import repeated
from robot.cueing.campaign import CAMPAIGN_COLUMNS
from robot.device import calibrate
from robot.device.past_lock import stop_past_lock
from robot.device.settings import read_settings, write_settings
from robot.emulator.firmware import Firmware
from robot.emulator.launcher import Emulator, Pace
from robot.emulator.paper import PaperFirmware
from robot.order import read_order
from robot.play import played_file
from sysid.clips import read_clip_set
from tests.support.clip_samples import contents
from tests.support.commands import Said, said_by
from tests.support.robot_plans import MODEL, OURS, straight_plan, struck

Run = Callable[..., Said]


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    return straight_plan(tmp_path / "plan.json")


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*words: str | Path) -> Said:
        return said_by(main, words, capsys)

    return call


def test_play_on_the_emulator_from_the_command_line(run: Run, plan: Path, tmp_path: Path) -> None:
    hidden = tmp_path / "hidden.toml"
    write_model(MODEL, hidden)
    said = run("play", plan, "--clips", tmp_path / "set", "--model", hidden, "--seed", 5)
    assert said.status == 0, said
    assert "no --port: using the emulated launcher" in said.out and "object ball: " in said.out
    assert played_file(plan).exists() and len(read_clip_set(tmp_path / "set").clips) == 1


def test_a_dry_run_moves_and_writes_nothing(run: Run, plan: Path, tmp_path: Path) -> None:
    before = contents(tmp_path)
    string = json.loads(plan.read_text())["launcher"]["string"]
    for more in ((), ("--port", "/dev/none")):
        said = run("play", plan, "--dry-run", *more)
        assert said.status == 0, said
        assert f"would send {string}" in said.out and "nothing has moved" in said.out
    assert contents(tmp_path) == before


def test_bad_input_is_one_line_and_status_2(run: Run, plan: Path, tmp_path: Path) -> None:
    moved, settings = tmp_path / "moved.toml", tmp_path / "l.toml"
    data = json.loads(plan.read_text())["scene"]
    data["balls"]["blue"][0] += 0.02
    write_scene(scene_from(data, "test"), moved)
    write_settings(dataclasses.replace(OURS, limits=dataclasses.replace(OURS.limits, cue_speed=(0.3, 0.5))), settings)
    for words, part in (
        (("play", tmp_path / "none.json"), "none.json"),
        (("play", plan, "--scene", moved), "ball blue is 20."),
        (("play", plan, "--settings", settings), "the limits are 0.3 to 0.5"),
        (("play", plan, "--port", "/dev/none"), "cannot be opened"),
        (("play", plan, "--port", "/dev/none", "--clips", "x"), "--clips: the shot is not filmed"),
        (("play", plan, "--seed", "-1"), "--seed -1"),
        (("play", plan, "--fault-rate", "2"), "rate of faults is 2"),
        (("status", "--port", "/dev/none"), "cannot be opened"),
        (("stop", "--port", "/dev/none"), "cannot be opened"),
        (("emulate", "--pace", "0"), "pace is 0"),
        (("emulate", "--fault-rate", "-1"), "--fault-rate -1"),
        (("map", tmp_path / "none.csv", "--out", tmp_path / "m.toml"), "none.csv"),
        (("campaign", tmp_path / "no" / "c.csv"), "its folder does not exist"),
        (("repeat", "--json", tmp_path / "no" / "r.json"), "its folder does not exist"),
        (("calibrate", "--out", tmp_path / "new.toml", "--port", "/dev/none", "--yes"), "cannot be opened"),
        (("learn", "--out", tmp_path / "set", "--every", "3"), "a refit every 3"),
    ):
        before = contents(tmp_path)
        said = run(*words)
        assert said.status == 2, (words, said)
        [line] = said.err.splitlines()
        assert line.startswith(f"robot {words[0]}: ") and part in line, line
        assert contents(tmp_path) == before
    for words in ((), ("plai",), ("status",), ("map", "x.csv"), ("calibrate",), ("learn",)):
        assert run(*words).status == 2


def test_interrupts_end_with_their_own_status(run: Run, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*args: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(robot.cli.play.Emulation, "table", broken)
    said = run("play", plan)
    assert said.status == 130 and "robot play: interrupted" in said.err


def test_a_campaign_is_gone_on_with_and_too_few_shots_make_no_map(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "c.csv"
    assert run("campaign", out, "--most", 2).status == 0
    said = run("campaign", out, "--most", 1)
    assert said.status == 0 and "3 shots" in said.out
    assert out.read_text().splitlines()[0] == ",".join(CAMPAIGN_COLUMNS)
    said = run("map", out, "--out", tmp_path / "map.toml")
    assert said.status == 2 and "robot map: 3 shots" in said.err and not (tmp_path / "map.toml").exists()


@pytest.mark.parametrize("text", ["my notes", "my notes\n", "a,b\n1,2", CAMPAIGN_COLUMNS[0] + "\nrest", "\0"])
def test_a_file_that_is_no_campaign_is_refused_and_left_as_it_is(run: Run, tmp_path: Path, text: str) -> None:
    out = tmp_path / "notes.txt"
    out.write_text(text, encoding="utf-8")
    said = run("campaign", out, "--most", 1)
    assert said.status == 2 and len(said.err.splitlines()) == 1
    assert out.read_text(encoding="utf-8") == text


def test_rows_of_another_seed_are_refused_before_the_torn_one_is_removed(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "c.csv"
    assert run("campaign", out, "--most", 1).status == 0
    whole = out.read_text()
    out.write_text(whole + "17,0.5")
    assert run("campaign", out, "--most", 1, "--seed", 2).status == 2
    assert out.read_text() == whole + "17,0.5"
    assert run("campaign", out, "--most", 1).status == 0
    assert out.read_text().startswith(whole) and len(out.read_text().splitlines()) == 3


@contextlib.contextmanager
def at_a_port() -> Iterator[tuple[str, Firmware]]:
    """A launcher at the end of a pseudo-terminal."""
    clock = Pace(20.0)
    device = Firmware(clock.now, np.random.default_rng(0), pace=clock.factor)
    with Emulator(device, baud=19200) as emulator:
        yield emulator.path, device


def test_single_verbs_at_a_port(run: Run) -> None:
    with at_a_port() as (port, device):
        assert "UNHOMED" in run("status", "--port", port).out
        assert "IDLE" in run("home", "--port", port).out
        assert "stopped, confirmed" in run("stop", "--port", port).out
        assert device.state == "STOPPED"
        said = run("status", "--port", port)
        assert said.status == 1 and "STOPPED" in said.out
        said = run("home", "--port", port)
        assert said.status == 1 and "robot home: " in said.err and "reset" in said.err
        assert run("reset", "--port", port).status == 0
        assert run("home", "--port", port).status == 0


def test_a_held_port_names_its_holder_and_lets_status_and_stop_through(run: Run, tmp_path: Path) -> None:
    words = ["calibrate", "--yes", "--out", str(tmp_path / "new.toml"), "--strings", "100", "200", "--repeats", "100"]
    with at_a_port() as (port, device):
        with subprocess.Popen(
            [sys.executable, "-m", "robot.cli", *words, "--port", port], stderr=subprocess.PIPE, text=True,
            stdout=subprocess.DEVNULL,
        ) as series:  # fmt: skip
            until = time.monotonic() + 30
            while not struck(device) and time.monotonic() < until:
                time.sleep(0.01)
            said = run("status", "--port", port)
            assert said.status == 0 and ", 0 stops" in said.out
            assert f"robot calibrate (process {series.pid}) holds the port, last with" in said.out
            said = run("home", "--port", port)
            [line] = said.err.splitlines()
            assert said.status == 2 and f"robot calibrate (process {series.pid}) holds it" in line
            said = run("stop", "--port", port)
            assert said.status == 0 and "stopped, confirmed" in said.out
            assert f"robot calibrate (process {series.pid}) holds the port, last with" in said.out
            assert series.stderr is not None
            [line] = [text for text in series.stderr.read().splitlines() if text.startswith("robot ")]
            assert "stopped by" in line
        assert series.returncode == 1 and device.state == "STOPPED"
        assert run("status", "--port", port).status == 1 and not (tmp_path / "new.toml").exists()


def test_the_first_byte_of_a_stop_goes_to_a_terminal_and_to_nothing_else(tmp_path: Path) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    with at_a_port() as (port, device):
        for words in (["stop", "--port", port], ["stop", f"--port={port}"]):
            stops = device.memory.stops
            begin_stop(words)
            until = time.monotonic() + 5
            while device.memory.stops == stops and time.monotonic() < until:
                time.sleep(0.01)
            assert device.memory.stops == stops + 1
        for words in (["home", "--port", port], ["stop", "--port", str(notes)], ["stop", "--port"], ["stop"], []):
            begin_stop(words)
        time.sleep(0.1)
        assert device.memory.stops == stops + 1 and notes.read_text() == "mine"


def test_a_stop_while_a_person_is_asked_leaves_nothing_to_strike_with(
    run: Run, plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped(prompt: str) -> str:
        assert stop_past_lock(dataclasses.replace(OURS, port=dataclasses.replace(OURS.port, device=port)))[0].confirmed
        return "yes"

    with at_a_port() as (port, device):
        monkeypatch.setattr("builtins.input", stopped)
        said = run("play", plan, "--port", port)
        [line] = said.err.splitlines()
        assert said.status == 1 and "was stopped by" in line and not struck(device) and device.state == "STOPPED"


def test_a_launcher_of_the_paper_plays_a_plan_after_a_yes_and_nothing_else(
    run: Run, plan: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    clock, settings, new = Pace(20.0), tmp_path / "l.toml", tmp_path / "new.toml"
    device = PaperFirmware(clock.now, np.random.default_rng(0))
    write_settings(dataclasses.replace(OURS, port=dataclasses.replace(OURS.port, protocol="paper")), settings)
    monkeypatch.setattr("builtins.input", lambda prompt: "yes")
    with Emulator(device, baud=19200) as emulator:
        at = ("--port", emulator.path, "--settings", settings)
        for words in (
            ("status",),
            ("home",),
            ("calibrate", "--yes", "--out", new),
            ("play", plan, "--yes"),
        ):
            said = run(*words, *at)
            assert said.status == 2 and len(said.err.splitlines()) == 1 and not struck(device), said
            assert "by hand" in said.err or "accepts only 'NNNp'" in said.err
        said = run("stop", *at)
        assert said.status == 1 and "neither robot stop nor a silent controller stops it" in said.out
        said = run("play", plan, *at)
        assert said.status == 0 and "by hand" in said.out and len(struck(device)) == 1, said
    told = json.loads(played_file(plan).read_text())
    assert told["struck"] == "yes" and told["done"]["cue_speed"] is None


def test_a_port_gets_the_stroke_once_after_a_yes(run: Run, plan: Path, tmp_path: Path, monkeypatch: Any) -> None:
    seen = tmp_path / "seen.toml"
    write_scene(read_order(plan, OURS).scene, seen)
    with at_a_port() as (port, device):
        monkeypatch.setattr("builtins.input", lambda prompt: "no")
        said = run("play", plan, "--port", port, "--scene", seen)
        assert said.status == 2 and "nothing was struck" in said.err and not struck(device)
        assert device.state == "IDLE"
        monkeypatch.setattr("builtins.input", lambda prompt: "yes")
        said = run("play", plan, "--port", port, "--scene", seen)
        assert said.status == 0 and "about to strike" in said.out and len(struck(device)) == 1
        said = run("play", plan, "--port", port, "--yes")
        assert said.status == 0 and "are not checked" in said.out and len(struck(device)) == 2
    told = json.loads(played_file(plan).read_text())
    assert told["struck"] == "yes" and told["potted"] is None and told["clip"] is None


def test_a_port_is_calibrated_after_a_yes(run: Run, tmp_path: Path, monkeypatch: Any) -> None:
    out = tmp_path / "new.toml"
    with at_a_port() as (port, device):
        words = ("calibrate", "--port", port, "--out", out, "--strings", 40, 160, "--repeats", 1)
        monkeypatch.setattr("builtins.input", lambda prompt: "no")
        said = run(*words)
        assert said.status == 2 and "nothing was struck" in said.err and not struck(device) and not out.exists()
        monkeypatch.setattr("builtins.input", lambda prompt: "yes")
        said = run(*words)
        assert said.status == 0 and "about to strike: 2 times without a pause" in said.out
        assert "no --port" not in said.out and len(struck(device)) == 2 and device.state == "IDLE"
    made = read_settings(out)
    assert made.calibration.strings == (40, 160) and made.port.device == OURS.port.device


def test_options_default_to_what_is_measured_without_them() -> None:
    assert verbs.repeat.make_context("repeat", []).params["repeats"] == repeated.DEFAULT_REPEATS
    assert verbs.calibrate.make_context("calibrate", ["--out", "x"]).params["repeats"] == calibrate.DEFAULT_REPEATS


def test_strings_take_several_numbers() -> None:
    for words, strings in (
        (["--strings", "40", "160", "--repeats", "2"], (40, 160)), (["--strings=40", "--strings", "60"], (40, 60)),
    ):  # fmt: skip
        assert verbs.repeat.make_context("repeat", words).params["strings"] == strings


def test_an_interrupt_stops_the_launcher_first(run: Run, plan: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(prompt: str) -> str:
        signal.raise_signal(signal.SIGINT)
        return "yes"

    with at_a_port() as (port, device):
        monkeypatch.setattr("builtins.input", interrupted)
        said = run("play", plan, "--port", port)
        assert said.status == 130 and "the launcher was stopped" in said.err
        assert device.state == "STOPPED" and not struck(device)


def test_emulate_prints_its_port_and_ends_on_an_interrupt() -> None:
    words = [sys.executable, "-m", "robot.cli", "emulate", "--pace", "20"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as served:
        assert served.stdout is not None and served.stderr is not None
        try:
            port = served.stdout.readline().strip()
            assert main(["home", "--port", port]) == 0
        finally:
            served.send_signal(signal.SIGINT)
            try:
                _, err = served.communicate(timeout=10)
            finally:
                served.kill()  # or leaving would wait for ever
        assert served.returncode == 0 and err == ""
        assert not Path(port).exists()
