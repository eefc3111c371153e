"""A table in anyone's loop: the event engine's shots step by step, states changed by hand, copies, other programs."""

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

from models.errors import BadInput
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE, racked
from models.model_file import Model, catalogue, effect_class, full_model
from models.shot import Event, Session, Shot
from models.simulation.simulate import simulate
from models.simulation.step import World

Array = NDArray[np.float64]
BASE = full_model(SNOOKER_TABLE, SNOOKER_BALL)
CLOSED = full_model(dataclasses.replace(SNOOKER_TABLE, pockets=False), SNOOKER_BALL)  # where balls stay in play
RADIUS = SNOOKER_BALL.radius
DT, SPAN = 2e-3, 4.0  # [s]
IMPACTS = 4  # that are followed; beyond, errors of rounding grow into other shots
NEAR = 1e-4  # [m]
ON_TABLE = ("forces", "impact", "strike")  # hooks that act there, and not in the camera
ACTING = [n for n, kind in catalogue().items() if kind.opens(*ON_TABLE) and n not in {e.name() for e in BASE.effects}]


def shots(count: int, seed: int, dt: float = DT) -> list[Shot]:
    """A white that meets a red, with all kinds of spin."""
    rng, found = np.random.default_rng(seed), []
    while len(found) < count:
        p = rng.uniform([-1.5, -0.7], [1.5, 0.7], (2, 2))
        way = p[1] - p[0]
        if np.hypot(*way) < 0.15:
            continue
        aside, speed = rng.uniform(-1.2, 1.2) * RADIUS, rng.uniform(1.5, 3.5)
        a = math.atan2(way[1], way[0]) + aside / np.hypot(*way)
        aim, lever, (side, height) = (
            np.array([math.cos(a), math.sin(a)]),
            2.5 * speed / RADIUS,
            rng.uniform(-0.4, 0.4, 2),
        )
        flat = lever * height * np.array([-aim[1], aim[0]]) + 0.1 * lever * side * aim
        spin = np.array([[*flat, lever * side], [0, 0, 0]])
        times = np.arange(round(SPAN / dt) + 1) * dt
        velocity = np.array([speed * aim, [0, 0]])
        found.append(Shot(("white", "red"), p, velocity, spin, times, session=Session(float(rng.random()))))
    return found


def stepped(model: Model, shot: Shot, dt: float = DT, **given: Any) -> Array:
    """Places (n, nball, 2) [m] at all times of a shot, potted balls nan."""
    world = World(model, shot.names, timestep=dt, **given)
    data = world.place(dict(zip(shot.names, shot.position, strict=True)))
    world.strike(data, shot.velocity[0], shot.spin[0], session=shot.session)
    found = []
    for number in range(len(shot.times)):
        world.step(data, steps=number > 0)
        q = data.qpos.reshape(-1, 7)
        found.append(np.where(q[:, 2:3] > 0, q[:, :2], np.nan))
    assert data.time == pytest.approx(shot.times[-1])
    return np.array(found)


def followed(shot: Shot, events: tuple[Event, ...], dt: float = DT) -> int:
    """How many samples come before there are too many impacts, or balls that are being potted."""
    ends = [e.time for e in events[IMPACTS : IMPACTS + 1]] + [e.time for e in events if e.kind == "pocket"]
    return int(np.searchsorted(shot.times, min(ends, default=math.inf) - dt))


def test_a_ball_that_stops_in_a_rail_is_pushed_out_as_in_the_event_engine() -> None:
    """It is 3 mm in, and too slow to come out."""
    limit, v = float(SNOOKER_TABLE.centre_limits(SNOOKER_BALL)[1]), np.array([[0.0, -0.02], [0.0, 0.0]])
    start = np.array([[0.0, limit + 0.003], [1.0, 0.0]])
    shot = Shot(("white", "red"), start, v, np.zeros((2, 3)), np.arange(501) * DT)
    [track] = simulate(CLOSED, [shot])
    for end in (track.position[-1], stepped(CLOSED, shot)[-1]):
        np.testing.assert_allclose(end, [[0.0, limit], [1.0, 0.0]], atol=1e-9)


@pytest.mark.parametrize("name", ["base", *ACTING])
def test_steps_are_the_shots_of_the_event_engine(name: str) -> None:
    model = CLOSED if name == "base" else CLOSED.add(effect_class(name)())
    given, impacts = shots(4, 5), 0
    for shot, track in zip(given, simulate(model, given), strict=True):
        until = followed(shot, track.events)
        impacts += sum(e.time < shot.times[until - 1] for e in track.events)
        assert np.abs(stepped(model, shot)[:until] - track.position[:until]).max() < NEAR
    assert impacts > 8


@pytest.mark.parametrize("dt", [2.5e-4, 1e-2])
def test_any_step_will_do(dt: float) -> None:
    model = BASE.add(effect_class("table_tilt")()).add(effect_class("cue_hop")())
    given = shots(2, 6, dt)
    for shot, track in zip(given, simulate(model, given), strict=True):
        until = followed(shot, track.events, dt)
        assert np.abs(stepped(model, shot, dt)[:until] - track.position[:until]).max() < NEAR


@pytest.mark.parametrize("jaws", [False, True])
def test_pots_are_those_of_the_event_engine(jaws: bool) -> None:
    """The white follows the red along the diagonal, or beside it, into the corner and out of play."""
    corner = np.array([SNOOKER_TABLE.length, SNOOKER_TABLE.width]) / 2
    for aside in (0.0, 0.02):
        aim = np.array([1.0, 1.0]) / math.sqrt(2)
        places = np.array([corner - 0.9 * aim, corner - (0.4 + aside) * aim + [0.0, aside]])
        shot = Shot(("white", "red"), places, np.array([2.0 * aim, [0, 0]]), np.zeros((2, 3)), np.arange(1501) * DT)
        track = simulate(BASE, [shot], jaws=jaws)[0]
        found = stepped(BASE, shot, jaws=jaws)
        assert [e.kind for e in track.events].count("pocket") >= 1 - (aside > 0)
        both = ~np.isnan(track.position)
        assert (np.isnan(found) == ~both).mean() > 0.999
        assert np.abs(found - track.position)[both & ~np.isnan(found)].max() < NEAR


def test_a_pack_of_balls_is_broken_though_steps_end_while_they_touch() -> None:
    spots = {n: xy for n, xy in racked(SNOOKER_TABLE, SNOOKER_BALL).items() if n.startswith("red")}
    names = ("white", *spots)
    places = np.array([spots["red 1"] - [0.3, -0.004], *spots.values()])
    start = np.zeros((len(names), 2))
    start[0] = 4.0, 0.0
    for first in (0.0, 0.3e-3):  # the steps end elsewhere within the cluster
        shifted = places.copy()
        shifted[0, 0] -= 4.0 * first
        shot = Shot(names, shifted, start, np.zeros((len(names), 3)), np.arange(151) * DT)
        track, found = simulate(BASE, [shot])[0], stepped(BASE, shot)
        assert len(track.events) > 20
        until = int(np.searchsorted(track.times, track.events[0].time + 0.02))
        assert np.abs(found[:until] - track.position[:until]).max() < NEAR


def test_a_step_turns_the_balls() -> None:
    """A ball that rolls straight turns about the axis to the left of its way by the distance over its radius."""
    world = World(BASE, ("white",), marked=True)
    data = world.place({"white": (-1.0, 0.1)})
    world.strike(data, (1.0, 0.0), (0.0, 1.0 / RADIUS, 0.0))
    world.step(data, 400)
    angle = (data.qpos[0] + 1.0) / RADIUS
    expected = np.array([math.cos(angle / 2), 0.0, math.sin(angle / 2), 0.0])
    assert abs(float(expected @ data.qpos[3:7])) == pytest.approx(1.0, abs=1e-12)
    matrix = data.geom("ball white").xmat.reshape(3, 3)
    assert matrix @ data.qvel[3:6] == pytest.approx([0.0, data.qvel[0] / RADIUS, 0.0])
    assert data.geom("band white").xpos == pytest.approx([data.qpos[0], 0.1, RADIUS])


def test_what_is_changed_by_hand_is_played_on() -> None:
    world = World(BASE, ("white", "red"))
    data = world.place({"white": (-1.0, 0.0), "red": (0.0, 0.3)})
    world.step(data, 10)
    assert world.rests(data) and data.time == pytest.approx(10 * DT)
    data.qvel[6:8] = 0.0, 1.0  # the red is pushed
    data.qpos[:3] = 0.5, 0.3, 0.4  # the white is lifted to elsewhere, and let go
    world.step(data)
    assert data.qpos[:3] == pytest.approx([0.5, 0.3, RADIUS])
    assert data.qvel[7] < 1.0 and data.qpos[8] > 0.3
    shot = Shot(("red",), np.array([[0.0, 0.3]]), np.array([[0.0, 1.0]]), np.zeros((1, 3)), np.array([0.0, 0.5]))
    while data.time < 10 * DT + 0.5 - 1e-9:
        world.step(data)
    assert data.qpos[7:9] == pytest.approx(simulate(BASE, [shot])[0].position[-1, 0], abs=1e-9)


def test_a_potted_ball_is_out_of_play_until_it_is_put_back() -> None:
    world = World(BASE, ("white", "red"))
    data = world.place({"white": (1.3, 0.4), "red": (0.0, 0.0)})
    world.strike(data, 1.5 * np.array([0.4845, 0.489]) / 0.69)
    world.step(data, 1000)
    assert world.in_play(data) == ("red",)
    assert data.qpos[2] < -0.86 and not data.qvel[:6].any() and world.rests(data)
    data.qpos[:3] = -0.5, 0.0, RADIUS
    world.step(data)
    assert world.in_play(data) == ("white", "red")
    world.strike(data, (1.0, 0.0))
    world.step(data, 400)
    assert data.qvel[6] > 0.1, "it meets the red again"
    assert world.in_play(world.place({"red": (0.0, 0.0)}, data)) == ("red",)


def test_copies_and_states_take_along_what_a_shot_remembers() -> None:
    model = BASE.add(effect_class("cue_hop")(time_per_speed=0.1)).add(effect_class("off_centre_ball")(offset=0.02))
    world = World(model, ("white", "red"))
    data = world.place({"white": (-1.4, -0.3), "red": (1.0, 0.5)})
    world.strike(data, (2.0, 0.3), (20.0, 10.0, 30.0))
    world.step(data, 60)
    other, third = mujoco.MjData(world.mj_model), World(model, ("white", "red"))
    mujoco.mj_copyData(other, world.mj_model, data)
    kind = mujoco.mjtState.mjSTATE_INTEGRATION
    state = np.empty(mujoco.mj_stateSize(world.mj_model, kind))
    mujoco.mj_getState(world.mj_model, data, state, kind)
    again = mujoco.MjData(third.mj_model)
    mujoco.mj_setState(third.mj_model, again, state, kind)
    for who, what in ((world, data), (world, other), (third, again)):
        who.step(what, 500)
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
    data.xfrc_applied[1, :3] = 0.0, 3.0, 5.0
    world.step(data, 25)
    data.xfrc_applied[:] = 0.0
    assert data.qvel[1] == pytest.approx((3.0 / SNOOKER_BALL.mass - 0.2 * 9.81) * 0.05, rel=0.02)
    assert data.qpos[2] == RADIUS


def test_dm_control_plays_and_draws_it(gl: str) -> None:
    world = World(BASE, ("white", "red"), furnished=True)
    physics = dm_mujoco.Physics.from_model(wrapper.MjModel(world.mj_model))
    world.place({"white": (-1.0, 0.0), "red": (0.0, 0.0)}, physics.data.ptr)
    before = physics.render(240, 320, camera_id="overhead")
    world.strike(physics.data, (2.0, 0.0))
    while physics.time() < 1.0:
        world.step(physics.data)
    after = physics.render(240, 320, camera_id="overhead")
    assert physics.named.data.qpos["red"][0] > 0.2
    changed = np.abs(after.astype(int) - before).max(axis=2) > 40
    assert 4 < changed.sum() < 2000


def test_bad_input_is_named() -> None:
    with pytest.raises(BadInput, match="no effect for cloth, ball, cushion; add decoupled_cloth"):
        World(Model(SNOOKER_TABLE, SNOOKER_BALL), ("white",))
    world = World(BASE, ("white", "red"))
    with pytest.raises(BadInput, match="'blue' is no ball of this world; choose from white, red"):
        world.place({"blue": (0.0, 0.0)})
    with pytest.raises(ValueError, match="give finite numbers"):
        world.strike(world.place({}), (math.nan, 0.0))
