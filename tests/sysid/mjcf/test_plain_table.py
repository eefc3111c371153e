"""`sysid export`: what a plain file says of a model, what it says it leaves out, and that MuJoCo alone plays it."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

import sysid
from models.effect_catalogue import effect_class
from models.files.record import Origin, origin_of, with_record
from models.mjcf.export import places_of
from models.mjcf.native import Native
from models.model_file import Model, full_model, write_model
from models.shot import GRAVITY, NOSE_SINE, RAIL_NAMES, Array, Shot
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from sysid import cli
from sysid.mjcf import costs
from sysid.mjcf.costs import ALL_TOGETHER, OF_CONTACTS, Cost, left_out
from sysid.mjcf.player import play_plain
from sysid.mjcf.said import at_rail, plain_spec
from sysid.mjcf.table import PlainTable, head, plain_table
from sysid.validation.shots import impact_shot

BALL, TABLE = SNOOKER_BALL, dataclasses.replace(SNOOKER_TABLE, pockets=False)
OWN_ROLL = 0.0123
HERE = {"white": np.zeros(2), "red": np.array([0.3, 0.0])}


def model_with(**values: float) -> Model:
    """The base on a snooker table without pockets, with constants named effect__parameter."""
    model = full_model(TABLE, BALL)
    for name in dict.fromkeys(key.split("__")[0] for key in values):
        if name not in [e.name() for e in model.effects]:
            model = model.add(effect_class(name)())
    return model.with_values({key.replace("__", "."): value for key, value in values.items()})


def compiled(model: Model, rail_terms: dict[str, Native] | None = None) -> mujoco.MjModel:
    return plain_spec(model, HERE, rail_terms, bare=True).compile()


def friction(world: mujoco.MjModel, one: str, other: str) -> Array:
    """Of the pair of two geoms: (5,)."""
    ids = {world.geom(one).id, world.geom(other).id}
    k = next(k for k in range(world.npair) if {world.pair_geom1[k], world.pair_geom2[k]} == ids)
    return np.asarray(world.pair_friction[k])


def test_the_slope_is_gravity_and_the_struck_ball_has_its_own_mass_and_cloth() -> None:
    own = {"cue_ball_mass__factor": 1.1, "struck_ball_slide__change": 0.2, "struck_ball_roll__change": -0.1}
    plain = compiled(model_with())
    world = compiled(model_with(table_tilt__slope_x=0.001, table_tilt__slope_y=-0.002, **own))
    assert list(plain.opt.gravity) == [0.0, 0.0, -GRAVITY]
    assert list(world.opt.gravity) == pytest.approx([0.001 * GRAVITY, -0.002 * GRAVITY, -GRAVITY])
    for name, factor in (("white", 1.1), ("red", 1.0)):
        assert world.body(name).mass[0] == pytest.approx(factor * BALL.mass)
        assert world.body(name).inertia == pytest.approx(np.full(3, factor * BALL.inertia))
    assert friction(world, "ball red", "bed") == pytest.approx(friction(plain, "ball red", "bed"))
    ratio = friction(world, "ball white", "bed") / friction(plain, "ball white", "bed")
    assert ratio == pytest.approx([1.2, 1.2, 1.0, 0.9, 0.9])


@pytest.mark.parametrize(("change", "of_rail"), [(0.0, 0.0), (-0.2, 0.0), (-0.1, 0.15)])
def test_a_ball_meets_each_nose_where_the_model_has_it(change: float, of_rail: float) -> None:
    model = model_with(nose_height__change=change, nose_height_py__change=of_rail)
    world = compiled(model)
    data = mujoco.MjData(world)
    limits = TABLE.centre_limits(BALL)
    for number, rail in enumerate(RAIL_NAMES):
        sign, axis = (1.0 if rail[0] == "+" else -1.0), number // 2
        mujoco.mj_resetData(world, data)
        data.qpos[axis] = sign * (limits[axis] + 1e-5)
        mujoco.mj_forward(world, data)
        met = [c for c in data.contact if "cushion" in (world.geom(c.geom1).name + world.geom(c.geom2).name)]
        assert len(met) == 1, rail
        sine = NOSE_SINE + change + (of_rail if rail == "+y" else 0.0)
        assert abs(met[0].frame[2]) == pytest.approx(sine, abs=1e-3)
        assert met[0].dist == pytest.approx(-1e-5 * math.sqrt(1 - sine**2), abs=1e-6)


def test_rails_that_differ_have_terms_of_their_own() -> None:
    native = Native(cushion_friction=0.2)
    world = compiled(dataclasses.replace(model_with(), native=native), {"-y": Native(cushion_friction=0.3)})
    names = [world.geom(k).name for k in range(world.ngeom)]
    found = {name[-2:]: friction(world, "ball white", name)[0] for name in names if name.startswith("cushion")}
    assert found == {"+x": 0.2, "-x": 0.2, "+y": 0.2, "-y": 0.3}


@pytest.mark.parametrize("rail", ["+x", "-y"])
def test_the_model_at_a_rail_answers_as_the_whole_model_there(rail: str) -> None:
    model = model_with(
        cushion_restitution_px__change=-0.1, cushion_friction_px__change=0.05, nose_height_px__change=-0.1,
        nose_height__change=0.05,
    )  # fmt: skip
    shot = impact_shot("cushion", 1.5, 0.4, 0.7, 0.5, 1e-3, TABLE, BALL)  # at +x
    there, own = (simulate(m, [shot])[0] for m in (at_rail(model, rail), model))
    same = np.allclose(there.velocity[-1], own.velocity[-1], atol=1e-12)
    assert same is (rail == "+x")


def test_shots_of_a_file_are_those_that_mj_step_plays() -> None:
    model, velocity = model_with(table_tilt__slope_y=0.002), np.array([[1.0, 0.2], [0, 0]])
    shots = [
        Shot(
            ("white", "red"),
            np.array(list(HERE.values())),
            velocity,
            np.array([[0, 0, w], [0, 0, 0]]),
            np.array([0, 0.1]),
        )
        for w in (20.0, -30.0)
    ]
    tracks = play_plain(model.with_values({"native.slide": np.array([0.2, 0.3])}), shots)
    for shot, track, slide in zip(shots, tracks, (0.2, 0.3), strict=True):
        world = compiled(model.with_values({"native.slide": slide}))
        data = mujoco.MjData(world)
        data.qvel[:2], data.qvel[3:6] = shot.velocity[0], shot.spin[0]
        mujoco.mj_step(world, data, 1000)
        assert track.position[-1, 0] == pytest.approx(data.qpos[:2], abs=1e-9)
        spin = np.zeros(3)
        mujoco.mju_rotVecQuat(spin, data.qvel[3:6], data.qpos[3:7])
        assert track.spin[-1, 0] == pytest.approx(spin, abs=1e-6)


def test_a_ball_stays_where_the_cloth_holds_it_on_a_slope() -> None:
    world = compiled(model_with().add(effect_class("table_tilt")(0.0007, -0.0016)))
    data = mujoco.MjData(world)
    mujoco.mj_step(world, data, 2000)
    before = data.qpos[:2].copy()
    mujoco.mj_step(world, data, 5000)
    assert np.hypot(*(data.qpos[:2] - before)) < 1e-5


def test_the_head_says_what_is_left_out_and_stays_a_comment() -> None:
    model = model_with(table_tilt__slope_x=0.001)
    for name in ("cloth_nap", "image_scale"):
        model = model.add(effect_class(name)())
    text = head(model, (Cost(ALL_TOGETHER, 0.1234), Cost("cloth_nap", 0.02)), "my--model.toml")
    root = ElementTree.fromstring(text + "<mujoco/>")
    assert root.tag == "mujoco"
    for said in ("123.4 mm  all together", "20.0 mm  cloth_nap", "table_tilt", "image_scale", "no pockets"):
        assert said in text
    assert [e.name() for e in left_out(model)] == ["cloth_nap"]
    assert "jaws" in head(full_model(SNOOKER_TABLE, BALL), (), "")


def test_a_record_stands_in_a_comment_of_xml() -> None:
    origin, content = Origin("sysid export", "0" * 16), b"<!--\n a\n-->\n<mujoco/>\n"
    marked = with_record(content, origin)
    ElementTree.fromstring(marked)
    assert origin_of(marked) == origin
    assert origin_of(marked.replace(b" a\n", b" b\n")) is None


def test_a_table_of_mujoco_s_own_contacts_is_written_as_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, out = tmp_path / "m.toml", tmp_path / "t.xml"
    write_model(Model(TABLE, BALL, Native(slide=0.27)), path)
    assert cli.main(["export", str(path), "--out", str(out), "--balls", "white,red", "--launcher"]) == 0
    world = mujoco.MjModel.from_xml_path(str(out))
    assert friction(world, "ball red", "bed")[0] == pytest.approx(0.27)
    assert world.nu == 3
    assert "leaves out nothing" in capsys.readouterr().out
    before = out.read_bytes()
    assert cli.main(["export", str(path), "--out", str(out), "--balls", "white,blue"]) == 2
    assert "not made by this command from the same input" in capsys.readouterr().err
    assert out.read_bytes() == before
    made = sysid.export(Model(TABLE, BALL), tmp_path / "u.xml", balls={"white": (0.1, 0.2)}, bare=True)
    assert isinstance(made, PlainTable)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "u.xml")).body("white").pos[:2] == pytest.approx([0.1, 0.2])


@pytest.mark.parametrize(
    ("balls", "said"), [("white,world", "'world' is not a valid name of a ball"), ("white,white", "names a ball twice")]
)
def test_balls_that_no_file_can_have_are_named_before_the_work(
    balls: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_model(model_with(), tmp_path / "m.toml")
    assert cli.main(["export", str(tmp_path / "m.toml"), "--out", str(tmp_path / "t.xml"), "--balls", balls]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "t.xml").exists()


def rolled(world: mujoco.MjModel, shot: Shot, seconds: float) -> tuple[Array, float]:
    """Where a shot's ball is after a time in plain MuJoCo (2,) [m], and its speed [m/s]."""
    data = mujoco.MjData(world)
    data.qpos[:2], data.qvel[:2], data.qvel[3:6] = shot.position[0], shot.velocity[0], shot.spin[0]
    mujoco.mj_step(world, data, round(seconds / world.opt.timestep))
    return data.qpos[:2].copy(), float(np.hypot(*data.qvel[:2]))


@pytest.mark.slow
def test_a_fitted_table_rolls_as_its_model_and_says_what_it_costs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(costs, "SHOTS", 6)
    model = model_with(decoupled_cloth__roll=OWN_ROLL, table_tilt__slope_x=0.0007, table_tilt__slope_y=-0.0016)
    table = plain_table(model, places_of(model, ["white"]), bare=True)
    world = mujoco.MjModel.from_xml_string(table.text)
    for direction in (1.0, -1.0):
        velocity = np.array([[direction * 0.95, 0.0]])
        spin = np.array([[0.0, direction * 0.95 / BALL.radius, 0.0]])
        shot = Shot(("white",), np.array([[-1.5 * direction, 0.3]]), velocity, spin, np.arange(0.0, 8.0, 1e-3))
        track = simulate(model, [shot])[0]
        way = np.hypot(*(track.position[:, 0] - shot.position[0]).T)
        k = int(np.argmax(way >= 3.0))
        assert way[k] >= 3.0
        place, speed = rolled(world, shot, track.times[k])
        assert np.hypot(*(place - track.position[k, 0])) < 5e-3
        lost = 0.95 - float(np.hypot(*track.velocity[k, 0]))
        assert (0.95 - speed) / lost == pytest.approx(1.0, abs=0.01)
    causes = {cost.cause: cost.median_m for cost in table.costs}
    assert set(causes) == {ALL_TOGETHER, *OF_CONTACTS.values()}
    assert all(0.0 < cost < 1.0 for cost in causes.values())
    assert table.costs[0].cause == ALL_TOGETHER
    assert f"{table.costs[0].median_m * 1000:.1f} mm  {ALL_TOGETHER}" in table.text
