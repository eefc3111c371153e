"""Random shots break no law; those that once did, and what packs and mouths of pockets did wrong."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.engine.play import finish, play
from models.model_file import Model, full_model
from models.shot import GRAVITY, Ball, Shot, Table
from models.simulation.simulate import simulate
from tests.random_shots.draws import batch, picked
from tests.random_shots.laws import breaches
from tests.random_shots.laws import play as judged

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778)
D = BALL.diameter
ONCE_GIVEN_UP = [  # seed and row: packs and slopes, a grain that resists more once a ball rolls, pulls across the way
    (4, 3), (4, 26), (6, 4), (6, 9), (14, 28), (16, 8), (68, 17), (108, 29), (184, 29), (185, 50), (227, 54), (427, 9),
    (644, 51), (652, 23), (801, 12), (950, 34), (1086, 20), (1139, 43), (1336, 34), (1370, 35),  # beside mouths
    (788, 61), (745, 54),  # a nap nearly as strong as the resistance, a slope hardly stronger
]  # fmt: skip
ONCE_INSIDE = [(2, 47), (10, 60), (15, 0), (231, 33), (669, 9), (1023, 5)]  # behind a cushion, beside a mouth
ONCE_IN_RUBBER = [(845, 55), (1367, 8)]  # at rest there, since the cloth or another ball had stopped them
ONCE_NOWHERE = [(221, 26), (13, 2), (63, 41)]  # an approach whose square vanished; through facings
ONCE_TOO_NEAR = [(57, 57), (57, 58), (128, 44), (558, 32), (1205, 62), (1341, 54)]  # at a jaw, or in a pressed chain
ONCE_FASTER = [(154, 3), (588, 6), (835, 33), (871, 63)]  # in a turning roll, or without resistance to rolling
ONCE_RISING = [  # in energy, where a slope or a nap presses: sunk in at every sample, and then lying where it touches
    (202, 41), (274, 42), (425, 21), (442, 61), (572, 12), (670, 20), (1544, 12),
]  # fmt: skip

ONCE_DRIVEN = [(30011, 6)]  # by a slide's curve, which pushed as hard as spin and speed said
ONCE_THROWN = [(40350, 4), (100039, 18)]  # by a cushion into which a ball came from a mouth, beside a cluster


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 1, 3, 5, 9, 11, 12, 17])
def test_random_shots_break_no_law(seed: int) -> None:
    one = batch(seed, 64)
    assert breaches(one, judged(one)) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "row"), ONCE_GIVEN_UP + ONCE_INSIDE + ONCE_NOWHERE + ONCE_TOO_NEAR + ONCE_FASTER + ONCE_RISING
)
def test_shots_that_once_broke_a_law_break_none(seed: int, row: int) -> None:
    one = picked(batch(seed, 64, later=(), others=0.0), np.array([row]))
    assert breaches(one, judged(one)) == []


@pytest.mark.parametrize(("seed", "row"), ONCE_DRIVEN + ONCE_THROWN)
def test_nothing_gives_energy_on_any_table(seed: int, row: int) -> None:
    one = picked(batch(seed, 64), np.array([row]))
    assert breaches(one, judged(one)) == []


@pytest.mark.slow
@pytest.mark.parametrize(("seed", "row"), ONCE_IN_RUBBER)
def test_no_ball_rests_in_rubber(seed: int, row: int) -> None:
    one = picked(batch(seed, 64, others=0.0), np.array([row]))
    assert breaches(one, judged(one)) == []


def model(roll: float = 0.0127, effect: str = "", **values: float) -> Model:
    base = full_model(TABLE, BALL).with_values({"decoupled_cloth.roll": roll})
    return base.add(effect_class(effect)(**values)) if effect else base


def test_a_pack_that_is_pushed_along_comes_to_rest_in_few_events() -> None:
    """The struck ball rolls into a square of touching balls with much topspin, and drives them on."""
    places = np.array([(-0.2, 0.02)] + [(D * (1 + 1e-12) * i, D * (1 + 1e-12) * j) for i in range(4) for j in range(4)])
    v, w = np.zeros((1, 17, 2)), np.zeros((1, 17, 3))
    v[0, 0, 0], w[0, 0, 1] = 0.6, 150.0
    end = finish(model(), places[None], v, w, most=5000)
    assert np.isfinite(end.time).all()
    gaps = np.linalg.norm(end.position[0][:, None] - end.position[0], axis=-1) + np.eye(17)
    assert gaps.min() > D - 5e-6


def test_a_slope_holds_balls_to_a_cushion_at_rest() -> None:
    """Steeper than the rolling resistance: the ball lies at the cushion, and the shot comes to its end."""
    world = model(0.005, "table_tilt", slope_x=0.0, slope_y=0.009)
    end = finish(world, np.array([[[0.9, 0.5], [0.8, 0.2]]]), np.zeros((1, 2, 2)), np.zeros((1, 2, 3)), most=20_000)
    assert np.isfinite(end.time).all() and not end.velocity.any()
    assert end.position[0, :, 1] == pytest.approx(TABLE.centre_limits(BALL)[1], abs=1e-6)


def test_what_is_pressed_to_a_cushion_soon_no_longer_sinks_in() -> None:
    """A sample between two looks shows it in rubber, by less energy than it has at rest."""
    x = TABLE.centre_limits(BALL)[0]
    shot = Shot(("a",), np.array([[x, 0.3]]), np.zeros((1, 2)), np.zeros((1, 3)), np.linspace(0.06, 0.3, 481))
    for world in (model(0.005, "cloth_nap", push=0.087), model(0.005, "table_tilt", slope_x=0.009, slope_y=0.001)):
        track = play(world, [shot])[0]
        assert np.abs(track.position[:, 0, 0] - x).max() < 1e-9


def test_what_is_pressed_and_driven_along_is_not_held() -> None:
    """From rest, along a cushion without friction, by 0.02 m/s2 more than the resistance to rolling."""
    limits, roll, net = TABLE.centre_limits(BALL), 0.005, 0.02
    steep = 1.4 * (roll + net / GRAVITY)
    world = model(roll, "table_tilt", slope_x=0.1 * steep, slope_y=steep)
    world = world.with_values({"cushion_impact.friction": 0.0})
    end = finish(
        world, np.array([[[limits[0], 0.1]]]), np.zeros((1, 1, 2)), np.zeros((1, 1, 3)), until=3.0, most=20_000
    )
    assert end.position[0, 0] == pytest.approx([limits[0], 0.1 + 0.5 * net * 3.0**2], rel=0.02)


@pytest.mark.parametrize("engine", ["events", "mujoco"])
@pytest.mark.parametrize(("net", "speed"), [(2.2e-5, 0.0), (2.2e-5, 1e-3), (-2.2e-5, 1e-3), (0.02, 0.0)])
def test_a_slope_about_as_strong_as_the_resistance_drives_or_stops_a_ball_steadily(
    engine: str, net: float, speed: float
) -> None:
    """It rolls downhill; the errors of its direction are not what stops it, nor is it looked at without end."""
    roll, way, t = 0.008, np.array([0.6, 0.8]), np.linspace(0.0, 10.0, 21)
    steep = 1.4 * (roll + net / GRAVITY) * way
    world = model(roll, "table_tilt", slope_x=float(steep[0]), slope_y=float(steep[1]))
    world = dataclasses.replace(world, table=Table(9.0, 9.0, False), engine=engine)
    v = speed * way
    start = Shot(("a",), np.array([[-2.0, -2.0]]), v[None], np.array([[-v[1], v[0], 0.0]]) / BALL.radius, t)
    track = simulate(world, [start])[0]
    way_gone = speed * t + 0.5 * net * t * t
    near = 1e-6 if engine == "events" else 1e-3  # in MuJoCo a push is that of the middle of a step
    assert track.position[:, 0] == pytest.approx(start.position + way_gone[:, None] * way, abs=near)
    if engine == "events":
        end = finish(world, start.position[None], v[None, None], start.spin[None], until=10.0, most=1000)
        assert np.isfinite(end.time).all()


def test_a_ball_that_rolls_along_a_cushion_is_not_looked_at_without_end() -> None:
    """Nothing presses it, though an effect acts; its velocity away from the cushion is rounding."""
    world, y = model(0.001, "slide_friction_speed", rate=0.1), TABLE.centre_limits(BALL)[1]
    v, w = np.array([[[0.3, 5e-31]]]), np.array([[[0.0, 0.3 / BALL.radius, 0.0]]])
    end = finish(world, np.array([[[-0.8, y]]]), v, w, until=1.5, most=100)
    assert np.isfinite(end.time).all() and end.position[0, 0, 1] == pytest.approx(y, abs=1e-12)


def test_a_ball_that_is_hardly_moving_and_turned_comes_to_rest() -> None:
    """By a nap nearly as strong as the resistance: it crept for ever, by steps as bad as its speed."""
    world = model(0.00806737, "cloth_nap", push=0.1).add(
        effect_class("cloth_grain")(along=-0.04543285, diagonal=-0.13003884)
    )
    v = np.array([[[3.4334e-5, 1.0067e-5]]])
    w = np.array([[[-v[0, 0, 1], v[0, 0, 0], 0.0]]]) / BALL.radius
    end = finish(world, np.zeros((1, 1, 2)), v, w, most=200)
    assert np.isfinite(end.time).all() and not end.velocity.any()


@pytest.mark.slow
def test_a_pack_that_a_nap_drives_to_a_cushion_is_not_looked_at_too_often() -> None:
    """It took 141,518 events where each ball that is pressed was looked at by itself."""
    assert judged(picked(batch(8, 64, others=0.0), np.array([48]))).result.counts.sum() < 80_000


def test_a_corner_without_pocket_stops_what_leans_on_one_of_its_cushions() -> None:
    """What is pressed to one cushion, and has no look at it for a while, still meets the other."""
    closed = dataclasses.replace(
        model(0.001, "table_tilt", slope_x=0.009, slope_y=0.005), table=Table(2.84, 1.42, False)
    )
    limits = closed.table.centre_limits(BALL)
    shot = Shot(("a",), np.array([[1.3, 0.4]]), np.array([[0.1, 0.1]]), np.zeros((1, 3)), np.linspace(0, 12, 601))
    track = play(closed, [shot])[0]
    assert (np.abs(track.position[:, 0]) <= limits + 5e-6).all()


@pytest.mark.parametrize("engine", ["events", "mujoco"])
def test_what_leaves_a_mouth_sideways_is_the_pockets(engine: str) -> None:
    """It came in slowly beside the middle of the mouth, and would come to rest behind the cushion."""
    edge = TABLE.mouths()[1]
    start, v = np.array([[edge - 0.004, TABLE.centre_limits(BALL)[1] - 0.001]]), np.array([[0.04, 0.03]])
    w = np.array([[-v[0, 1] / BALL.radius, v[0, 0] / BALL.radius, 0.0]])
    shot = Shot(("a",), start, v, w, np.linspace(0, 2, 21))
    [track] = simulate(dataclasses.replace(model(), engine=engine), [shot])
    assert [e.kind for e in track.events] == ["pocket"] and np.isnan(track.position[-1]).all()


def test_no_resistance_to_rolling_drives_a_ball() -> None:
    fast = Shot(
        ("a",), np.zeros((1, 2)), np.array([[3.0, 0]]), np.array([[0, 3.0 / BALL.radius, 0]]), np.linspace(0, 1, 11)
    )
    wide = dataclasses.replace(model(0.005, "speed_drag", rate=-0.1), table=Table(9.0, 9.0, False))
    for track in (play(wide, [fast])[0], simulate(dataclasses.replace(wide, engine="mujoco"), [fast])[0]):
        assert (np.diff(track.velocity[:, 0, 0]) <= 1e-12).all()


def test_a_step_ends_where_rolling_resistance_vanishes() -> None:
    """A push drives the ball until a drag that is negative has taken all resistance: nothing else gives it energy."""
    world = model(0.001, "speed_drag", rate=-0.08).add(effect_class("cloth_nap")(push=0.08))
    start = Shot(
        ("a",), np.array([[-4.0, 0]]), np.array([[0.01, 0]]), np.array([[0, 0.01 / BALL.radius, 0]]),
        np.linspace(0, 10, 1001),
    )  # fmt: skip
    track = play(dataclasses.replace(world, table=Table(9.0, 9.0, False)), [start])[0]
    energy = 1.4 * track.velocity[:, 0, 0] ** 2 - 2 * 0.08 * track.position[:, 0, 0]
    assert np.diff(energy).max() < 1e-9


@pytest.mark.parametrize("slow", [True, False])
def test_what_leaves_a_mouth_soon_after_it_came_in_is_the_pockets(slow: bool) -> None:
    """It passes the line within the mouth, and is out of it sideways before it would be looked at again."""
    edge, line = TABLE.mouths()[1], TABLE.centre_limits(BALL)[1]
    v = np.array([[0.12 if slow else 1.2, 0.04 if slow else 0.4]])
    start = np.array([[edge - 0.00195, line - 0.0005]])
    shot = Shot(("a",), start, v, np.array([[-v[0, 1], v[0, 0], 0]]) / BALL.radius, np.linspace(0, 2, 21))
    [track] = play(model(), [shot])
    assert [e.kind for e in track.events] == ["pocket"] and np.isnan(track.position[-1]).all()


def test_a_ball_does_not_stay_in_cushions_of_no_restitution() -> None:
    """In a corner, where two springs that come back more slowly than the ball leave let it go first."""
    table, rng = dataclasses.replace(TABLE, pockets=False), np.random.default_rng(0)
    dead = dataclasses.replace(model().with_values({"cushion_impact.restitution": 0.3}), table=table)
    for name in ("cushion_restitution_px", "cushion_restitution_py"):
        dead = dead.add(effect_class(name)(change=-0.5))
    n, limits = 400, table.centre_limits(BALL)
    aside = np.stack([np.ones(n), rng.uniform(0.9999, 1.0001, n)], axis=1)
    v = rng.uniform(0.2, 4.0, (n, 1)) * np.full((n, 2), np.sqrt(0.5))
    end = finish(dead, (limits - 0.3 * aside)[:, None], v[:, None], rng.uniform(-100, 100, (n, 1, 3)))
    assert (end.position[:, 0] <= limits + 5e-6).all()
