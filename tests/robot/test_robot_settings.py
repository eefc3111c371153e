"""The launcher's settings: the file, its faults, the calibration, and the stage's geometry."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w
from hypothesis import given
from hypothesis import strategies as st

from models.errors import BadInput
from robot.device import protocol
from robot.device.settings import Settings, SpeedTable, read_settings, write_settings
from robot.emulator import firmware as fw


def test_settings_come_back_as_they_went(tmp_path: Path) -> None:
    path = tmp_path / "launcher.toml"
    ours = Settings(calibration=SpeedTable((1, 90, 200), (2.6, 1.7, 0.33), "60 strokes"))
    ours = replace(ours, port=replace(ours.port, baud=9600))
    write_settings(ours, path)
    assert read_settings(path) == ours


def test_the_shipped_settings_are_the_defaults() -> None:
    assert read_settings(Path(fw.__file__).parents[1].joinpath("launcher.toml")) == Settings()


@given(st.data())
def test_a_calibration_reads_the_same_both_ways(data: st.DataObject) -> None:
    count = data.draw(st.integers(2, 12))
    strings = sorted(data.draw(st.lists(st.integers(1, 200), min_size=count, max_size=count, unique=True)))
    falls = data.draw(st.lists(st.floats(0.01, 0.2), min_size=count, max_size=count))
    table = SpeedTable(tuple(strings), tuple(0.3 + np.cumsum(falls)[::-1]), "")
    for n in range(strings[0], strings[-1] + 1):
        assert table.string(table.cue_speed(n)) == n


def test_the_stage_follows_tilt_and_limits() -> None:
    ours = Settings()
    assert ours.stage_um(0, 0) == (0, 0)
    x, y = ours.stage_um(-6, 10)
    assert (x, y) == (-6000, round(10_000 / math.cos(math.radians(6.5)), -1))
    assert ours.tip_mm(x, y) == pytest.approx((-6, 10), abs=0.01)
    ours.stage_um(0, 0.4999 * 36.25)
    with pytest.raises(BadInput, match="of its radius"):
        ours.stage_um(0, 0.501 * 36.25)
    with pytest.raises(BadInput, match="of its radius"):
        ours.stage_um(math.nan, 0)
    with pytest.raises(BadInput, match="its limits"):
        replace(ours, limits=replace(ours.limits, x_mm=(-5.0, 5.0))).stage_um(6, 0)
    assert ours.check_yaw(350) == pytest.approx(-10)
    with pytest.raises(BadInput, match="yaw"):
        replace(ours, limits=replace(ours.limits, yaw_deg=(-30.0, 30.0))).check_yaw(40)


BAD = {
    "format": ({"format": "x"}, "format = 'x'"),
    "section": ({"prot": {}}, "did you mean 'port'"),
    "no table": ({"port": 3}, r"write \[port\]"),
    "key": ({"port": {"bau": 3}}, "did you mean 'baud'"),
    "baud": ({"port": {"baud": 19200.5}}, "whole number"),
    "device": ({"port": {"device": ""}}, "write the name"),
    "protocol": ({"port": {"protocol": "morse"}}, "write 'cuelab' or 'paper'"),
    "poll": ({"timing": {"poll_s": 0.5}}, "outside 0.001 to 0.1"),
    "bool": ({"timing": {"retries": True}}, "whole number"),
    "bounds": ({"timing": {"reply_s": 1000}}, "outside 0.01 to 10"),
    "nan": ({"limits": {"offset": math.nan}}, "not finite.* 0 to 0.6"),
    "order": ({"limits": {"x_mm": [5, -5]}}, "smaller number first"),
    "pair": ({"limits": {"x_mm": [5]}}, "2 numbers in mm"),
    "count": ({"calibration": {"strings": [1, 2, 3], "speeds": [2, 1]}}, "as many"),
    "rising": ({"calibration": {"strings": [1, 2], "speeds": [1, 2]}}, "fall"),
    "range": ({"calibration": {"strings": [0, 2], "speeds": [2, 1]}}, "rising whole numbers, 1 to 200"),
    "kind": ({"calibration": {"strings": "1", "speeds": [2, 1]}}, "a list of numbers"),
    "missing": ({"calibration": {}}, "strings is missing: add a list of numbers"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_settings_are_named_in_one_line(name: str, tmp_path: Path) -> None:
    data, says = BAD[name]
    path = tmp_path / "launcher.toml"
    path.write_text(tomli_w.dumps({"format": "cuelab-launcher/1"} | data))
    with pytest.raises(BadInput, match=says) as told:
        read_settings(path)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


@pytest.mark.parametrize("string", ["47p", "0047p", "000p", "201p", "p", "²47p", "04.p", 0, 201, -1, True])
def test_strings_that_are_none(string: str | int) -> None:
    with pytest.raises(BadInput, match="three digits"):
        protocol.string_number(string)


def test_speeds_outside_the_calibration_are_refused() -> None:
    ours = Settings(calibration=SpeedTable((20, 180), (2.4, 0.5)))
    with pytest.raises(BadInput, match="020p to 180p"):
        ours.check_speed(10)
    with pytest.raises(BadInput, match=r"calibrated are 0\.5 to 2\.4"):
        ours.calibration.string(0.4)
    with pytest.raises(BadInput, match="the limits are"):
        replace(ours, limits=replace(ours.limits, cue_speed=(0.3, 2.0))).check_speed(20)
