"""What a command has made is not replaced by another command, or from other input, without a word."""

from __future__ import annotations

import json
import re
import shutil
import tomllib
from pathlib import Path

import click
import cv2
import numpy as np
import pytest

import planner.cli.verbs
import robot.cli.verbs
import sysid.cli.verbs
from models.commands.outputs import OutputFile, ResultFile, ResultFolder
from models.commands.program import Program
from models.files import write_whole
from models.files.made import digest, marked
from models.files.record import Origin, origin_of, with_record
from tests.fuzz.verbs import SEEDS

ORIGIN = Origin("sysid new-model", "0123456789abcdef")
REFUSED = "was not made by this command from the same input; name another, or replace it with --overwrite\n"


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The inputs of tests/fuzz in the working folder."""
    shutil.copytree(SEEDS, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def png() -> bytes:
    """A picture."""
    return cv2.imencode(".png", np.zeros((4, 4, 3), np.uint8))[1].tobytes()


@pytest.mark.parametrize("content", [b"a = 1\n", b'{\n "a": 1\n}\n', b"{}", png(), b"%PDF-1.4\n%%EOF\n"])
def test_a_record_stands_in_every_kind_of_file(content: bytes) -> None:
    held = with_record(content, ORIGIN)
    assert origin_of(held) == ORIGIN and origin_of(content) is None
    if content.startswith(b"{"):
        assert json.loads(held).items() >= json.loads(content).items()
    elif content.startswith(b"a"):
        assert tomllib.loads(held.decode()) == {"a": 1}
        assert origin_of(held.replace(b"1\n", b"2\n")) is None, "it was changed by hand"
    elif content.startswith(b"\x89"):
        assert cv2.imdecode(np.frombuffer(held, np.uint8), cv2.IMREAD_COLOR).shape == (4, 4, 3)


def test_only_the_results_of_a_command_are_marked(tmp_path: Path) -> None:
    with marked(ORIGIN, [tmp_path / "a.toml"]):
        for name in ("a.toml", "b.toml"):
            write_whole(tmp_path / name, b"a = 1\n")
    assert origin_of((tmp_path / "a.toml").read_bytes()) == ORIGIN
    assert (tmp_path / "b.toml").read_bytes() == b"a = 1\n"


def test_inputs_count_by_what_they_hold(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "x.csv").write_text("1" if name < "c" else "2")
    a, b, c = (digest([("clips", tmp_path / name)]) for name in ("a", "b", "c"))
    assert a == b != c


def test_a_result_is_replaced_by_the_same_command_alone(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["add", "squirt", "--model", "model.toml", "--out", "new.toml"]
    assert sysid.cli.main(words) == 0
    first = Path("new.toml").read_bytes()
    assert sysid.cli.main(words) == 0 and Path("new.toml").read_bytes() == first
    other = ["add", "table_tilt", "--model", "model.toml", "--out", "new.toml"]
    capsys.readouterr()
    assert sysid.cli.main(other) == 2
    assert capsys.readouterr().err == f"sysid add: new.toml: already exists and {REFUSED}"
    assert Path("new.toml").read_bytes() == first
    Path("new.toml").write_bytes(first.replace(b"format", b"# a remark of mine\nformat"))
    assert sysid.cli.main(words) == 2, "changed by hand"
    assert sysid.cli.main([*other, "--overwrite"]) == 0 and Path("new.toml").read_bytes() != first
    Path("mine.toml").write_text("a = 1\n")
    assert sysid.cli.main([*words[:-1], "mine.toml"]) == 2 and Path("mine.toml").read_text() == "a = 1\n"


@pytest.mark.slow
def test_a_folder_of_results_as_well(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree("clips", "others")
    text = Path("others/clips.toml").read_text()
    Path("others/clips.toml").write_text(re.sub(r"fps = \S+", "fps = 59.0", text))
    words = ["discover", "clips", "--out", "out"]
    assert sysid.cli.main(words) in (0, 1)
    made = {path.name: path.read_bytes() for path in Path("out").iterdir()}
    assert "made.json" in made
    capsys.readouterr()
    assert sysid.cli.main(["discover", "others", "--out", "out"]) == 2
    assert capsys.readouterr().err == f"sysid discover: out: holds model.toml, which {REFUSED}"
    assert sysid.cli.main(["discover", "clips", "--model", "model.toml", "--out", "out"]) == 2
    assert sysid.cli.main(["demo", "--out", "out"]) == 2
    assert {path.name: path.read_bytes() for path in Path("out").iterdir()} == made
    assert sysid.cli.main(["discover", "found-no-clips", "--out", "new"]) == 2 and not Path("new").exists()
    Path("begun").mkdir()
    Path("begun/unfinished.jsonl").write_text("somebody's fits\n")
    assert sysid.cli.main(["discover", "clips", "--out", "begun"]) == 2, "fits of another run are work, too"


def test_what_is_drawn_replaces_its_own_kind_and_no_input(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = Path("model.toml").read_bytes()
    compare = ["compare", "clips", "--model", "model.toml"]
    assert sysid.cli.main([*compare, "--report", "model.toml"]) == 2
    assert "model.toml: is an input of this command; name another file" in capsys.readouterr().err
    assert sysid.cli.main([*compare, "--report", "scene.toml"]) == 2
    assert "its name does not end in .html" in capsys.readouterr().err
    assert sysid.cli.main(["check", "clips", "--json", "clips/clips/0001.csv"]) == 2
    assert "clips/clips/0001.csv: is an input of this command" in capsys.readouterr().err
    assert sysid.cli.main(["check", "clips", "--json", "scene.toml"]) == 2
    assert "its name does not end in .json" in capsys.readouterr().err
    assert Path("model.toml").read_bytes() == model
    for _ in range(2):
        assert sysid.cli.main(["check", "clips", "--json", "a.json"]) == 0


def test_a_scene_of_a_study_replaces_no_other(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["study", "--out", "study", "--scene", "1"]
    assert planner.cli.main([*words, "scene.toml"]) == 2
    assert "scene.toml: already exists and holds something else" in capsys.readouterr().err
    assert planner.cli.main([*words, "new.toml"]) == 0 and planner.cli.main([*words, "new.toml"]) == 0


def test_what_was_measured_at_a_launcher_is_never_made_again(place: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["calibrate", "--settings", "launcher.toml", "--strings", "60", "80", "--repeats", "2", "--out", "new.toml"]
    assert robot.cli.main(words) == 0 and robot.cli.main(words) == 0
    capsys.readouterr()
    assert robot.cli.main([*words, "--port", "nowhere", "--yes"]) == 2
    assert REFUSED in capsys.readouterr().err


@pytest.mark.parametrize("program", [sysid.cli.verbs.PROGRAM, planner.cli.verbs.PROGRAM, robot.cli.verbs.PROGRAM])
def test_every_out_has_a_rule(program: Program) -> None:
    """Those that are no result continue, or refuse, by a rule of their own."""
    own = {"track", "import", "study", "learn"}
    for name, verb in program.commands.items():
        for param in verb.params:
            if isinstance(param, click.Option) and "--out" in param.opts:
                assert isinstance(param.type, ResultFile | ResultFolder) or name in own, name
                assert name in own or any("--overwrite" in p.opts for p in verb.params)
            assert not isinstance(param.type, click.File), name
            if isinstance(param.type, OutputFile):
                assert param.metavar, name
