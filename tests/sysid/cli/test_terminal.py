"""Small things of the terminal: effects taken off, figures on standard output, versions, hints that can be pasted."""

from __future__ import annotations

import json
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any

import pytest

from models.commands.console import as_called
from models.model_file import full_model, write_model
from models.shot import Ball, Table
from sysid.cli import main
from tests.support.clip_samples import make
from tests.support.commands import ROOT, one_line, said_by
from tests.truth.__main__ import main as make_truth


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Any:
    return lambda *words: said_by(main, words, capsys)


@pytest.fixture
def model(tmp_path: Path) -> Path:
    """A model of a table."""
    path = tmp_path / "m.toml"
    write_model(full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406)), path)
    return path


def test_remove_takes_an_effect_off_the_stack(run: Any, model: Path, tmp_path: Path) -> None:
    more, out = tmp_path / "m2.toml", tmp_path / "m3.toml"
    run("add", "side_curve", "--model", model, "--out", more)
    said = run("remove", "side_curve", "--model", more, "--out", out)
    assert said.status == 0 and "side_curve" not in said.out
    assert tomllib.loads(out.read_text()) == tomllib.loads(model.read_text())
    assert "did you mean side_curve" in one_line(
        run("remove", "side_curv", "--model", more, "--out", tmp_path / "m4.toml")
    )
    assert "has no effect 'squirt'" in one_line(run("remove", "squirt", "--model", more, "--out", tmp_path / "m4.toml"))


def test_figures_on_standard_output_stand_alone(run: Any, tmp_path: Path) -> None:
    clips = make(tmp_path / "clips")
    said = run("check", clips, "--json", "-")
    assert said.status == 0 and json.loads(said.out)["faults"] == []
    assert "no faults" in said.err


def test_versions_of_what_results_depend_on(run: Any) -> None:
    said = run("--version")
    assert (said.status, said.err) == (0, "") and said.out.startswith("sysid: Python 3.")
    assert "mujoco 3." in said.out and "numba " in said.out


def test_hints_can_be_pasted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    program = tmp_path / "bin" / "sysid"
    program.parent.mkdir()
    program.touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(program), "check"])
    monkeypatch.setenv("PATH", str(tmp_path))
    assert as_called("sysid check x") == "bin/sysid check x"
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent))
    assert as_called("sysid check x") == "sysid check x"


@pytest.mark.slow
def test_a_model_with_an_effect_of_ones_own_names_its_folder(tmp_path: Path, model: Path) -> None:
    """In a process of its own: an effect that was added stays in the catalogue."""

    def said(*words: object) -> subprocess.CompletedProcess[str]:
        base = [sys.executable, "-m", "sysid.cli", *map(str, words)]
        return subprocess.run(base, cwd=ROOT, capture_output=True, text=True, check=False)

    own, out = tmp_path / "own effects", tmp_path / "m2.toml"
    assert said("new-effect", "warm_cloth", "--dir", own).returncode == 0
    assert said("add", "warm_cloth", "--model", model, "--out", out, "--effects", own).returncode == 0
    refused = said("remove", "warm_cloth", "--model", out, "--out", tmp_path / "m3.toml")
    assert refused.returncode == 2 and len(refused.stderr.splitlines()) == 1
    assert f"'warm_cloth' is one of your own: name its folder, --effects {own}" in refused.stderr
    assert said("remove", "warm_cloth", "--model", out, "--out", tmp_path / "m3.toml", "--effects", own).returncode == 0
    assert tomllib.loads((tmp_path / "m3.toml").read_text()) == tomllib.loads(model.read_text())


@pytest.mark.slow
def test_discover_writes_its_figures_to_standard_output_too(run: Any, tmp_path: Path) -> None:
    clips, kinds = tmp_path / "set", "stun,side,spin,cushion,cut"
    assert make_truth([str(clips), "--seed", "8", "--clips", "7", "--seconds", "1.2", "--kind", kinds]) == 0
    said = run("discover", clips, "--out", tmp_path / "out", "--json", "-")
    assert json.loads(said.out) == json.loads((tmp_path / "out" / "result.json").read_text())
    assert "result.json" in said.err
