"""The event engine: invariants, closed forms, events, and the MuJoCo world as a second opinion."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.analytic.cloth import state_at
from models.analytic.events import first_fall, meeting
from models.analytic.geometry import Parabola
from models.effect_catalogue import catalogue
from models.engine.play import Layout, Result, finish, lacking, play
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from models.table.snooker import racked

Array = NDArray[np.float64]
BALL = Ball(0.0525, 0.1406)
R = BALL.radius
TABLE, OPEN = Table(3.569, 1.778), Table(3.569, 1.778, pockets=False)
BASE = {
    "decoupled_cloth.slide": 0.2, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
    "ball_impact.restitution": 0.89, "ball_impact.friction": 0.05,
    "cushion_impact.restitution": 0.98, "cushion_impact.friction": 0.14,
}  # fmt: skip
PUSHES = ("table_tilt", "air_drag", "side_curve", "spin_slide_coupling", "off_centre_ball", "cue_hop")


def world(table: Table = OPEN, effect: str = "", **values: object) -> Model:
    """The base with Mathavan's constants, and one more effect at its usual size."""
    model = full_model(table, BALL).with_values(BASE | {k.replace("__", "."): v for k, v in values.items()})
    return model.add(catalogue()[effect]()) if effect else model


def layouts(n: int, nball: int = 3, seed: int = 1) -> tuple[Array, Array, Array]:
    """Balls apart, the first on its way to the second, with spin."""
    noise = np.random.default_rng(seed)
    p, v, w = np.zeros((n, nball, 2)), np.zeros((n, nball, 2)), np.zeros((n, nball, 3))
    for s in range(n):
        while True:
            p[s] = noise.uniform([-1.6, -0.75], [1.6, 0.75], (nball, 2))
            gap = np.linalg.norm(p[s][:, None] - p[s][None], axis=-1) + np.eye(nball)
            if gap.min() > 0.06:
                break
        aim = (p[s, 1] - p[s, 0]) / np.linalg.norm(p[s, 1] - p[s, 0])
        v[s, 0] = noise.uniform(0.4, 3.0) * aim + noise.normal(0, 0.02, 2)
        w[s, 0] = noise.uniform(-40, 40, 3)
    return p, v, w


def energy(v: Array, w: Array) -> Array:
    """Over M/2: (n,) [m^2/s^2]."""
    return np.nansum(v**2, axis=(1, 2)) + 0.4 * R**2 * np.nansum(w**2, axis=(1, 2))


def run(p: Array, v: Array, w: Array, until: float = np.inf, model: Model | None = None) -> Result:
    return finish(model or world(), p, v, w, until, events=64)


@pytest.mark.parametrize("effect", ["", "air_drag", "spin_slide_coupling", "slide_friction_speed", "spin_decay_speed"])
def test_energy_never_rises_over_a_shot(effect: str) -> None:
    """Nor with effects that only take some away."""
    start = layouts(200)
    last = energy(start[1], start[2])
    for until in np.linspace(0.05, 4, 80):
        end = run(*start, until=float(until), model=world(effect=effect))
        now = energy(end.velocity, end.spin)
        assert (now <= last * (1 + 1e-7) + 1e-12).all()
        last = now


@pytest.mark.parametrize("effect", ["", *PUSHES])
def test_everything_comes_to_rest_on_the_table(effect: str) -> None:
    start = layouts(300)
    end = run(*start, model=world(effect=effect))
    assert np.array_equal(end.velocity, np.zeros_like(end.velocity))
    assert np.abs(end.spin).max() < 1e-9
    assert (np.abs(end.position) <= OPEN.centre_limits(BALL) + 1e-9).all()
    gap = np.linalg.norm(end.position[:, :, None] - end.position[:, None], axis=-1) + np.eye(3)
    assert gap.min() > 2 * R - 1e-9
    assert (end.counts[:, 0] > 0).mean() > 0.5


@pytest.mark.parametrize("effect", ["", "air_drag", "spin_slide_coupling"])
@pytest.mark.parametrize("flip", [(-1, 1), (1, -1)])
def test_mirrored_shots_end_mirrored(flip: tuple[int, int], effect: str) -> None:
    p, v, w = layouts(150)
    m = np.array(flip)
    turn = np.array([m[1], m[0], -1])  # spin is an axial vector
    model = world(effect=effect)
    there, back = run(p, v, w, 2.0, model), run(p * m, v * m, w * turn, 2.0, model)
    assert np.array_equal(there.counts, back.counts)
    # Rounding grows from impact to impact.
    assert np.quantile(np.abs(back.position * m - there.position), 0.99) < 1e-9


def test_shots_turned_on_an_open_cloth_end_turned() -> None:
    wide = world(Table(40.0, 40.0, pockets=False))
    p, v, w = layouts(100)
    c, s = np.cos(0.7), np.sin(0.7)
    m = np.array([[c, -s], [s, c]])
    turned = w.copy()
    turned[..., :2] = w[..., :2] @ m.T
    there, back = run(p, v, w, model=wide), run(p @ m.T, v @ m.T, turned, model=wide)
    assert (there.counts[:, 0] > 0).mean() > 0.3
    assert np.quantile(np.abs(there.position @ m.T - back.position), 0.99) < 1e-9


def test_without_friction_or_loss_motion_runs_backwards() -> None:
    p, v, w = layouts(100)
    ideal = world(
        decoupled_cloth__slide=0.0, decoupled_cloth__roll=0.0, decoupled_cloth__spin=1.0, ball_impact__friction=0.0,
        ball_impact__restitution=1.0, cushion_impact__friction=0.0, cushion_impact__restitution=1.0,
    )  # fmt: skip
    there = run(p, v, w * 0, 1.0, ideal)
    back = run(there.position, -there.velocity, there.spin, 1.0, ideal)
    few = there.counts[:, :3].sum(axis=1) <= 2
    assert few.sum() > 20 and (there.counts[few, :3].sum(axis=1) > 0).sum() > 10
    assert np.abs(back.position - p)[few].max() < 1e-8


@pytest.mark.parametrize("effect", ["", *PUSHES, "cue_ball_mass", "cushion_restitution_speed"])
def test_results_are_the_same_bytes_at_any_thread_count_and_again(effect: str) -> None:
    p, v, w = layouts(100)
    model = world(TABLE, effect)
    one, two, again = (finish(model, p, v, w, threads=k, events=16) for k in (1, 2, 2))
    alone = finish(model, p[7:8], v[7:8], w[7:8])
    for key in ("position", "velocity", "spin", "time", "event", "event_time"):
        assert getattr(one, key).tobytes() == getattr(two, key).tobytes() == getattr(again, key).tobytes()
    assert alone.position.tobytes() == one.position[7:8].tobytes()


def test_each_shot_may_have_its_own_parameters() -> None:
    met = int(np.argmax(run(*layouts(20)).counts[:, 0] > 0))
    p, v, w = (np.repeat(x[met : met + 1], 3, axis=0) for x in layouts(20))
    for name, effect, values in (
        ("decoupled_cloth.slide", "", [0.15, 0.2, 0.25]), ("table_tilt.slope_x", "table_tilt", [0.0, 0.001, -0.001]),
        ("ball_impact.friction", "", [0.0, 0.05, 0.2]),
    ):  # fmt: skip
        model = world(effect=effect)
        many = run(p, v, w, model=model.with_values({name: np.array(values)}))
        middle = run(p[:1], v[:1], w[:1], model=model.with_values({name: values[1]}))
        assert np.array_equal(many.position[1], middle.position[0])
        assert not np.array_equal(many.position[0], many.position[1])


def test_what_cannot_be_played_is_named() -> None:
    p, v, w = layouts(3)
    with pytest.raises(ValueError, match="velocity has shape"):
        run(p, v[:, :2], w)
    with pytest.raises(ValueError, match="position holds nan"):
        run(np.full_like(p, np.nan), v, w)
    with pytest.raises(ValueError, match="friction"):
        run(p, v, w, model=world(decoupled_cloth__roll=0.0))
    bare = dataclasses.replace(world(), effects=world().effects[1:])
    assert lacking(world()) == "" and "no effect for cloth" in lacking(bare)
    with pytest.raises(ValueError, match="does not play this model: it has no effect for cloth"):
        run(p, v, w, model=bare)


def test_a_parameter_that_is_off_changes_no_bit() -> None:
    p, v, w = layouts(20)
    plain = run(p, v, w)
    for name, kind in catalogue().items():
        off = {k: m["off"] for k, m in kind.parameters().items() if m["off"] is not None}
        if name.split("_")[0] != "decoupled" and not name.endswith("_impact"):
            same = run(p, v, w, model=world().add(kind(**off)))
            assert same.position.tobytes() == plain.position.tobytes(), name


def test_a_stun_shot_runs_its_length_and_stops_the_clock() -> None:
    end = run(np.zeros((1, 1, 2)), np.array([[[0.8, 0.0]]]), np.zeros((1, 1, 3)))
    length = (12 / (49 * 0.2) + 25 / (98 * 0.0127)) / 9.81 * 0.64
    assert end.position[0, 0] == pytest.approx([length, 0], abs=1e-12)
    assert end.counts[0].tolist() == [0, 0, 0, 2]


@pytest.mark.parametrize("until", [0.05, 0.3, 2.0])
def test_a_slide_follows_its_closed_form(until: float) -> None:
    p, v, w = (
        np.zeros((60, 1, 2)),
        *(np.random.default_rng(2).normal(0, s, (60, 1, k)) for s, k in ((1.0, 2), (40.0, 3))),
    )
    end = run(p, v, w, until, world(Table(40.0, 40.0, pockets=False)))
    for k in range(60):
        xy, speed, spin = state_at(until, (0, 0), v[k, 0], w[k, 0], R, 0.2, 0.0127, 22.0)
        assert end.position[k, 0] == pytest.approx(xy, abs=1e-12)
        assert end.velocity[k, 0] == pytest.approx(speed, abs=1e-12)
        assert end.spin[k, 0] == pytest.approx(spin, abs=1e-9)


def test_a_tilted_ball_rolls_its_parabola() -> None:
    """Down the slope 5/7 g slope works against the friction of rolling, up it with it, until the ball rests."""
    slope, speed = 0.002, 1.0
    model = world(Table(40.0, 40.0, pockets=False)).add(catalogue()["table_tilt"](slope_x=slope, slope_y=0.0))
    start = np.zeros((2, 1, 2)), np.array([[[speed, 0.0]], [[-speed, 0.0]]]), np.zeros((2, 1, 3))
    start[2][:, 0, 1] = start[1][:, 0, 0] / R
    end = run(*start, model=model)
    for k, sign in enumerate((1.0, -1.0)):
        brake = 9.81 * (0.0127 - sign * 5 / 7 * slope)
        assert end.position[k, 0] == pytest.approx([sign * speed**2 / (2 * brake), 0.0], abs=2e-6)


@pytest.mark.parametrize("speed", [0.0, 1e-9])
def test_a_ball_that_sets_off_from_rest_by_its_spin_meets_what_lies_ahead(speed: float) -> None:
    place, velocity, spin = np.array([[0.0, 0.0], [0.1, 0.0]]), np.zeros((2, 2)), np.zeros((2, 3))
    velocity[0, 0], spin[0, 1] = speed, 60.0
    first = simulate(world(), [Shot(("white", "red"), place, velocity, spin, np.linspace(0, 1, 5))])[0].events[0]
    assert first.time == pytest.approx(np.sqrt(2 * (0.1 - 2 * R) / (0.2 * 9.81)), abs=1e-7)


def test_the_ball_turns_at_the_nose() -> None:
    end = run(np.array([[[1.0, 0.0]]]), np.array([[[2.0, 0.0]]]), np.array([[[0.0, 2 / R, 0.0]]]), 1.0)
    v0 = 2.0
    way = OPEN.length / 2 - R * np.sqrt(0.84) - 1.0
    a = 0.0127 * 9.81
    assert end.event_time[0, 0] == pytest.approx((v0 - np.sqrt(v0**2 - 2 * a * way)) / a, abs=1e-12)
    assert end.event[0, 0].tolist() == [1, 0, 0]


@pytest.mark.parametrize(
    ("place", "aim", "falls"),
    [((0.0, 0.0), (1.7845, 0.889), True), ((0.3, 0.0), (0.3, 0.889), False), ((0.0, 0.0), (0.04, 0.889), True)],
)
def test_pockets_take_what_comes_into_their_mouths(
    place: tuple[float, float], aim: tuple[float, float], falls: bool
) -> None:
    d = np.subtract(aim, place)
    v = 2.0 * d / np.linalg.norm(d)
    end = run(np.array([[place]]), v[None, None], np.array([[[-v[1] / R, v[0] / R, 0]]]), 1.5, world(TABLE))
    assert end.potted[0, 0] == falls
    assert (end.counts[0, 2] == 1) == falls


def test_balls_held_between_others_come_to_an_end() -> None:
    # A row of touching balls between a cushion and a struck ball, and a close pack.
    d = 2 * R
    row = np.array([[OPEN.centre_limits(BALL)[0] - k * d, 0.0] for k in range(4)] + [[0.5, 0.001]])
    v = np.zeros((1, 5, 2))
    v[0, 4, 0] = 3.0
    end = run(row[None], v, np.zeros((1, 5, 3)))
    assert end.counts[0].sum() < 20_000
    gap = np.linalg.norm(end.position[0][:, None] - end.position[0][None], axis=-1) + np.eye(5)
    assert gap.min() > d - 1e-5


def compared(shots: list[Shot], model: Model) -> tuple[list[float], list[float], int]:
    """Largest distances to MuJoCo until the first impact, and until two after; number of other events."""
    before, after, other = [], [], 0
    for a, b in zip(play(model, shots), simulate(dataclasses.replace(model, engine="mujoco"), shots), strict=True):
        kinds = [[(e.kind, e.balls, e.rail) for e in track.events][:3] for track in (a, b)]
        other += kinds[0] != kinds[1]
        ends = [e.time for e in b.events] + [99.0] * 3
        first, third = a.times < ends[0], a.times < ends[2]
        before.append(float(np.abs(a.position[first] - b.position[first]).max()))
        before.append(R * float(np.abs(a.theta[first] - b.theta[first]).max()))
        if kinds[0] == kinds[1]:
            assert np.array_equal(np.isnan(a.position[third]), np.isnan(b.position[third]))
            after.append(float(np.nanmax(np.abs(a.position[third] - b.position[third]))))
    return before, after, other


def shots_of(p: Array, v: Array, w: Array, times: Array) -> list[Shot]:
    return [Shot(tuple("abc"[: p.shape[1]]), *parts, times) for parts in zip(p, v, w, strict=True)]


def broken(clusters: bool, times: Array, mirror: int = 1) -> Track:
    """A full-power break of the 22 balls."""
    places = racked(TABLE, BALL)
    names = ("white", *(n for n in places if n != "white"))
    xy = np.array([places[n] for n in names]) * [1, mirror]
    to = xy[names.index("red 1")] + [0.0, 0.01 * mirror] - xy[0]
    v = np.zeros((22, 2))
    v[0] = 8.0 * to / np.hypot(*to)
    return play(world(TABLE), [Shot(names, xy, v, np.zeros((22, 3)), times)], clusters=clusters)[0]


def test_a_rack_breaks_with_momentum_order_and_no_gain() -> None:
    times = np.linspace(0, 12, 601)
    through, two_by_two = (broken(clusters, times) for clusters in (True, False))
    for track in (through, two_by_two):
        kinetic = np.nansum(track.velocity**2, axis=(1, 2)) + 0.4 * R**2 * np.nansum(track.spin**2, axis=(1, 2))
        assert (np.diff(kinetic) <= 2e-4 * kinetic[0]).all(), "springs hold some for a moment"
        assert kinetic[-1] < 1e-3 * kinetic[0]
        gap = np.linalg.norm(track.position[:, :, None] - track.position[:, None], axis=-1) + np.eye(22)
        assert np.nanmin(gap) > 2 * R - 1e-4
        inside = np.abs(track.position[np.isfinite(track.position[..., 0])])
        assert (inside <= np.array([TABLE.length, TABLE.width]) / 2).all()
        names = [n for e in track.events if e.kind == "ball" for n in e.balls]
        assert sum(n.startswith("red") for n in set(names)) == 15
    assert not np.array_equal(through.position[100], two_by_two.position[100])


def test_potted_balls_are_not_a_number_from_then_on() -> None:
    times, some = np.linspace(0, 4, 401), 0
    p, v, w = layouts(60, seed=3)
    to = np.array([TABLE.length, TABLE.width]) / 2 * np.sign(p[:, 0]) - p[:, 0]
    v[:, 0] = 2.5 * to / np.linalg.norm(to, axis=1, keepdims=True)  # at the nearest corner
    for track in play(world(TABLE), shots_of(p, v, 0 * w, times)):
        for event in (e for e in track.events if e.kind == "pocket"):
            k, gone = track.names.index(event.balls[0]), times > event.time
            some += 1
            for values in (track.position, track.velocity, track.spin, track.theta):
                assert np.isnan(values[gone, k]).all() and np.isfinite(values[~gone, k]).all()
            assert event.place is not None and np.hypot(*event.place) > 0.8
    assert some > 5


coefficients = st.floats(-2, 2, allow_subnormal=False)


@settings(max_examples=300, derandomize=True)
@given(c=st.lists(coefficients, min_size=4, max_size=4), start=st.floats(1e-3, 1), h=st.floats(0.05, 5))
def test_the_first_fall_is_the_first(c: list[float], start: float, h: float) -> None:
    t = float(first_fall(start, *c, h))
    value = np.polynomial.Polynomial([start, *c])
    grid = np.linspace(0, min(t, h), 2001)
    scale = 1 + np.abs(value(grid)).max()
    assert (value(grid) > -1e-12 * scale).all()
    if t <= h:
        assert abs(value(t)) < 1e-9 * scale


@settings(max_examples=300, derandomize=True)
@given(
    x=st.lists(st.floats(-1, 1), min_size=2, max_size=2), v=st.lists(st.floats(-3, 3), min_size=2, max_size=2),
    a=st.lists(st.floats(-3, 3), min_size=2, max_size=2), h=st.floats(0.01, 2),
)  # fmt: skip
def test_meetings_are_neither_missed_nor_made_up(x: list[float], v: list[float], a: list[float], h: float) -> None:
    if np.hypot(*x) < 0.06:
        return
    t = float(meeting(Parabola(*x, *v, *a), 2 * R, h))
    grid = np.linspace(0, min(t, h), 4001)
    path = np.array(x) + np.outer(grid, v) + 0.5 * np.outer(grid**2, a)
    assert np.hypot(*path.T).min() > 2 * R - 1e-9
    if t <= h:
        assert np.hypot(*path[-1]) == pytest.approx(2 * R, abs=1e-9)


def test_a_layout_that_goes_to_another_process_takes_no_addresses_along() -> None:
    """Hooks are compiled anew there: addresses of this process would be read as code."""
    model = full_model(Table(3.569, 1.778), Ball(0.0525, 0.1406))
    layout = Layout(model, ("decoupled_cloth.roll",))
    here = layout.game(np.array([[0.01]]))
    other = pickle.loads(pickle.dumps(layout))
    assert layout.hooks and not other.hooks
    assert np.array_equal(other.game(np.array([[0.01]])).cloth, here.cloth) and other.hooks
