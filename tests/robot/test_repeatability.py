"""Repeated strokes of the emulated launcher: what scatters, by which law, and how far on average."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot.emulator.repeatability as rep
from models.errors import BadInput
from models.shot import Table
from robot.cli.verbs import main
from robot.cueing.repeated import Repeated, mean_scatter, rows, spread_strings, summarised, text
from robot.device.settings import Settings, SpeedTable
from robot.emulator import mechanism
from robot.emulator.repeatability import OPEN_CLOTH, Conditions, measure

OURS = Settings()
PAPER = 0.050  # Robotic Billiards 2015, section V.C [m]


@pytest.fixture
def sure(monkeypatch: pytest.MonkeyPatch) -> None:
    """A launcher whose strokes are all the same."""
    for name in ("SPEED_SCATTER", "REST_SD_M", "ENCODER_SPEED_SD"):
        monkeypatch.setattr(mechanism, name, 0.0)


def test_a_sure_launcher_puts_the_ball_where_it_was(sure: None) -> None:
    for row in measure(OURS, (20, 100, 180), 3, conditions=Conditions(ball_sd=0.0, sigma=0.0)):
        assert row.scatter < 1e-9 and row.within == 1.0
        assert row.cue_speed_sd < 1e-5
        assert (row.ended, row.fell) == (3, 0)


def test_the_same_seed_gives_the_same_strokes() -> None:
    one, same, other = (measure(OURS, (150,), 3, seed) for seed in (1, 1, 2))
    assert one == same != other


def test_the_cloth_changes_no_stroke() -> None:
    on_table, on_open = (
        measure(OURS, (30, 120, 180), 4, 3, conditions=Conditions(cloth=cloth))
        for cloth in (rep.SNOOKER_TABLE, OPEN_CLOTH)
    )
    for ours, free in zip(on_table, on_open, strict=True):
        assert (ours.cue_speed, ours.cue_speed_sd) == (free.cue_speed, free.cue_speed_sd)
        assert ours.run <= free.run + 1e-6
    assert on_table[2].run == pytest.approx(on_open[2].run, abs=1e-3)  # before any cushion it is the same cloth
    assert on_table[2].along_sd == pytest.approx(on_open[2].along_sd, abs=2e-4)
    assert on_table[0].scatter < 0.3 * on_open[0].scatter


def test_on_an_open_cloth_a_run_goes_with_the_square_of_the_speed() -> None:
    slow, fast = measure(OURS, (40, 150), 6, 5, conditions=Conditions(cloth=OPEN_CLOTH))[::-1]
    assert fast.run / slow.run == pytest.approx((fast.cue_speed / slow.cue_speed) ** 2, rel=0.02)
    for row in (slow, fast):
        assert row.along_sd == pytest.approx(2 * row.run * row.cue_speed_sd, rel=0.1)


def test_the_run_of_a_metre_a_second_is_the_published_one() -> None:
    """2.165 V^2 of a ball struck at its centre at V [m/s], by the cloth's published coefficients."""
    [row] = measure(OURS, (143,), 4, conditions=Conditions(ball_sd=0.0, cloth=OPEN_CLOTH))
    ball_speed = 1.366 * math.cos(math.radians(6.5)) * row.cue_speed  # Alciatore TP A.31 with the launcher's cue
    assert row.run == pytest.approx(2.165 * ball_speed**2, rel=0.06)


def test_a_ball_that_lies_to_the_left_is_struck_on_its_right(monkeypatch: pytest.MonkeyPatch, sure: None) -> None:
    seen: list[tuple[float, float]] = []

    class Looked(rep.EmulatedTable):
        def hit(self, cue_speed: float, side: float, height: float) -> None:
            seen.append((float(next(iter(self._places.values()))[1]), side))
            super().hit(cue_speed, side, height)

    monkeypatch.setattr(rep, "EmulatedTable", Looked)
    [still] = measure(OURS, (150,), 6, conditions=Conditions(ball_sd=0.0))
    [moved] = measure(OURS, (150,), 6, conditions=Conditions(ball_sd=1e-3))
    lies, side = np.array(seen).T
    assert np.allclose(lies, side, atol=1e-12) and np.ptp(side) > 1e-3
    assert moved.across_sd > 5e-4 and still.across_sd < 2e-4  # the camera's noise, a tenth of a millimetre


@pytest.mark.slow
def test_the_papers_fifty_millimetres_come_out_roughly() -> None:
    """120 strokes tell their average within some 10 %, and the emulated launcher's is 47 mm."""
    assert mean_scatter(measure(OURS, spread_strings(OURS), 8)) == pytest.approx(PAPER, rel=0.2)


def test_the_strings_span_the_papers_speeds() -> None:
    strings = spread_strings(OURS)
    assert len(strings) == 15 and strings[0] == 1 and strings[-1] == 200
    assert np.ptp(np.diff([OURS.check_speed(n) for n in strings])) < 0.02


def test_a_ball_in_a_pocket_is_counted_and_left_out() -> None:
    told = np.array([1.0, 1.01, 0.99])
    ends = np.array([[0.0, 0.0], [0.06, 0.08], [math.nan, math.nan]])
    row = summarised(100, 1.0, told, ends, np.array([2.0, 2.2, 9.0]))
    assert (row.ended, row.fell, row.run) == (2, 1, pytest.approx(2.1))
    assert (row.along_sd, row.across_sd) == pytest.approx((0.06 / math.sqrt(2), 0.08 / math.sqrt(2)))
    assert row.scatter == pytest.approx(0.1 / math.sqrt(2))
    assert row.within == 1.0  # both 50 mm from their middle
    lost = summarised(100, 1.0, told[:2], np.full((2, 2), math.nan), np.array([1.0, 1.0]))
    assert (lost.ended, lost.fell) == (0, 2) and math.isnan(lost.scatter) and math.isnan(lost.within)
    assert "left out: 1" in text([row]) and "left out" not in text([replace(row, fell=0)])


def test_rows_say_what_was_measured() -> None:
    row = Repeated(47, 2.18, 2.2, 0.011, 6.9, 0.03, 0.04, 0.75, 20, 0)
    head, line = rows([row])
    told = dict(zip(head, line, strict=True))
    assert told["string"] == "047p" and told["scatter mm"] == "50.0" and told["within 50 mm"] == "75 %"
    assert "on average +-50 mm" in text([row])


def test_strings_keep_to_calibration_and_limits() -> None:
    slower = replace(OURS, limits=replace(OURS.limits, cue_speed=(0.5, 2.2)))
    held = [slower.check_speed(n) for n in spread_strings(slower)]
    assert len(held) == 9 and min(held) > 0.5 and max(held) < 2.2
    assert spread_strings(replace(OURS, calibration=SpeedTable((50, 100), (1.9, 1.0))))[0] > 50


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"strings": ()}, "strings is empty"),
        ({"repeats": 1}, "repeats is 1"),
        ({"strings": (100, 0)}, "not calibrated"),
        ({"settings": replace(OURS, limits=replace(OURS.limits, cue_speed=(0.3, 1.0)))}, "the limits are"),
    ],
)
def test_bad_input_is_named_before_a_stroke(change: dict[str, Any], says: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rep, "emulated_launcher", lambda *_: pytest.fail("a launcher was made"))
    with pytest.raises(BadInput, match=says):
        measure(**({"settings": OURS, "strings": (50, 100), "repeats": 3} | change))


def test_a_smaller_table_is_measured_as_well() -> None:
    """The paper's own table is 10 x 5 ft."""
    [row] = measure(OURS, (100,), 3, conditions=Conditions(cloth=Table(3.048, 1.524)))
    assert 2.0 < row.run < 7.0 and row.ended == 3


def test_the_command_prints_and_writes_both_cloths(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "r.json"
    assert main(["repeat", "--strings", "60", "160", "--repeats", "2", "--json", str(out)]) == 0
    told = capsys.readouterr().out
    assert "snooker table" in told and "unlimited cloth" in told and told.count("on average +-") == 2
    kept = json.loads(out.read_text())
    again = measure(OURS, (60, 160), 2)
    assert kept["table"]["mean_scatter_m"] == pytest.approx(mean_scatter(again))
    assert kept["open"]["strings"][0]["run"] > kept["table"]["strings"][0]["run"]
    for words in (["--repeats", "1"], ["--seed", "-1"], ["--settings", "absent.toml"], ["--strings", "300"]):
        assert main(["repeat", *words]) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith("robot repeat: ")
