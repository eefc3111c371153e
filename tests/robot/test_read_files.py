"""Every file that a user may edit: whatever is in it is read, or refused in one line that names the file."""

from __future__ import annotations

import copy
import json
import shutil
import tempfile
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import given, settings
from hypothesis import strategies as st

from models.analytic.cue_impulse import Constants, Geometry
from models.commands.program import lone_command, run
from models.contract.checks import BALL, TABLE
from models.errors import BadInput
from models.files.limits import MAX_DEPTH
from models.model_file import full_model, read_model, write_model
from models.shot import Ball
from planner.launcher.cueing_map import CueingMap, read_map, write_map
from planner.launcher.execution import Execution, read_execution
from planner.planning import read_plan
from planner.scene import read_scene
from robot.device.settings import Settings, read_settings, write_settings
from sysid.clips import read_clip_set
from sysid.vision.balls.colours.palette import read_palette
from sysid.vision.camera.projection import read_camera, write_camera
from tests.footage.cameras import overhead
from tests.support.clip_samples import make

EXAMPLE_SCENE = Path(__file__).resolve().parents[2] / "planner" / "example.toml"
PALETTE = '[[ball]]\nname = "white"\nrgb = [0.9, 0.9, 0.8]\n[[ball]]\nname = "red"\nrgb = [180, 10, 20]\ncount = 15\n'
MAX_CHARS = 500  # of the line that refuses a file


def write_clips(path: Path) -> None:
    make(path.parent / "set")
    shutil.copy(path.parent / "set" / "clips.toml", path)


def read_clips(path: Path) -> Any:
    folder = path.parent / "set"
    shutil.copy(path, folder / "clips.toml")
    return read_clip_set(folder)


def write_example_map(path: Path) -> None:
    write_map(path, CueingMap(Constants(), Geometry(Ball(0.0525, 0.1406)), np.diag(np.full(8, 1e-8)), Execution(), 9))


FILES: dict[str, tuple[Callable[[Path], object], Callable[[Path], Any]]] = {
    "model.toml": (lambda path: write_model(full_model(TABLE, BALL), path), read_model),
    "clips.toml": (write_clips, read_clips),
    "scene.toml": (lambda path: shutil.copy(EXAMPLE_SCENE, path), read_scene),
    "launcher.toml": (lambda path: write_settings(Settings(), path), read_settings),
    "map.toml": (write_example_map, read_map),
    "execution.toml": (lambda path: path.write_text("[execution]\nspeed_sd = 0.01\n"), read_execution),
    "camera.toml": (lambda path: write_camera(path, overhead(TABLE, 0.0615, (480, 360), 1.6, 1.26)), read_camera),
    "palette.toml": (lambda path: path.write_text(PALETTE), read_palette),
    "plan.json": (lambda path: path.write_text('{"format": "billiard-plan/1", "seed": 1, "why": "so"}'), read_plan),
}
ODD = [
    "nan", "inf", "1e999", "-1", "0", "3.5", "true", '"x"', '""', "[]", "[1, 2]", "{}", "{ value = 1e400 }", "[[1]]",
    "9" * 400, "1" * 5000, "[" * 3000, "[" * 200 + "]" * 200, '"\\ud800"', '"\\u0000"', '"\\u001b[2J"', "2024-02-31",
    "12:00:00", '"' + "y" * 9000 + '"', "null", "a.b.c = 1", "\n[x]", "\n[[x]]", "\x1b", "é", "0x_1",
]  # fmt: skip


def assert_value_or_refusal(read: Callable[[Path], Any], path: Path) -> None:
    try:
        assert read(path) is not None
    except BadInput as error:
        for line in (str(error), *getattr(error, "__notes__", ())):
            assert line.isprintable() and len(line) < MAX_CHARS


def damaged(data: st.DataObject, raw: bytes) -> bytes:
    """A file as slips and accidents leave it: other bytes, keys gone, values of another kind or size."""
    kind = data.draw(st.sampled_from(["bytes", "gone", "value", "value", "value", "key", "double", "noise"]))
    lines = raw.split(b"\n")
    if kind == "bytes":
        at = data.draw(st.integers(0, len(raw)))
        return raw[:at] + data.draw(st.binary(max_size=4)) + raw[at + data.draw(st.integers(0, 4)) :]
    if kind == "noise":
        return data.draw(st.binary(max_size=200))
    at = data.draw(st.integers(0, len(lines) - 1))
    if kind == "gone":
        del lines[at]
    elif kind == "double":
        lines.insert(at, lines[data.draw(st.integers(0, len(lines) - 1))])
    elif kind == "key":
        lines.insert(at, data.draw(st.sampled_from(["x", "lenght", "format"])).encode() + b" = 3")
    else:
        separator = b":" if b'":' in lines[at] else b"="
        head = lines[at].partition(separator)[0]
        lines[at] = head + separator + b" " + data.draw(st.sampled_from(ODD)).encode()
    return b"\n".join(lines)


@pytest.mark.parametrize("name", FILES)
@settings(max_examples=100)
@given(data=st.data())
def test_a_damaged_file_is_read_or_refused(name: str, data: st.DataObject) -> None:
    write, read = FILES[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        raw = path.read_bytes()
        if name == "plan.json":
            raw = raw.replace(b", ", b",\n")
        for _ in range(data.draw(st.integers(1, 3))):
            raw = damaged(data, raw)
        path.write_bytes(raw)
        assert_value_or_refusal(read, path)


def places(value: Any, at: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Where the values of a parsed file are."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [at] * bool(at) + [place for key, item in inner for place in places(item, (*at, key))]


VALUES = st.sampled_from([True, 0, -1, 3.5, 10**400, float("nan"), float("inf"), "", "x", "\x1b", [], [1, "a"], {}])


@pytest.mark.parametrize("name", [name for name in FILES if name.endswith(".toml")])
@settings(max_examples=60)
@given(data=st.data())
def test_any_key_may_hold_anything_or_be_gone(name: str, data: st.DataObject) -> None:
    write, read = FILES[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, name)
        write(path)
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        for _ in range(data.draw(st.integers(1, 2))):
            *above, last = data.draw(st.sampled_from(places(content) or [("x",)]))
            table: Any = content
            for key in above:
                table = table[key]
            if data.draw(st.booleans()):
                table[last] = copy.deepcopy(data.draw(VALUES))  # one of them may be put into another
            elif places(content):
                del table[last]
        path.write_text(tomli_w.dumps(content), encoding="utf-8")
        assert_value_or_refusal(read, path)


@pytest.mark.parametrize("name", FILES)
def test_what_is_no_such_file_is_refused(name: str, tmp_path: Path) -> None:
    write, read = FILES[name]
    path = tmp_path / name
    write(path)
    read(path)
    if name != "clips.toml":
        for other in (tmp_path, tmp_path / "none", Path("/dev/zero"), Path("a\0b")):
            with pytest.raises(BadInput, match="cannot be read"):
                read(other)
    deep = "x = " + "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1) + "\n"
    path.write_text(json.dumps({"x": deep}) if name.endswith("json") else deep + path.read_text())
    with pytest.raises(BadInput):
        read(path)


def test_all_faults_of_a_file_are_told_one_line_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "launcher.toml"
    path.write_text(
        'format = "cuelab-launcher/1"\n[port]\nbuad = 9600\n[timing]\nreply_s = "x"\nretries = true\n'
        "[limits]\noffset = 0.9\n[stage]\ntilt_deg = 1e999\n[calibration]\nstrings = [2, 1]\nspeeds = [1.0, 2.0]\n"
    )

    @lone_command("launcher")
    def command() -> None:
        read_settings(path)

    assert run(command, []) == 2
    told = capsys.readouterr().err.splitlines()
    for line, words in zip(
        told, ("'baud'", "reply_s = 'x'", "retries = True", "0.9", "tilt_deg = inf", "rising"), strict=True
    ):
        assert str(path) in line and words in line


@pytest.mark.parametrize(
    "line", ["converged = 3", 'names = ["a", 1]', "correlation = [[{}]]", "correlation = [[1, 2], [3]]"]
)
def test_what_a_fit_says_of_itself_is_checked(line: str, tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(full_model(TABLE, BALL), path)
    path.write_text(path.read_text() + f"\n[fit]\n{line}\n")
    with pytest.raises(BadInput, match=rf"\[fit\]: {line.partition(' ')[0]} = "):
        read_model(path)
