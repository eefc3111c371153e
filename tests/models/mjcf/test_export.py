"""Plain MJCF for any MuJoCo viewer."""

from __future__ import annotations

import itertools
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

from models.mjcf.export import export, in_a_row
from models.mjcf.native import Native
from models.mjcf.world import build_spec
from models.model_file import Model
from models.shot import Ball, Table

ROOT = Path(__file__).resolve().parents[3]
NAMES = ("white", "yellow", "red 1")
WORLDS = [
    (Table(3.569, 1.778), Ball(0.0525, 0.1406)),
    (Table(2.959, 1.473), Ball(0.0525, 0.1406)),
    (Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)),
]


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "models.mjcf.export", *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)


@pytest.mark.parametrize(("table", "ball"), WORLDS)
def test_the_exported_world_is_plain_mjcf(table: Table, ball: Ball, tmp_path: Path) -> None:
    path = tmp_path / "new" / "world.xml"
    native = Native(slide=0.23, cushion_restitution=0.8)
    export(Model(table, ball, native), in_a_row(NAMES, ball), path)
    text = path.read_text(encoding="utf-8")
    assert "file=" not in text, "it needs no other file"
    model, here = mujoco.MjModel.from_xml_string(text), build_spec(table, ball, NAMES, (native,)).compile()
    assert model.npair == here.npair
    for field in ("pair_friction", "pair_solref", "pair_solreffriction", "pair_solimp"):
        assert getattr(model, field) == pytest.approx(getattr(here, field), rel=1e-5)
    x = [model.body(name).pos[0] for name in NAMES]
    assert all(abs(a - b) > ball.diameter for a, b in itertools.combinations(x, 2))
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data, 1000)
    assert np.abs(data.qvel).max() < 1e-2, "at rest"
    assert [p.name for p in path.parent.iterdir()] == ["world.xml"]


def test_the_shipped_file_is_what_the_command_writes(tmp_path: Path) -> None:
    out = tmp_path / "table.xml"
    assert run(str(out), "--bare", "--balls", "white,red,black").returncode == 0
    assert out.read_bytes() == (ROOT / "models" / "mjcf" / "table.xml").read_bytes()


def test_a_frame_of_snooker_holds_the_tuned_terms_and_runs(tmp_path: Path) -> None:
    out = tmp_path / "snooker.xml"
    assert run(str(out)).returncode == 0
    model = mujoco.MjModel.from_xml_path(str(out))
    assert model.njnt == 22
    native = Native()
    slide = sorted(set(model.pair_friction[:, 0]))
    assert slide == pytest.approx(sorted([native.slide, native.ball_friction, native.cushion_friction]), rel=1e-5)
    data = mujoco.MjData(model)
    data.qvel[:2] = 3.0, -0.4
    mujoco.mj_step(model, data, 5000)
    assert not any(data.warning[k].number for k in range(len(data.warning)))
    assert np.all(np.isfinite(data.qpos))


def test_the_launcher_can_be_exported(tmp_path: Path) -> None:
    out, ball = tmp_path / "scene.xml", Ball(0.06, 0.2)
    table = Table(2.0, 1.0, pockets=False)
    export(Model(table, ball, Native(slide=0.27)), in_a_row(("white", "red"), ball), out, launcher=True)
    model = mujoco.MjModel.from_xml_path(str(out))
    assert model.geom("bed").size[:2] == pytest.approx([1.0, 0.5])
    assert 0.6 in model.pair_friction[:, 0].round(6), "of the tip"
    assert 0.27 in model.pair_friction[:, 0].round(6)
    assert model.nu == 3


def test_the_command_names_what_is_wrong(tmp_path: Path) -> None:
    out = str(tmp_path / "carom.xml")
    sizes = ("--length", "2.84", "--width", "1.42", "--diameter", "0.0615", "--mass", "0.21", "--no-pockets")
    assert run(out, *sizes, "--balls", "white,yellow,red").returncode == 0
    assert mujoco.MjModel.from_xml_path(out).geom("bed").size[:2] == pytest.approx([1.42, 0.71])
    wrong = run(out, "--mass", "-1")
    assert (wrong.returncode, wrong.stderr) == (2, "models.mjcf.export: --mass is -1.0; give a positive number\n")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--balls", "white,world"), "'world' is not a valid name of a ball"),
        (("--balls", ","), "names a ball twice"),
        (("--balls", "white,white"), "names a ball twice"),
        (("--balls", "launcher/cue,white", "--launcher"), "'launcher/cue' is not a valid name of a ball"),
        (("--length", "0.5", "--width", "0.3"), "not on the table"),
        (("--diameter", "1e-9"), "MuJoCo rejects this world"),
    ],
)
def test_what_makes_no_world_is_told_in_one_line(arguments: tuple[str, ...], said: str, tmp_path: Path) -> None:
    out = tmp_path / "x.xml"
    done = run(str(out), *arguments)
    assert done.returncode == 2
    assert said in done.stderr
    assert done.stderr.count("\n") == 1
    assert not out.exists()
