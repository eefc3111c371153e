"""Strings measured on an emulated launcher: its hidden law comes back, every stroke is retracted, errors stop it."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from planner.launcher.stroke import LauncherModel as Planned
from robot.cli.verbs import main
from robot.device.calibrate import (
    CALIBRATION_STRINGS,
    StringSpeed,
    measure_strings,
    rows,
    speed_table,
    summarise,
    text,
    write_calibration,
)
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.outcome import Done
from robot.device.protocol import LauncherError
from robot.device.settings import Settings, read_settings, write_settings
from robot.emulator.firmware import Firmware
from robot.emulator.line import Line, VirtualClock, WirePort
from robot.emulator.mechanism import ENCODER_SPEED_SD, SPEED_SCATTER
from robot.emulator.stroke_motion import paper_law

OURS = Settings()


def hidden_law(string: int) -> float:
    """Bent as the one that gives '070p' 2.0 m/s, and 3 % slow [m/s]."""
    return 0.97 * (2.75 - 2.45 * ((string - 1) / 199) ** 1.118)


def bench(law: Callable[[int], float] = hidden_law, ripple: float = 0.0, seed: int = 0) -> tuple[Launcher, Firmware]:
    clock = VirtualClock()
    device = Firmware(clock.now, np.random.default_rng(seed), law=law, ripple=ripple)
    line = clock.line = Line(device, baud=OURS.port.baud)
    link = Link(lambda: WirePort(line, clock), OURS.timing, baud=OURS.port.baud, clock=clock)
    return Launcher(OURS, link), device


def done(string: str, cue_speed: float, number: int = 1) -> Done:
    return Done(string, number, 1.0, cue_speed, 300.0, 0.0, 0.0, 0.0, 1.0, 0, ())


def speeds(**measured: float) -> tuple[StringSpeed, ...]:
    return tuple(StringSpeed(int(n[1:]), v, 0.01, 5) for n, v in measured.items())


def test_planner_and_launcher_mean_the_same_strings() -> None:
    planned, ours = Planned(fastest=2.75), OURS.calibration
    for n in range(1, 201):
        assert ours.cue_speed(n) == pytest.approx(planned.cue_speed(n), abs=1e-12)
        assert ours.string(ours.cue_speed(n)) == planned.string(planned.cue_speed(n)) == n
    step = 2.45 / 199
    for v in np.linspace(0.30, 2.75, 1999):
        near = {ours.string(float(v)), planned.string(float(v))}
        assert all(abs(ours.cue_speed(n) - v) <= step / 2 + 1e-9 for n in near)
        assert len(near) == 1 or all(abs(ours.cue_speed(n) - v) > step / 2 - 1e-9 for n in near)  # a tie


def test_every_stroke_is_retracted_and_the_tip_stays_in_the_middle() -> None:
    launcher, device = bench()
    with launcher:
        measured = measure_strings(launcher, ["001p", 100, 200], 3)
    what = [action.what for action in device.actions if action.what not in ("booted", "moved")]
    assert what == ["homed"] + ["begun", "struck", "retracted"] * 9
    struck = [action for action in device.actions if action.what == "struck"]
    assert [action.string for action in struck] == [200, 100, 1] * 3
    assert all(action.x == action.y == 0 for action in struck)
    assert device.status().state == "IDLE"
    assert [(row.string, row.strokes) for row in measured] == [(1, 3), (100, 3), (200, 3)]


def test_the_hidden_law_comes_back() -> None:
    launcher, _ = bench()
    with launcher:
        measured = measure_strings(launcher, CALIBRATION_STRINGS, 8)
    for row in measured:
        assert abs(row.mean - hidden_law(row.string)) < 4.5 * SPEED_SCATTER * hidden_law(row.string) / math.sqrt(8)
    table = speed_table(measured)
    between = np.array([table.cue_speed(n) / hidden_law(n) - 1 for n in range(1, 201)])
    assert np.abs(between).max() < 0.02  # scatter of the means, and straight lines for a bent law
    assert np.abs([OURS.calibration.cue_speed(n) / hidden_law(n) - 1 for n in range(1, 201)]).max() > 0.03


def test_the_scatter_is_the_launchers() -> None:
    launcher, _ = bench()
    with launcher:
        measured = measure_strings(launcher, (60, 140), 60)
    for row in measured:
        assert row.sd == pytest.approx(math.hypot(SPEED_SCATTER, ENCODER_SPEED_SD) * row.mean, rel=0.3)
        assert row.mean_sd == row.sd / math.sqrt(60)


def test_a_calibrated_launcher_plays_the_speeds_asked_for() -> None:
    launcher, _ = bench()
    with launcher:
        table = speed_table(measure_strings(launcher, CALIBRATION_STRINGS, 8))
    new = replace(OURS, calibration=table)
    for wanted in (0.5, 1.1, 1.864, 2.4):
        assert hidden_law(new.calibration.string(wanted)) == pytest.approx(wanted, rel=0.025)


def test_one_stroke_has_no_scatter_to_tell() -> None:
    [row] = summarise([done("047p", 2.1)])
    assert (row.string, row.mean, row.strokes) == (47, 2.1, 1)
    assert math.isnan(row.sd) and math.isnan(row.mean_sd)
    assert rows([row], OURS.calibration)[1][3:5] == ("-", "-")


def test_strokes_make_a_table() -> None:
    shots = [done("100p", 1.5), done("001p", 2.6), done("100p", 1.6), done("200p", 0.31)]
    table = speed_table(summarise(shots))
    assert (table.strings, table.source) == ((1, 100, 200), "4 strokes at 3 strings, measured by the launcher")
    assert table.speeds == pytest.approx((2.6, 1.55, 0.31))


@pytest.mark.parametrize("speed", [math.nan, 0.0, -1.0, math.inf])
def test_a_stroke_without_a_speed_is_no_calibration(speed: float) -> None:
    with pytest.raises(BadInput, match=r"stroke 7 \(100p\)"):
        summarise([done("001p", 2.6), done("100p", speed, 7)])


def test_speeds_that_do_not_fall_are_refused_and_nothing_is_written(tmp_path: Path) -> None:
    out = tmp_path / "new.toml"
    for measured in (speeds(n1=2.7, n50=2.1, n51=2.11, n200=0.3), speeds(n51=2.1, n50=2.1)):
        with pytest.raises(BadInput, match=r"050p was measured at 2\.1 m/s and 051p at 2\.1"):
            write_calibration(None, measured, out)
    with pytest.raises(BadInput, match="two or more"):
        write_calibration(None, speeds(n1=2.7), out)
    assert not out.exists()


def test_the_rest_of_the_file_is_kept(tmp_path: Path) -> None:
    old, new = tmp_path / "old.toml", tmp_path / "new.toml"
    ours = replace(OURS, port=replace(OURS.port, device="/dev/ttyS1"), stage=replace(OURS.stage, zero_x_mm=0.7))
    write_settings(ours, old)
    written = write_calibration(old, speeds(n200=0.31, n1=2.6), new)
    assert read_settings(new) == written == replace(ours, calibration=written.calibration)
    assert written.calibration.strings == (1, 200) and written.calibration.speeds == (2.6, 0.31)
    assert "10 strokes at 2 strings" in written.calibration.source
    assert read_settings(old) == ours
    write_calibration(old, speeds(n1=2.5, n200=0.32), old)
    assert read_settings(old).calibration.speeds == (2.5, 0.32)
    with pytest.raises(BadInput, match="absent"):
        write_calibration(tmp_path / "absent.toml", speeds(n1=2.5, n200=0.32), new)


def test_speeds_beyond_the_limits_are_told() -> None:
    assert "will be refused: 001p, 200p" in text(speeds(n1=2.8, n100=1.5, n200=0.29), OURS)
    assert "refused" not in text(speeds(n1=2.7, n200=0.31), OURS)


@pytest.mark.parametrize("trouble", ["power", "stage", "interrupt", "stop"])
def test_whatever_goes_wrong_stops_the_launcher(trouble: str) -> None:
    launcher, device = bench()
    kind: type[BaseException] = KeyboardInterrupt if trouble == "interrupt" else LauncherError

    def third(line: str) -> None:
        if line.startswith("stroke 3"):
            if trouble == "interrupt":
                raise KeyboardInterrupt
            device.restart() if trouble == "power" else launcher.stop()

    if trouble == "stage":
        device.stick()
    with launcher:
        with pytest.raises(kind):
            measure_strings(launcher, (50, 100, 150), 4, third)
        assert device.status().state == "STOPPED"
    struck = sum(action.what == "struck" for action in device.actions)
    assert struck == (0 if trouble == "stage" else 3)


BAD = {
    "one string": ({"strings": (100,)}, "two or more"),
    "none": ({"strings": ()}, "two or more"),
    "twice": ({"strings": (100, "100p")}, "each once"),
    "no string": ({"strings": (0, 100)}, "three digits"),
    "no repeats": ({"repeats": 0}, "repeats is 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_input_moves_nothing(name: str) -> None:
    change, says = BAD[name]
    launcher, device = bench()
    with launcher, pytest.raises(BadInput, match=says):
        measure_strings(launcher, **change)  # type: ignore[arg-type]
    assert [action.what for action in device.actions] == ["booted"]


def test_strings_beyond_the_limits_and_dry_launchers_measure_nothing() -> None:
    launcher, device = bench()
    launcher.settings = replace(OURS, limits=replace(OURS.limits, cue_speed=(0.3, 2.2)))
    with launcher, pytest.raises(BadInput, match="the limits are"):
        measure_strings(launcher)
    assert [action.what for action in device.actions] == ["booted"]
    with pytest.raises(BadInput, match="dry"):
        measure_strings(Launcher(OURS, None, dry_run=True))


def test_the_command_writes_a_launchers_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out, figures = tmp_path / "new.toml", tmp_path / "f.json"
    words = ["calibrate", "--out", str(out), "--strings", "20", "100", "180", "--repeats", "3", "--json", str(figures)]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert "no --port" in told and "020p" in told and str(out) in told
    table = read_settings(out).calibration
    assert table.strings == (20, 100, 180)
    assert table.speeds == pytest.approx([paper_law(n) for n in table.strings], rel=0.03)
    kept = json.loads(figures.read_text())
    assert [row["strokes"] for row in kept["strings"]] == [3, 3, 3]
    assert [row["mean"] for row in kept["strings"]] == pytest.approx(table.speeds, abs=1e-6)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--strings", "300", "1"], "three digits"),
        (["--settings", "absent.toml"], "absent.toml"),
        (["--out", "nowhere/new.toml"], "nowhere"),
        (["--seed", "-1"], "--seed -1"),
        (["--port", "/dev/null"], "not confirmed"),
    ],
)
def test_the_command_names_bad_input(
    words: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("builtins.input", lambda _: "no")
    assert main(["calibrate", "--out", str(tmp_path / "new.toml"), *words]) == 2
    told = capsys.readouterr().err
    assert says in told and told.startswith("robot calibrate: ") and told.count("\n") == 1
    assert not (tmp_path / "new.toml").exists()
