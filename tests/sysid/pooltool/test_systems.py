"""Systems that pooltool wrote (data/make.py) are read as clips; its own tables come back from ours as they were."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.errors import BadInput
from models.shot import RAIL_NAMES, Ball
from models.table.presets import TABLE_SETS
from sysid.cli import main
from sysid.clips import read_clip_set
from sysid.pooltool.clips import import_pooltool
from sysid.pooltool.document import is_pooltool, write_document
from sysid.pooltool.frame import TableFrame
from sysid.pooltool.table import table_here, table_there

DATA = Path(__file__).with_name("data")
FRAME = TableFrame(1.9812, 0.9906)  # of pooltool's 7 ft table
BALL = Ball(0.05715, 0.170097)
HEIGHTS = dict.fromkeys(RAIL_NAMES, 0.64 * 0.05715)


def truth(name: str) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Times [s], and where pooltool itself puts each ball then, here [m]."""
    data = json.loads((DATA / "truth.json").read_text())
    return np.array(data["times"]), {
        ball: FRAME.place_here(np.array(places)) for ball, places in data["places"][name].items()
    }


def system(name: str = "cut") -> Any:
    return json.loads((DATA / f"{name}.json").read_text())


def written(folder: Path, data: Any) -> Path:
    file = folder / "system.json"
    file.write_text(json.dumps(data))
    return file


@pytest.mark.parametrize("name", ["cut", "rail"])
def test_between_events_balls_are_where_pooltool_has_them(name: str) -> None:
    (clip,) = import_pooltool([DATA / f"{name}.json"], fps=100.0).clip_set.clips
    times, places = truth(name)
    rows = np.rint(100 * times).astype(int)
    for ball, seen in clip.balls.items():
        np.testing.assert_allclose(seen.time[rows], times, atol=1e-9)
        np.testing.assert_allclose(seen.xy[rows], places[ball], atol=1e-9)


def test_a_continued_system_has_its_own_samples_and_ends_where_a_ball_falls() -> None:
    pytest.importorskip("msgpack")
    clip_set = import_pooltool([DATA / "pot.msgpack"]).clip_set
    (clip,) = clip_set.clips
    assert clip_set.fps == pytest.approx(50.0) and clip.struck == "cue"
    times, places = truth("pot")
    row = int(np.flatnonzero(np.isclose(clip.balls["cue"].time, 0.6))[0])
    np.testing.assert_allclose(clip.balls["cue"].xy[row], places["cue"][list(times).index(0.6)], atol=1e-9)
    assert clip.balls["1"].time[-1] == pytest.approx(0.32)  # it falls at 0.335 s
    assert np.all(clip.balls["1"].xy[-1] * [1, -1] > 0.4 * np.array([1.9812, 0.9906]))  # its right top is +x -y here


def test_the_command_is_the_cue_s_and_the_ball_leaves_as_commanded() -> None:
    (clip,) = import_pooltool([DATA / "rail.json"], fps=200.0).clip_set.clips
    assert clip.cue is not None
    assert np.degrees(clip.cue.azimuth) == pytest.approx(10.0 - 90.0)
    assert clip.cue.side == pytest.approx(-0.3 * BALL.radius) and clip.cue.height == pytest.approx(-0.2 * BALL.radius)
    seen = clip.balls["cue"]
    way = seen.xy[1] - seen.xy[0]
    assert np.hypot(*way) * 200.0 == pytest.approx(clip.cue.speed, rel=0.02)
    # Squirt of the left side, to the right here, is a few degrees at most.
    assert abs(np.degrees(np.arctan2(way[1], way[0]) - clip.cue.azimuth)) < 4.0


def test_several_systems_become_a_clip_set_that_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("msgpack")
    out = tmp_path / "clips"
    assert main(["import", str(DATA / "several.msgpack"), "--out", str(out)]) == 0
    found = read_clip_set(out)
    assert [clip.file for clip in found.clips] == ["clips/several_0001.csv", "clips/several_0002.csv"]
    assert found.ball == BALL and found.table.length == pytest.approx(1.9764, abs=1e-4)
    assert "systems of pooltool: 2" in capsys.readouterr().out


@pytest.mark.parametrize("name", list(TABLE_SETS))
def test_tables_come_back_as_they_were(name: str) -> None:
    known = TABLE_SETS[name]
    found, _, remark = table_here(table_there(known.table, known.ball, HEIGHTS), known.ball)
    assert found.length == pytest.approx(known.table.length) and found.width == pytest.approx(known.table.width)
    assert found.shapes == known.table.shapes and bool(found.pockets) == bool(known.table.pockets) and not remark


def test_pooltool_s_own_table_is_written_as_pooltool_has_it() -> None:
    """Noses, arcs and pockets to a micrometre; facings end elsewhere, on the same lines."""
    data = system()["table"]
    table, _, _ = table_here(data, BALL)
    again = table_there(table, BALL, HEIGHTS)
    straight = {"3", "6", "9", "12", "15", "18"}
    for name, one in data["cushion_segments"]["linear"].items():
        ends, new = (np.array([d["p1"], d["p2"]]) for d in (one, again["cushion_segments"]["linear"][name]))
        assert one["direction"] == again["cushion_segments"]["linear"][name]["direction"], name
        if name in straight:
            np.testing.assert_allclose(new, ends, atol=2e-6)
            continue
        way = (ends[1] - ends[0])[:2] / np.hypot(*(ends[1] - ends[0])[:2])
        off = (new[:, :2] - ends[0, :2]) @ np.array([-way[1], way[0]])
        np.testing.assert_allclose(off, 0.0, atol=5e-5)
    for kind, keys in (("circular", ("center", "radius")),):
        for name, one in data["cushion_segments"][kind].items():
            for key in keys:
                np.testing.assert_allclose(again["cushion_segments"][kind][name][key], one[key], atol=3e-6)
    for name, one in data["pockets"].items():
        for key in ("center", "radius"):
            np.testing.assert_allclose(again["pockets"][name][key], one[key], atol=3e-6)


def test_what_is_no_simulated_system_is_refused(tmp_path: Path) -> None:
    still = system()
    for ball in still["balls"].values():
        ball["history"] = {"states": []}
    other = system()
    other["balls"]["1"]["params"]["R"] = 0.026
    lacking = system()
    del lacking["balls"]["cue"]["params"]["R"]
    back = system()
    back["balls"]["1"]["history"]["states"][1]["t"] = -1.0
    bent = system()
    bent["balls"]["1"]["history"]["states"][1]["rvw"] = [[0, 0, 0]]
    gone = system()
    gone["cue"]["cue_ball_id"] = "9"
    for data, word in (
        (still, "not simulated"), (other, "several sizes"), (lacking, "lacks 'R'"), (back, "back in time"),
        (bent, "wrong entry"), (gone, "strikes '9'"), ({"cue": {"id": 1}}, "no pooltool system"),
    ):  # fmt: skip
        with pytest.raises(BadInput, match=word):
            import_pooltool([written(tmp_path, data)])


def test_damaged_messagepack_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("msgpack")
    whole = (DATA / "pot.msgpack").read_bytes()
    for k, damaged in enumerate((whole[:2000], b"", whole + b"\x00", whole.replace(b"<f8", b"|O8"))):
        file = tmp_path / f"{k}.msgpack"
        file.write_bytes(damaged)
        with pytest.raises(BadInput, match=r"MessagePack"):
            import_pooltool([file])


def test_options_that_the_files_answer_and_other_files_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "clips")
    assert main(["import", str(DATA / "cut.json"), "--unit", "mm", "--out", out]) == 2
    assert "--unit" in capsys.readouterr().err
    tracks = tmp_path / "tracks.csv"
    tracks.write_text("t,x,y\n0,0,0\n")
    assert main(["import", str(DATA / "cut.json"), str(tracks), "--out", out]) == 2
    assert "separately" in capsys.readouterr().err
    assert is_pooltool(DATA / "cut.json") and not is_pooltool(tracks)
    with pytest.raises(BadInput, match="use one of these suffixes"):
        write_document({}, tmp_path / "system.toml")
