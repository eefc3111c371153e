"""Whole shots in closed form: invariants, events, and the MuJoCo simulator as a second opinion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.analytic.events import first_fall, meeting
from models.analytic.shot import Constants, Result, finish, play
from models.model_file import full_model
from models.shot import Ball, Shot, Table
from models.simulate import simulate

Array = NDArray[np.float64]
BALL = Ball(0.0525, 0.1406)
R = BALL.radius
TABLE, OPEN = Table(3.569, 1.778), Table(3.569, 1.778, pockets=False)
CONSTANTS = Constants()


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


def run(p: Array, v: Array, w: Array, until: float = np.inf, table: Table = OPEN, **changed: object) -> Result:
    return finish(table, BALL, dataclasses.replace(CONSTANTS, **changed), p, v, w, until, events=64)  # type: ignore[arg-type]


def test_energy_never_rises_over_a_shot() -> None:
    start = layouts(200)
    last = energy(start[1], start[2])
    for until in np.linspace(0.05, 4, 80):
        end = run(*start, until=float(until))
        now = energy(end.velocity, end.spin)
        assert (now <= last * (1 + 1e-7)).all()
        last = now


def test_everything_comes_to_rest_on_the_table() -> None:
    start = layouts(300)
    end = run(*start)
    assert np.array_equal(end.velocity, np.zeros_like(end.velocity))
    assert np.abs(end.spin).max() < 1e-9
    assert (np.abs(end.position) <= OPEN.reach(BALL) + 1e-9).all()
    gap = np.linalg.norm(end.position[:, :, None] - end.position[:, None], axis=-1) + np.eye(3)
    assert gap.min() > 2 * R - 1e-9
    assert (end.counts[:, 0] > 0).mean() > 0.5


def test_events_come_in_order() -> None:
    end = run(*layouts(200), table=TABLE)
    for times, n in zip(end.event_time, end.counts[:, :3].sum(axis=1), strict=True):
        assert (np.diff(times[:n]) >= 0).all()
        assert np.isinf(times[n:]).all()


@pytest.mark.parametrize("flip", [(-1, 1), (1, -1)])
def test_mirrored_shots_end_mirrored(flip: tuple[int, int]) -> None:
    p, v, w = layouts(150)
    m = np.array(flip)
    turn = np.array([m[1], m[0], -1])  # spin is an axial vector
    there, back = run(p, v, w, 2.0), run(p * m, v * m, w * turn, 2.0)
    assert np.array_equal(there.counts, back.counts)
    # Rounding grows from impact to impact.
    assert np.quantile(np.abs(back.position * m - there.position), 0.99) < 1e-9


def test_shots_turned_on_an_open_cloth_end_turned() -> None:
    wide = Table(40.0, 40.0, pockets=False)
    p, v, w = layouts(100)
    c, s = np.cos(0.7), np.sin(0.7)
    m = np.array([[c, -s], [s, c]])
    turned = w.copy()
    turned[..., :2] = w[..., :2] @ m.T
    there, back = run(p, v, w, table=wide), run(p @ m.T, v @ m.T, turned, table=wide)
    assert (there.counts[:, 0] > 0).mean() > 0.3
    assert np.quantile(np.abs(there.position @ m.T - back.position), 0.99) < 1e-9


def test_without_friction_or_loss_motion_runs_backwards() -> None:
    p, v, w = layouts(100)
    ideal = {
        "slide": 0.0, "roll": 0.0, "spin": 0.0, "ball_friction": 0.0, "ball_restitution": 1.0, "cushion_friction": 0.0,
        "cushion_restitution": 1.0,
    }  # fmt: skip
    there = run(p, v, w * 0, 1.0, **ideal)
    back = run(there.position, -there.velocity, there.spin, 1.0, **ideal)
    few = there.counts[:, :3].sum(axis=1) <= 2
    assert few.sum() > 20 and (there.counts[few, :3].sum(axis=1) > 0).sum() > 10
    assert np.abs(back.position - p)[few].max() < 1e-8


def test_results_are_the_same_bytes_at_any_thread_count() -> None:
    p, v, w = layouts(100)
    one, two = (finish(TABLE, BALL, CONSTANTS, p, v, w, threads=k) for k in (1, 2))
    alone = finish(TABLE, BALL, CONSTANTS, p[7:8], v[7:8], w[7:8])
    assert one.position.tobytes() == two.position.tobytes()
    assert alone.position.tobytes() == one.position[7:8].tobytes()


def test_each_shot_may_have_its_own_constants() -> None:
    p, v, w = (np.repeat(x[:1], 3, axis=0) for x in layouts(1))
    many = run(p, v, w, slide=np.array([0.15, 0.2, 0.25]))
    assert np.array_equal(many.position[1], run(p[:1], v[:1], w[:1], slide=0.2).position[0])
    assert not np.array_equal(many.position[0], many.position[1])
    with pytest.raises(ValueError, match="slide"):
        run(p, v, w, slide=np.zeros(2))
    with pytest.raises(ValueError, match="friction"):
        run(p, v, w, roll=0.0)


def test_a_stun_shot_runs_its_length_and_stops_the_clock() -> None:
    end = run(np.zeros((1, 1, 2)), np.array([[[0.8, 0.0]]]), np.zeros((1, 1, 3)))
    length = (12 / (49 * 0.2) + 25 / (98 * 0.0127)) / 9.81 * 0.64
    assert end.position[0, 0] == pytest.approx([length, 0], abs=1e-12)
    assert end.counts[0].tolist() == [0, 0, 0, 2]


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
    end = run(np.array([[place]]), v[None, None], np.array([[[-v[1] / R, v[0] / R, 0]]]), 1.5, TABLE)
    assert end.potted[0, 0] == falls
    assert (end.counts[0, 2] == 1) == falls


def test_balls_held_between_others_come_to_an_end() -> None:
    # A row of touching balls between a cushion and a struck ball, and a close pack.
    d = 2 * R
    row = np.array([[OPEN.reach(BALL)[0] - k * d, 0.0] for k in range(4)] + [[0.5, 0.001]])
    v = np.zeros((1, 5, 2))
    v[0, 4, 0] = 3.0
    end = run(row[None], v, np.zeros((1, 5, 3)))
    assert end.counts[0].sum() < 20_000
    gap = np.linalg.norm(end.position[0][:, None] - end.position[0][None], axis=-1) + np.eye(5)
    assert gap.min() > d - 1e-5


def compared(p: Array, v: Array, w: Array, table: Table) -> tuple[list[float], list[float], int]:
    """Largest distances to models.simulate until the first impact, and until two after; number of other events."""
    names = tuple("abc"[: p.shape[1]])
    shots = [Shot(names, *parts, np.linspace(0, 5, 101)) for parts in zip(p, v, w, strict=True)]
    model = full_model(table, BALL).with_values(
        {
            "decoupled_cloth.slide": 0.2, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
            "ball_impact.restitution": 0.89, "ball_impact.friction": 0.05,
            "cushion_impact.restitution": 0.98, "cushion_impact.friction": 0.14,
        }
    )  # fmt: skip
    before, after, other = [], [], 0
    for a, b in zip(play(table, BALL, CONSTANTS, shots), simulate(model, shots), strict=True):
        kinds = [[(e.kind, e.balls, e.rail) for e in track.events][:3] for track in (a, b)]
        other += kinds[0] != kinds[1]
        ends = [e.time for e in b.events] + [99.0] * 3
        first, third = a.times < ends[0], a.times < ends[2]
        before.append(float(np.abs(a.position[first] - b.position[first]).max()))
        before.append(float(np.abs(a.theta[first] - b.theta[first]).max()))
        if kinds[0] == kinds[1]:
            assert np.array_equal(np.isnan(a.position[third]), np.isnan(b.position[third]))
            after.append(float(np.nanmax(np.abs(a.position[third] - b.position[third]))))
    return before, after, other


@pytest.mark.parametrize("table", [OPEN, TABLE], ids=["open", "pockets"])
def test_shots_agree_with_the_simulator(table: Table) -> None:
    before, after, other = compared(*layouts(40, seed=4), table)
    assert max(before) < 1e-9
    assert other == 0
    assert np.median(after) < 1e-9


def test_frictionless_impacts_agree_with_the_simulator_to_rounding() -> None:
    p, v, w = layouts(40, seed=6)
    shots = [Shot(("a", "b", "c"), *parts, np.linspace(0, 3, 61)) for parts in zip(p, v, w, strict=True)]
    constants = dataclasses.replace(CONSTANTS, ball_friction=0.0)
    model = full_model(OPEN, BALL).with_values(
        {
            "decoupled_cloth.slide": 0.2, "decoupled_cloth.roll": 0.0127, "decoupled_cloth.spin": 22.0,
            "ball_impact.restitution": 0.89, "ball_impact.friction": 0.0,
        }
    )  # fmt: skip
    some = 0
    for a, b in zip(play(OPEN, BALL, constants, shots), simulate(model, shots), strict=True):
        until = min([e.time for e in b.events if e.kind == "cushion"] + [99.0])
        use = a.times < until
        some += sum(e.time < until for e in b.events) > 0
        assert a.position[use] == pytest.approx(b.position[use], abs=1e-9)
        met = [e for e in b.events if e.time < until]
        assert [e.balls for e in a.events[: len(met)]] == [e.balls for e in met]
        assert [e.time for e in a.events[: len(met)]] == pytest.approx([e.time for e in met], abs=1e-10)
    assert some > 5


coefficients = st.floats(-2, 2, allow_subnormal=False)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(c=st.lists(coefficients, min_size=4, max_size=4), start=st.floats(1e-3, 1), h=st.floats(0.05, 5))
def test_the_first_fall_is_the_first(c: list[float], start: float, h: float) -> None:
    t = float(first_fall(start, *c, h))
    value = np.polynomial.Polynomial([start, *c])
    grid = np.linspace(0, min(t, h), 2001)
    scale = 1 + np.abs(value(grid)).max()
    assert (value(grid) > -1e-12 * scale).all()
    if t <= h:
        assert abs(value(t)) < 1e-9 * scale


@settings(max_examples=300, deadline=None, derandomize=True)
@given(
    x=st.lists(st.floats(-1, 1), min_size=2, max_size=2), v=st.lists(st.floats(-3, 3), min_size=2, max_size=2),
    a=st.lists(st.floats(-3, 3), min_size=2, max_size=2), h=st.floats(0.01, 2),
)  # fmt: skip
def test_meetings_are_neither_missed_nor_made_up(x: list[float], v: list[float], a: list[float], h: float) -> None:
    if np.hypot(*x) < 0.06:
        return
    t = float(meeting(*x, *v, *a, 2 * R, h))
    grid = np.linspace(0, min(t, h), 4001)
    path = np.array(x) + np.outer(grid, v) + 0.5 * np.outer(grid**2, a)
    assert np.hypot(*path.T).min() > 2 * R - 1e-9
    if t <= h:
        assert np.hypot(*path[-1]) == pytest.approx(2 * R, abs=1e-9)
