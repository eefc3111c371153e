"""The table that mj_step moves: the event engine's shots, forces that sensors see, and a place in anyone's loop."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import mujoco
import numpy as np
import pytest
from dm_control import mujoco as dm_mujoco
from dm_control.mujoco import wrapper
from numpy.typing import NDArray

from models.effect_catalogue import catalogue, effect_class
from models.errors import BadInput
from models.model_file import Model, full_model
from models.mujoco.world import World
from models.shot import GRAVITY, Session, Shot
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked

Array = NDArray[np.float64]
BASE = full_model(SNOOKER_TABLE, SNOOKER_BALL)
CLOSED = full_model(dataclasses.replace(SNOOKER_TABLE, pockets=False), SNOOKER_BALL)  # where balls stay in play
RADIUS, MASS = SNOOKER_BALL.radius, SNOOKER_BALL.mass
ON_TABLE = ("forces", "impact", "strike")  # hooks that act there, and not in the camera
ACTING = [n for n, kind in catalogue().items() if kind.opens(*ON_TABLE) and n not in {e.name() for e in BASE.effects}]
LONGER_CONTACT = "cushion_contact_time"  # which the event engine has as a delay


def shots(count: int, seed: int) -> list[Shot]:
    """A white that meets a red, with all kinds of spin."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        p = rng.uniform([-1.5, -0.7], [1.5, 0.7], (2, 2))
        way = p[1] - p[0]
        if np.hypot(*way) < 0.15:
            continue
        aside, speed = rng.uniform(-1.2, 1.2) * RADIUS, rng.uniform(0.8, 3.0)
        a = math.atan2(way[1], way[0]) + aside / np.hypot(*way)
        aim, lever = np.array([math.cos(a), math.sin(a)]), 2.5 * speed / RADIUS
        side, height = rng.uniform(-0.4, 0.4, 2)
        flat = lever * height * np.array([-aim[1], aim[0]]) + 0.1 * lever * side * aim
        spin = np.array([[*flat, lever * side], [0, 0, 0]])
        velocity = np.array([speed * aim, [0, 0]])
        session = Session(float(rng.random()))
        found.append(Shot(("white", "red"), p, velocity, spin, np.arange(301) / 100, session=session))
    return found


def in_mujoco(model: Model) -> Model:
    return dataclasses.replace(model, engine="mujoco")


def begun(model: Model, shot: Shot, **given: Any) -> tuple[World, mujoco.MjData]:
    """A world in which a shot has just begun."""
    world = World(model, shot.names, **given)
    data = world.place(dict(zip(shot.names, shot.position, strict=True)))
    world.strike(data, shot.velocity[0], shot.spin[0], session=shot.session)
    return world, data


@pytest.mark.parametrize("name", ["base", *ACTING])
def test_shots_are_those_of_the_event_engine(name: str) -> None:
    model = CLOSED if name == "base" else CLOSED.add(effect_class(name)())
    given, impacts = shots(8, 5), 0
    away = []
    for one, other in zip(simulate(model, given), simulate(in_mujoco(model), given), strict=True):
        seen = [(e.kind, e.balls, e.rail) for e in one.events[:3]]
        until = one.events[3].time - 0.02 if len(one.events) > 3 else np.inf
        assert [(e.kind, e.balls, e.rail) for e in other.events[: len(seen)]] == seen
        away.append(np.abs(one.position - other.position)[one.times < until].max())
        impacts += len(seen)
    assert impacts >= 12
    assert np.median(away) < (8e-3 if name == LONGER_CONTACT else 2e-3)


def test_a_world_of_ones_own_loop_plays_what_simulate_does() -> None:
    [shot] = shots(1, 8)
    world, data = begun(CLOSED, shot)
    [track] = simulate(in_mujoco(CLOSED), [shot])
    for number in (40, 150, 300):
        world.advance(data, shot.times[number] - 1e-3)
        while data.time < shot.times[number] - 1e-9:
            before, then = data.qpos.reshape(-1, 7)[:, :2].copy(), data.time
            mujoco.mj_step(world.mj_model, data)
        share = (shot.times[number] - then) / (data.time - then)
        here = before + share * (data.qpos.reshape(-1, 7)[:, :2] - before)
        assert here == pytest.approx(track.position[number], abs=1e-6)


@pytest.mark.parametrize("jaws", [False, True])
def test_pots_are_those_of_the_event_engine(jaws: bool) -> None:
    """Whites at corners and middles, in the middle of the mouth and beside it."""
    half, rng = np.array([SNOOKER_TABLE.length, SNOOKER_TABLE.width]) / 2, np.random.default_rng(2)
    given = []
    for pocket in ([1, 1], [-1, 1], [0, 1], [0, -1], [1, -1]) * 6:
        target, start = half * pocket, rng.uniform(-0.5, 0.5, 2)
        way = target - start
        a = math.atan2(way[1], way[0]) + rng.uniform(-0.06, 0.06) / np.hypot(*way)
        aim, speed = np.array([math.cos(a), math.sin(a)]), rng.uniform(1.0, 2.5)
        roll = np.array([[-speed * aim[1] / RADIUS, speed * aim[0] / RADIUS, 0.0]])
        given.append(Shot(("white",), start[None], speed * aim[None], roll, np.arange(151) / 100))
    pots, away, marginal = [0, 0], [], 0
    tracks = zip(simulate(BASE, given, jaws=jaws), simulate(in_mujoco(BASE), given, jaws=jaws), strict=True)
    for one, other in tracks:
        potted = [any(e.kind == "pocket" for e in t.events) for t in (one, other)]
        if potted[0] != potted[1]:  # it rattles in the jaws, and a hair decides
            marginal += 1
            continue
        pots[int(potted[0])] += 1
        both = np.isfinite(one.position) & np.isfinite(other.position)
        assert (np.isnan(one.position) == np.isnan(other.position)).mean() > 0.98
        away.append(np.abs(one.position - other.position)[both].max())
    assert min(pots) > 3 and marginal <= jaws
    assert np.median(away) < 3e-3


def test_a_pack_of_balls_is_broken() -> None:
    spots = {n: xy for n, xy in racked(SNOOKER_TABLE, SNOOKER_BALL).items() if n.startswith("red")}
    names = ("white", *spots)
    places = np.array([spots["red 1"] - [0.3, -0.004], *spots.values()])
    start = np.zeros((len(names), 2))
    start[0] = 4.0, 0.0
    shot = Shot(names, places, start, np.zeros((len(names), 3)), np.arange(101) * 1e-3)
    [track], [found] = simulate(BASE, [shot]), simulate(in_mujoco(BASE), [shot])
    assert len(track.events) > 20 and len(found.events) > 20
    assert np.abs(found.position - track.position).max() < 2e-3


def test_accelerations_are_those_of_cloth_and_slope() -> None:
    slope = 0.004
    model = CLOSED.add(effect_class("table_tilt")(slope_x=slope))
    world, data = begun(
        model, Shot(("white",), np.zeros((1, 2)), np.array([[2.0, 0.0]]), np.zeros((1, 3)), np.zeros(1))
    )
    world.advance(data, 0.05)
    slide = model.parameters()["decoupled_cloth.slide"]
    mujoco.mj_forward(world.mj_model, data)
    assert data.qacc[0] == pytest.approx(-(slide - slope) * GRAVITY, rel=1e-3)
    assert RADIUS * data.qacc[4] == pytest.approx(2.5 * slide * GRAVITY, rel=1e-3)


def test_a_ball_lies_on_a_slope_that_friction_holds_and_rolls_down_a_steeper_one() -> None:
    for slope, moves in ((0.005, False), (0.03, True)):
        world = World(CLOSED.add(effect_class("table_tilt")(slope_x=slope)), ("white",))
        data = world.place({"white": (-0.5, 0.0)})
        world.advance(data, 1.0)
        assert (data.qpos[0] > -0.49) == moves
        assert world.rests(data) != moves


def test_contact_forces_add_up_to_the_impulse() -> None:
    smooth = CLOSED.with_values({"ball_impact.friction": 0.0})  # or the cloth takes some, under a ball pressed down
    world, data = begun(smooth, Shot(
        ("white", "red"), np.array([[-0.2, 0.0], [0.0, 0.0]]), np.array([[2.0, 0.0], [0.0, 0.0]]), np.zeros((2, 3)),
        np.zeros(1),
    ))  # fmt: skip
    impulse, largest, fastest, force = 0.0, 0.0, 0.0, np.zeros(6)
    while data.time < 0.15:
        mujoco.mj_step(world.mj_model, data)
        for number in range(data.ncon):
            if set(data.contact.geom[number]) == {data.geom("ball white").id, data.geom("ball red").id}:
                mujoco.mj_contactForce(world.mj_model, data, number, force)
                impulse += force[0] * world.mj_model.opt.timestep
                largest = max(largest, force[0])
        fastest = max(fastest, data.qvel[6])
    assert impulse == pytest.approx(MASS * fastest, rel=0.002)
    assert largest > 1000.0


def test_what_a_user_adds_lives_in_the_same_world() -> None:
    """A paddle on a slide, moved by a motor, drives a ball before it."""
    world = World(CLOSED, ("white",))
    spec = world.spec
    body = spec.worldbody.add_body(name="paddle", pos=[-0.3, 0.0, RADIUS])
    body.add_joint(name="slide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.05, 0.01], mass=1.0, contype=2, conaffinity=2)
    spec.add_actuator(name="motor", target="slide", trntype=mujoco.mjtTrn.mjTRN_JOINT, gainprm=[1.0] + [0.0] * 9)
    world.recompile()
    data = world.place({"white": (0.0, 0.0)})
    data.ctrl[0] = 1.0
    world.advance(data, 1.5)
    assert data.joint("slide").qpos[0] > 0.25
    assert data.joint("white").qpos[0] > 0.05
    assert data.joint("white").qpos[2] == pytest.approx(RADIUS, abs=1e-5)


def test_a_fast_tool_is_met_where_it_is() -> None:
    """A free block at 3 m/s: steps shrink before it touches, and momentum goes over to the ball."""
    world = World(CLOSED, ("white",))
    body = world.spec.worldbody.add_body(name="block", pos=[-0.3, 0.0, RADIUS])
    body.add_joint(name="slide", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0])
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.05, 0.01], mass=0.5, contype=2, conaffinity=2)
    world.recompile()
    data = world.place({"white": (0.0, 0.0)})
    data.joint("slide").qvel = 3.0
    while data.time < 0.2 and data.joint("white").qvel[0] == 0.0:
        mujoco.mj_step(world.mj_model, data)
    assert -3e-5 < data.contact.dist.min() < 0.0, "it comes no deeper in a step than 10 us let it"
    world.advance(data, data.time + 0.03)  # MuJoCo's usual contact is soft
    ball = data.joint("white").qvel[0]
    assert ball > 2.0
    assert 0.5 * data.joint("slide").qvel[0] + MASS * ball == pytest.approx(1.5, rel=0.02)


def test_a_look_between_steps_changes_nothing() -> None:
    [shot] = shots(1, 12)
    (world, data), (_, other) = begun(CLOSED, shot), begun(CLOSED, shot)
    while data.time < 1.0:
        mujoco.mj_step(world.mj_model, data)
        mujoco.mj_forward(world.mj_model, data)
        mujoco.mj_step(world.mj_model, other)
    assert data.qpos == pytest.approx(other.qpos, abs=1e-12)


def test_a_step_turns_the_balls() -> None:
    """A ball that rolls straight turns about the axis to the left of its way by the distance over its radius."""
    world = World(BASE, ("white",), marked=True)
    data = world.place({"white": (-1.0, 0.1)})
    world.strike(data, (1.0, 0.0), (0.0, 1.0 / RADIUS, 0.0))
    world.advance(data, 0.8)
    mujoco.mj_forward(world.mj_model, data)
    angle = (data.qpos[0] + 1.0) / RADIUS
    expected = np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])
    assert abs(float(expected @ data.qpos[3:7])) == pytest.approx(1.0, abs=1e-9)
    matrix = data.geom("ball white").xmat.reshape(3, 3)
    assert matrix @ data.qvel[3:6] == pytest.approx([0.0, data.qvel[0] / RADIUS, 0.0], abs=1e-9)
    assert data.geom("band white").xpos == pytest.approx([data.qpos[0], 0.1, RADIUS], abs=1e-6)


def test_what_is_changed_by_hand_is_played_on() -> None:
    world = World(BASE, ("white", "red"))
    data = world.place({"white": (-1.0, 0.0), "red": (0.0, 0.3)})
    world.advance(data, 0.02)
    assert world.rests(data)
    data.qvel[6:8] = 0.0, 1.0  # the red is pushed
    data.qpos[:3] = 0.5, 0.3, 0.1  # the white is lifted to elsewhere, and let go
    begin = data.time
    world.advance(data, begin + 0.05)
    assert 0.06 < data.qpos[2] < 0.1, "it falls"
    world.advance(data, begin + 0.5)
    assert data.qpos[:3] == pytest.approx([0.5, 0.3, RADIUS], abs=1e-5)
    shot = Shot(("red",), np.array([[0.0, 0.3]]), np.array([[0.0, 1.0]]), np.zeros((1, 3)), np.array([0.0, 0.5]))
    assert data.qpos[7:9] == pytest.approx(simulate(BASE, [shot])[0].position[-1, 0], abs=2e-3)


def test_a_potted_ball_hangs_below_until_it_is_put_back() -> None:
    world = World(BASE, ("white", "red"), jaws=True)
    data = world.place({"white": (1.3, 0.4), "red": (0.0, 0.0)})
    world.strike(data, 1.5 * np.array([0.4845, 0.489]) / 0.69)
    world.advance(data, 2.0)
    assert world.in_play(data) == ("red",)
    assert data.qpos[2] < -0.86 and world.rests(data)
    assert np.hypot(data.qpos[0] - SNOOKER_TABLE.length / 2, data.qpos[1] - SNOOKER_TABLE.width / 2) < 0.2
    data.qpos[:3], data.qvel[:6] = (-0.5, 0.0, RADIUS), 0.0
    world.advance(data, 2.1)
    assert world.in_play(data) == ("white", "red")
    world.strike(data, (1.0, 0.0))
    world.advance(data, 3.0)
    assert data.qvel[6] > 0.1, "it meets the red again"
    assert world.in_play(world.place({"red": (0.0, 0.0)}, data)) == ("red",)


def test_copies_and_states_take_along_what_a_shot_remembers() -> None:
    model = BASE.add(effect_class("cue_hop")(time_per_speed=0.1)).add(effect_class("off_centre_ball")(offset=0.02))
    world = World(model, ("white", "red"))
    data = world.place({"white": (-1.4, -0.3), "red": (1.0, 0.5)})
    world.strike(data, (2.0, 0.3), (20.0, 10.0, 30.0))
    world.advance(data, 0.12)
    other, third = mujoco.MjData(world.mj_model), World(model, ("white", "red"))
    mujoco.mj_copyData(other, world.mj_model, data)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(world.mj_model, kind))
    mujoco.mj_getState(world.mj_model, data, state, kind)
    again = mujoco.MjData(third.mj_model)
    mujoco.mj_setState(third.mj_model, again, state, kind)
    for who, what in ((world, data), (world, other), (third, again)):
        who.advance(what, 1.0)
    assert np.array_equal(data.qpos, other.qpos) and np.array_equal(data.qpos, again.qpos)
    mujoco.mj_resetData(world.mj_model, data)
    assert not data.userdata.any(), "and a reset forgets it"


def test_effects_of_the_stroke_act_on_what_was_commanded() -> None:
    world = World(BASE.add(effect_class("squirt")(per_offset=10.0)), ("white",))
    data = world.place({"white": (0.0, 0.0)})
    world.strike(data, (1.0, 0.0), (0.0, 0.0, 2.5 * 0.005 / RADIUS**2))
    assert math.atan2(data.qvel[1], data.qvel[0]) == pytest.approx(10.0 * 0.005)


def test_a_push_moves_a_ball() -> None:
    world = World(BASE, ("white",))
    data = world.place({"white": (0.0, 0.0)})
    slide = BASE.parameters()["decoupled_cloth.slide"]
    data.xfrc_applied[1, :3] = 0.0, 3.0, 0.0
    world.advance(data, 0.05)
    assert data.qvel[1] == pytest.approx((3.0 / MASS - slide * GRAVITY) * data.time, rel=0.03)
    assert data.qpos[2] == pytest.approx(RADIUS, abs=1e-6)


def test_dm_control_steps_and_draws_it(gl: str) -> None:
    world = World(BASE, ("white", "red"), furnished=True)
    physics = dm_mujoco.Physics.from_model(wrapper.MjModel(world.mj_model))
    world.place({"white": (-1.0, 0.0), "red": (0.0, 0.0)}, physics.data.ptr)
    before = physics.render(240, 320, camera_id="overhead")
    world.strike(physics.data, (2.0, 0.0))
    while physics.time() < 1.0:
        physics.step()
    after = physics.render(240, 320, camera_id="overhead")
    assert physics.named.data.qpos["red"][0] > 0.2
    changed = np.abs(after.astype(int) - before).max(axis=2) > 40
    assert 4 < changed.sum() < 2000


def test_models_of_others_are_left_alone() -> None:
    World(BASE, ("white",))
    xml = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    mujoco.mj_step(model, data)
    assert data.qvel[2] == pytest.approx(-GRAVITY * model.opt.timestep)
    assert model.opt.timestep == 0.002


def test_bad_input_is_named() -> None:
    world = World(BASE, ("white", "red"))
    with pytest.raises(BadInput, match="'blue' is no ball of this world; choose from white, red"):
        world.place({"blue": (0.0, 0.0)})
    with pytest.raises(ValueError, match="give finite numbers"):
        world.strike(world.place({}), (math.nan, 0.0))
