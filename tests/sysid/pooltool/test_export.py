"""A model as pooltool's system and laws: what pooltool reads of it, what is lost, and what pooltool makes of it."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.errors import BadInput
from models.model_file import Model, full_model, write_model
from models.shot import GRAVITY, Ball, Table
from models.table.presets import TABLE_SETS
from sysid.cli.verbs import main
from sysid.pooltool.document import read_systems
from sysid.pooltool.export import export_pooltool, nearest_laws
from sysid.pooltool.laws import laws_of, with_effect
from tests.bench.pooltool_judge import Judge, apart, judge_python
from tests.support.commands import Said

POOL = TABLE_SETS["pool 7 ft"]
MODEL = full_model(POOL.table, POOL.ball)
SECOND_IMPACT_M = 0.002  # within which laws that coincide put balls, in 95 % of shots


def test_a_model_s_constants_are_pooltool_s(tmp_path: Path) -> None:
    lines = export_pooltool(MODEL, tmp_path / "system.json")
    (system,) = read_systems(tmp_path / "system.json")
    params = system["balls"]["cue"]["params"]
    # pooltool decelerates sidespin by 5 u_sp g / (2 R), u_sp its proportionality times R.
    assert 2.5 * params["u_sp_proportionality"] * params["g"] == pytest.approx(22.0) and params["g"] == GRAVITY
    assert (params["u_s"], params["u_r"], params["e_c"], params["f_c"]) == (0.2, 0.0127, 0.9, 0.14)
    laws = json.loads((tmp_path / "system.laws.json").read_text())
    assert laws["ball_ball"]["model"] == "frictional_mathavan" and laws["ball_ball"]["friction"] == {"model": "average"}
    assert laws["ball_linear_cushion"]["model"] == laws["ball_circular_cushion"]["model"] == "mathavan_2010"
    assert "lost: nothing, with the laws file" in lines
    assert any("pooltool's own cushions" in line and "mm where balls stop" in line for line in lines)


def test_the_verb_writes_both_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def run(*words: str) -> Said:
        return Said(main(list(words)), *capsys.readouterr())

    write_model(MODEL, tmp_path / "model.toml")
    words = ["export", str(tmp_path / "model.toml"), "--to", "pooltool", "--balls", "white,red"]
    said = run(*words, "--out", str(tmp_path / "system.json"))
    assert said.status == 0 and "lost: nothing" in said.out, said
    (system,) = read_systems(tmp_path / "system.json")
    assert set(system["balls"]) == {"white", "red"} and (tmp_path / "system.laws.json").exists()
    said = run(*words, "--launcher", "--out", str(tmp_path / "other.json"))
    assert said.status == 2 and "--launcher applies to MJCF only" in said.err and not (tmp_path / "other.json").exists()


def test_messagepack_says_the_same(tmp_path: Path) -> None:
    pytest.importorskip("msgpack")
    for suffix in ("json", "msgpack"):
        export_pooltool(MODEL, tmp_path / f"system.{suffix}")
    (plain,), (packed,) = (read_systems(tmp_path / f"system.{suffix}") for suffix in ("json", "msgpack"))
    for one, other in zip(plain["balls"].values(), packed["balls"].values(), strict=True):
        assert one["history"] == {"states": []} and other["history"] is None  # pooltool packs empty ones so
        for data in (one, other):
            del data["history"], data["history_cts"]
    assert plain == packed


def test_effects_that_pooltool_has_are_carried_over() -> None:
    model = with_effect(MODEL, "ball_friction_speed", gain=0.108, decay=1.088)
    model = with_effect(model, "struck_ball_slide", change=0.1)
    model = with_effect(with_effect(model, "nose_height", change=-0.13), "nose_height_px", change=0.05)
    model = with_effect(model, "squirt", per_offset=2.5 / (POOL.ball.radius * 23.5))
    laws = laws_of(model)
    assert not laws.lost and laws.played.effects == model.effects
    assert laws.resolver["ball_ball"]["friction"] == {"a": 0.05, "b": 0.108, "c": 1.088, "model": "alciatore"}
    assert laws.struck["u_s"] == pytest.approx(0.22) and laws.others["u_s"] == pytest.approx(0.2)
    assert laws.heights["-x"] == pytest.approx(1.27 * POOL.ball.radius)
    assert laws.heights["+x"] == pytest.approx(1.32 * POOL.ball.radius)
    assert POOL.ball.mass / laws.end_mass == pytest.approx(20.0)


def test_what_is_lost_is_named_with_its_cost(tmp_path: Path) -> None:
    tilted = with_effect(MODEL, "table_tilt", slope_x=0.002)
    lines = export_pooltool(tilted, tmp_path / "system.json")
    (line,) = [line for line in lines if "without table_tilt" in line]
    # 2 mrad of slope move a ball by 5/14 g 0.002 t^2: some centimetres while it rolls.
    assert 5.0 < float(line.split("impact (95 %: ")[1].split("), ")[1].split(" mm")[0]) < 500.0
    assert any(line.startswith("lost: in all") for line in lines)


def test_the_nearest_law_of_cushions_is_taken() -> None:
    """A nose that gives way along its face, on no bed, is pooltool's compliant cushion, and is played as that."""
    rigid = with_effect(MODEL, "soft_bed", share=0.1)
    assert nearest_laws(rigid).cushion == "mathavan_2010"
    soft = with_effect(with_effect(MODEL, "soft_bed", share=1.0), "cushion_compliance", ratio=3.5 / 1.8**2)
    laws = nearest_laws(soft)
    assert laws.cushion == "stronge_compliant" and not laws.lost
    assert laws.resolver["ball_linear_cushion"]["omega_ratio"] == pytest.approx(1.8)
    height, radius = laws.heights["+x"], POOL.ball.radius
    assert np.sin(np.arctan((height - radius) / radius)) == pytest.approx(0.4)


def test_models_and_places_that_pooltool_cannot_have_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="pooltool has no laws for this model"):
        export_pooltool(Model(POOL.table, POOL.ball), tmp_path / "system.json")
    with pytest.raises(BadInput, match="outside the playing surface"):
        export_pooltool(MODEL, tmp_path / "system.json", {"cue": (2.0, 0.0)})
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.skipif(not judge_python(), reason="no Python with pooltool: name it in $CUELAB_POOLTOOL")
@pytest.mark.parametrize("curve", [False, True], ids=["constant friction", "friction by slip"])
def test_pooltool_puts_balls_where_the_model_does(tmp_path: Path, curve: bool) -> None:
    model = with_effect(MODEL, "ball_friction_speed", gain=0.108, decay=1.088) if curve else MODEL
    judge = Judge(judge_python(), tmp_path, model)
    judge.export()
    at_second, at_rest = apart(judge, own=False)
    # By slip, pooltool's friction is that of the slip before the impact: another law.
    assert np.quantile(at_second, 0.5 if curve else 0.95) < SECOND_IMPACT_M
    assert np.nanmedian(at_rest) < 10 * SECOND_IMPACT_M


@pytest.mark.slow
@pytest.mark.skipif(not judge_python(), reason="no Python with pooltool: name it in $CUELAB_POOLTOOL")
def test_pooltool_s_own_reader_takes_both_files(tmp_path: Path) -> None:
    pytest.importorskip("msgpack")
    carom = full_model(Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)).add(effect_class("nose_height")())
    export_pooltool(carom, tmp_path / "system.msgpack")
    code = (
        "import pooltool as pt; from pooltool.physics.resolve.resolver import Resolver; "
        "from pooltool.physics.engine import PhysicsEngine; "
        f"s = pt.System.load({str(tmp_path / 'system.msgpack')!r}); "
        f"e = PhysicsEngine(resolver=Resolver.load({str(tmp_path / 'system.laws.json')!r})); "
        "pt.simulate(s, engine=e, inplace=True); print(s.table.w, s.table.l, len(s.events))"
    )
    env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"HOME": str(tmp_path)}
    told = subprocess.run([judge_python(), "-c", code], env=env, capture_output=True, text=True, check=True).stdout
    width, length, events = told.split()[-3:]
    shift = 0.0615 * (1 - np.sqrt(1 - 0.16))
    assert float(width) == pytest.approx(1.42 + shift) and float(length) == pytest.approx(2.84 + shift)
    assert int(events) > 2
