"""Tables by name: sizes, what their pockets let in, mirror symmetry, and the same fate of shots in both engines."""

from __future__ import annotations

import dataclasses
import itertools
import math
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from models.analytic.pocket import JAW_RAILS, jaw_gaps, pockets_of
from models.effect_catalogue import effect_class
from models.engine.play import Result, finish, play
from models.errors import BadInput
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from models.table.pocket_shape import INCH_M, PocketShape
from models.table.presets import TABLE_SETS, find_table, usual_mass

Array = NDArray[np.float64]
CORNER, MIDDLE = (1, 1), (0, 1)
WAY_M, ROLL_M_S2 = 0.25, 0.0127 * 9.81
STEP_M = 5e-4
POOLS = ("pool 9 ft", "pool 8 ft", "pool 7 ft")
SIDES = ((1, 1), (0, 1), (-1, 1), (1, -1), (0, -1), (-1, -1))


POCKETED = [name for name, s in TABLE_SETS.items() if s.table.pockets]


@cache
def model(name: str) -> Model:
    """Mathavan's restitutions, for all balls."""
    values = {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}
    return full_model(TABLE_SETS[name].table, TABLE_SETS[name].ball).with_values(values)


def with_pocket(base: Model, which: str, **changed: float) -> Model:
    shapes = base.table.shapes
    one = dataclasses.replace(getattr(shapes, which), **changed)
    table = dataclasses.replace(base.table, pockets=dataclasses.replace(shapes, **{which: one}))
    return dataclasses.replace(base, table=table)


def half(table: Table) -> Array:
    return np.array([table.length, table.width]) / 2


def run(m: Model, p: Array, v: Array, until: float = 5.0) -> Result:
    w = np.stack([-v[..., 1], v[..., 0], np.zeros(v.shape[:-1])], axis=-1) / m.ball.radius
    return finish(m, p, v, w, jaws=True, events=40, until=until)


def half_width(m: Model, sides: tuple[int, int], speed: float, degrees: float = 0.0) -> float:
    """Half the widest range of offsets without a gap that falls, of balls that roll past a pocket's place [m]."""
    offset = np.arange(-0.1, 0.1 + STEP_M, STEP_M)
    angle = math.atan2(sides[1], sides[0]) + math.radians(degrees)
    u = np.array([math.cos(angle), math.sin(angle)])
    p = half(m.table) * sides - WAY_M * u + offset[:, None] * np.array([-u[1], u[0]])
    v = np.tile(math.sqrt(speed**2 + 2 * ROLL_M_S2 * WAY_M) * u, (len(offset), 1))
    falls = run(m, p[:, None], v[:, None]).potted[:, 0]
    falls &= (np.abs(p) <= m.table.centre_limits(m.ball)).all(axis=1)
    return max((len(list(g)) - 1 for fell, g in itertools.groupby(falls) if fell), default=0) * STEP_M / 2


def into_pockets(m: Model, n: int, seed: int) -> list[Shot]:
    """Balls on their way to all pockets, their noses and facings."""
    noise, made, h = np.random.default_rng(seed), [], half(m.table)
    for k in range(n):
        sides = np.array(SIDES[k % 6])
        angle = math.atan2(sides[1], sides[0]) + noise.uniform(-0.5, 0.5)
        u = np.array([math.cos(angle), math.sin(angle)])
        p = h * sides - noise.uniform(0.3, 0.45) * u + noise.uniform(-0.07, 0.07) * np.array([-u[1], u[0]])
        v = noise.uniform(0.6, 3.0) * u
        spin = np.array([-v[1] / m.ball.radius, v[0] / m.ball.radius, noise.uniform(-30, 30)])
        made.append(Shot(("a",), np.clip(p, 0.03 - h, h - 0.03)[None], v[None], spin[None], np.linspace(0, 3, 31)))
    return made


def fate(track: Track) -> list[tuple[str, str]]:
    return [(e.kind, e.rail) for e in track.events]


def test_sizes_are_those_of_the_specifications() -> None:
    shapes = TABLE_SETS["pool 9 ft"].table.shapes
    bounds = {  # WPA, Tournament Table and Equipment Specifications, 9
        "corner": ((4.5, 4.625), (1.0, 2.25), (141.0, 143.0)),
        "middle": ((5.0, 5.125), (0.0, 0.375), (103.0, 105.0)),
    }
    for which, (mouth, shelf, cut) in bounds.items():
        shape: PocketShape = getattr(shapes, which)
        found = (shape.mouth / INCH_M, shape.shelf / INCH_M, math.degrees(shape.cut_angle))
        assert all(low <= value <= high for value, (low, high) in zip(found, (mouth, shelf, cut), strict=True))
    sizes = {name: (s.table.length, s.table.width) for name, s in TABLE_SETS.items()}
    assert sizes["snooker"] == (3.569, 1.778)
    assert sizes["pool 9 ft"] == pytest.approx((2.54, 1.27)) and sizes["pool 8 ft"] == pytest.approx((2.3368, 1.1684))
    assert sizes["pool 8 ft home"] == pytest.approx((2.2352, 1.1176)), "88 by 44 in"
    for name in (*POOLS, "pool 8 ft home"):
        ball = TABLE_SETS[name].ball
        assert ball.diameter == pytest.approx(0.05715) and 0.156 <= ball.mass <= 0.1701


@pytest.mark.parametrize(
    ("text", "name"),
    [("8ft", "pool 8 ft"), ("Pool 9 FT", "pool 9 ft"), ("pool-7-foot", "pool 7 ft"), ("12ft", "snooker"),
     ("snooker 12 ft", "snooker"), ("CAROM", "carom"),
     ("8 ft home", "pool 8 ft home"), ("88x44in", "pool 8 ft home")],
)  # fmt: skip
def test_names_of_tables_may_be_written_several_ways(text: str, name: str) -> None:
    assert find_table(text) is TABLE_SETS[name]


@pytest.mark.parametrize(
    ("text", "told"),
    [("poll 8 ft", 'did you mean "pool 8 ft"'), ("pool 6 ft", "give one of"), ("snooker 10 ft", "full size of 12 ft"),
     ("1x2", "the longer first"), ("3.5x", "the longer first"), ("8 ft tournament", "88 by 44 in, \"pool 8 ft home\""),
      ("", "give one of")],
)  # fmt: skip
def test_a_table_that_is_not_known_names_what_is_near(text: str, told: str) -> None:
    assert find_table("1.881x0.943") == Table(1.881, 0.943)
    with pytest.raises(BadInput, match=told):
        find_table(text)


def test_a_ball_of_a_game_s_size_weighs_what_that_game_s_ball_does() -> None:
    for name, known in TABLE_SETS.items():
        mass, game = usual_mass(known.ball.diameter)
        assert mass == pytest.approx(known.ball.mass) and game == name.split()[0]
    assert usual_mass(0.048)[0] == pytest.approx(0.1406 * (0.048 / 0.0525) ** 3)


@pytest.mark.parametrize("name", POCKETED)
@pytest.mark.parametrize(("which", "sides"), [("corner", CORNER), ("middle", MIDDLE)])
def test_a_slow_ball_falls_as_far_off_as_the_acceptance_says(name: str, which: str, sides: tuple[int, int]) -> None:
    shape: PocketShape = getattr(model(name).table.shapes, which)
    assert half_width(model(name), sides, 0.3) == pytest.approx(shape.acceptance, abs=1e-3)


@pytest.mark.parametrize("name", POCKETED)
@pytest.mark.parametrize(("which", "sides"), [("corner", CORNER), ("middle", MIDDLE)])
def test_wider_mouths_let_in_more(name: str, which: str, sides: tuple[int, int]) -> None:
    mouth = getattr(model(name).table.shapes, which).mouth
    for speed, degrees in itertools.product((0.3, 2.0), (0.0, 15.0)):
        widths = [
            half_width(with_pocket(model(name), which, mouth=mouth + more), sides, speed, degrees)
            for more in (-0.008, 0.0, 0.008)
        ]
        assert min(np.diff(widths)) > 0.002


def test_a_deep_shelf_is_harder_at_speed() -> None:
    widths = [
        half_width(with_pocket(model("pool 9 ft"), "corner", shelf=inches * INCH_M), CORNER, 3.0, 30.0)
        for inches in (1.0, 1.625, 2.25)
    ]
    assert min(-np.diff(widths)) > 0.001


@pytest.mark.parametrize("name", POOLS)
def test_facings_go_on_from_the_noses_at_the_cut_and_end_behind_the_edge(name: str) -> None:
    table, ball = TABLE_SETS[name].table, TABLE_SETS[name].ball
    found = pockets_of(table, ball)
    assert len(found.jaws) == len(JAW_RAILS) == 24
    for k in range(12):
        (cx, cy, reach, _, _), (x, y, length, nx, ny) = found.jaws[k], found.jaws[12 + k]
        assert np.hypot(nx, ny) == pytest.approx(1.0)
        assert nx * (x - cx) + ny * (y - cy) == pytest.approx(-reach, abs=2e-10)
        ends = np.array([x, y]) + length * np.array([[-ny, nx], [ny, -nx]])
        assert np.hypot(*(ends - [cx, cy]).T).min() == pytest.approx(reach, abs=2e-10)
        deep = np.linalg.norm(ends[:, None] - found.falls[:, :2], axis=-1) - found.falls[:, 2]
        assert -2e-3 < deep.min() < 0.0
        out = np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])[JAW_RAILS[k]]
        shape = table.shapes.middle if k in (6, 7, 10, 11) else table.shapes.corner
        assert out @ [nx, ny] == pytest.approx(math.cos(math.pi - shape.cut_angle))


@pytest.mark.parametrize("name", POOLS)
@pytest.mark.parametrize("flip", [(-1, 1), (1, -1)])
def test_mirrored_shots_end_mirrored(name: str, flip: tuple[int, int]) -> None:
    shots = into_pockets(model(name), 120, 3)
    p, v = (np.array([getattr(s, key) for s in shots]) for key in ("position", "velocity"))
    there, back = run(model(name), p, v, 2.0), run(model(name), p * flip, v * flip, 2.0)
    assert np.array_equal(there.potted, back.potted) and np.array_equal(there.counts, back.counts)
    assert np.abs(back.position * flip - there.position).max() < 1e-6


@pytest.mark.parametrize(
    ("name", "effect"),
    [*((name, "") for name in POCKETED), *(("pool 9 ft", e) for e in ("table_tilt", "slide_friction_speed"))],
)
def test_shots_have_the_same_fate_in_both_engines(name: str, effect: str) -> None:
    m = model(name).add(effect_class(effect)()) if effect else model(name)
    shots = into_pockets(m, 102, 8)
    tracks = play(m, shots, jaws=True)
    far = []
    for a, b in zip(tracks, simulate(dataclasses.replace(m, engine="mujoco"), shots, jaws=True), strict=True):
        if fate(a) == fate(b):
            far.append(np.nanmax(np.abs(a.position - b.position)))
    assert len(far) > 0.93 * len(shots), "but for those that rattle, where a hair decides"
    assert np.median(far) < 2e-3
    kinds = [[e.kind for e in track.events] for track in tracks]
    assert 30 < sum("pocket" in k for k in kinds) < 90
    assert sum(k[:2] == ["cushion", "pocket"] for k in kinds) > 10  # off a jaw
    assert sum(k.count("cushion") > 1 and "pocket" not in k for k in kinds) > 10  # rattled, or round the table


@pytest.mark.parametrize("name", POOLS)
def test_no_ball_rests_in_a_jaw_or_over_an_edge(name: str) -> None:
    m = model(name)
    found = pockets_of(m.table, m.ball)
    shots = into_pockets(m, 1200, 5)
    p, v = (np.array([getattr(s, key) for s in shots]) for key in ("position", "velocity"))
    end = run(m, p, v, until=math.inf)
    assert np.isfinite(end.time).all() and not end.velocity[~end.potted].any()
    hits = end.event[..., 2][end.event[..., 0] == 1]
    assert (hits >= 16).sum() > 100  # at facings
    rest = end.position[~end.potted]
    assert jaw_gaps(rest, found.jaws).min() > -1e-9
    over = np.linalg.norm(rest[:, None] - found.falls[:, :2], axis=-1) - found.falls[:, 2]
    assert over.min() > -1e-9


def test_pockets_that_cannot_be_are_refused() -> None:
    table, ball = TABLE_SETS["pool 9 ft"].table, TABLE_SETS["pool 9 ft"].ball
    with pytest.raises(BadInput, match=r"120\.0 mm"):
        pockets_of(table, Ball(0.12, 1.0))
    closed = with_pocket(model("pool 9 ft"), "corner", cut_angle=2.9, shelf=0.09).table
    with pytest.raises(BadInput, match=r"57\.1 mm"):  # the facings close before the slate ends
        pockets_of(closed, ball)
