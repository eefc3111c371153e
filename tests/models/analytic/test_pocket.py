"""Pockets with jaws and an edge: geometry, invariants, what they let in at which speed and angle, and bad input."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from models.analytic.events import in_mouth
from models.analytic.geometry import TableGeometry
from models.analytic.pocket import JAW_RAILS, outward, pockets_of, rail_of, straight
from models.engine.play import Result, finish, play
from models.errors import BadInput
from models.model_file import full_model
from models.shot import NOSE_COSINE, Ball, Shot, Table
from models.table.pocket_shape import SNOOKER_POCKETS, PocketShape, PocketShapes

Array = NDArray[np.float64]
BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778)
R = BALL.radius
HALF = np.array([TABLE.length, TABLE.width]) / 2
REACH = TABLE.centre_limits(BALL)
POCKETS = pockets_of(TABLE, BALL)
VALUES = {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}  # Mathavan 2010, 2014
MODEL = full_model(TABLE, BALL).with_values(VALUES)
CORNER, MIDDLE = (1, 1), (0, 1)
CLEAN = 0.045 - R  # room on either side of the axis at the narrowest place [m]
WAY = 0.25  # from where balls start to the pocket [m]
ROLL = 0.0127 * 9.81  # [m/s^2]


def rolling(v: Array) -> Array:
    """The spin of balls that roll at velocities (..., 2)."""
    return np.stack([-v[..., 1] / R, v[..., 0] / R, np.zeros_like(v[..., 0])], axis=-1)


def approach(sides: tuple[int, int], speed: float, angle: float, offset: Array) -> tuple[Array, Array]:
    """Position and velocity (n, 1, 2) of balls that roll past a pocket's middle at a speed and at offsets (n,).

    Direction: the pocket's axis turned by an angle; offsets to the left of it.
    """
    axis = np.array(sides) / np.hypot(*sides)
    c, s = np.cos(angle), np.sin(angle)
    u = np.array([c * axis[0] - s * axis[1], s * axis[0] + c * axis[1]])
    p = HALF * sides - WAY * u + offset[:, None] * np.array([-u[1], u[0]])
    v = np.tile(np.sqrt(speed**2 + 2 * ROLL * WAY) * u, (len(offset), 1))
    return p[:, None], v[:, None]


def run(p: Array, v: Array, w: Array | None = None, *, jaws: bool = True, **more: object) -> Result:
    spin = rolling(v) if w is None else w
    return finish(MODEL, p, v, spin, jaws=jaws, events=40, **more)  # type: ignore[arg-type]


def half_width(sides: tuple[int, int], speed: float, degrees: float) -> float:
    """Half the widest range of offsets without a gap that falls into the pocket, at starts clear of the cushions."""
    offset = np.arange(-0.08, 0.0801, 0.0005)
    p, v = approach(sides, speed, np.radians(degrees), offset)
    end = run(p, v, until=5.0)
    falls = end.potted[:, 0] & (np.abs(p[:, 0]) <= REACH).all(axis=1)
    return max((len(list(g)) - 1 for fell, g in itertools.groupby(falls) if fell), default=0) * 0.0005 / 2


def near_pockets(n: int, seed: int = 2, nball: int = 4) -> tuple[Array, Array, Array]:
    """Balls that lie and run close to a pocket, none in another, in a jaw or over an edge."""
    noise = np.random.default_rng(seed)
    p, v, w = np.zeros((n, nball, 2)), np.zeros((n, nball, 2)), np.zeros((n, nball, 3))
    for s in range(n):
        centre = (HALF - 0.08) if s % 2 else np.array([0.0, HALF[1] - 0.08])
        while True:
            p[s] = centre + noise.uniform(-0.16, 0.16, (nball, 2))
            gap = np.linalg.norm(p[s][:, None] - p[s][None], axis=-1) + np.eye(nball)
            if gap.min() > 2 * R and (np.abs(p[s]) <= REACH).all() and clear(p[s]).min() > 0:
                break
        v[s, : 1 + s % 3] = noise.normal(0, 1.5, (1 + s % 3, 2))
        w[s, : 1 + s % 3] = noise.normal(0, 60, (1 + s % 3, 3))
    return p, v, w


def clear(xy: Array) -> Array:
    """How far centres (n, 2) are from the nearest jaw or edge: (n,) [m]."""
    round_ = np.vstack([POCKETS.jaws[:, :3], POCKETS.falls])
    return (np.linalg.norm(xy[:, None] - round_[:, :2], axis=-1) - round_[:, 2]).min(axis=1)


def test_jaws_go_on_from_the_cushions_and_leave_a_clean_way() -> None:
    corner, middle, _ = POCKETS.ends
    for number, (x, y, rho, *_) in enumerate(POCKETS.jaws):
        k, o = JAW_RAILS[number] // 2, 1 - JAW_RAILS[number] // 2
        at = np.abs([x, y])
        assert at[k] - rho == pytest.approx(REACH[k], abs=2e-10)
        assert rail_of(4 + number) == ("-+"[int((x, y)[k] > 0)]) + "xy"[k]
        if at[o] < HALF[o] / 2:
            assert at[o] == middle
            assert at[o] - rho == pytest.approx(CLEAN, abs=2e-10)
        else:
            assert at[o] == pytest.approx(HALF[o] - corner, abs=1e-12)
            assert abs((HALF - at) @ [1, -1]) / np.sqrt(2) - rho == pytest.approx(CLEAN, abs=2e-10)
    assert pytest.approx(0.01875) == CLEAN


def test_edges_close_the_way_between_the_jaws_and_no_more() -> None:
    for x, y, edge in POCKETS.falls:
        jaws = POCKETS.jaws[np.argsort(np.hypot(*(POCKETS.jaws[:, :2] - [x, y]).T))[:2]]
        for px, py, rho, *_ in jaws:
            assert np.hypot(px - x, py - y) < rho + edge
    # A ball on the table that touches a nose, or would without the pocket, lies clear of every edge but a corner's.
    along = np.linspace(0, HALF[0] - 0.045, 200)
    spots = np.column_stack([along, np.full(200, REACH[1])])
    assert (np.linalg.norm(spots[:, None] - POCKETS.falls[:, :2], axis=-1) > POCKETS.falls[:, 2]).all()


@pytest.mark.parametrize("flip", [(-1, 1), (1, -1), (-1, -1)])
def test_mirrored_shots_end_mirrored(flip: tuple[int, int]) -> None:
    m = np.array(flip)
    offset = np.linspace(-0.06, 0.06, 41)
    for sides, angle, speed in itertools.product((CORNER, MIDDLE), (0.0, 0.3), (0.3, 2.0)):
        p, v = approach(sides, speed, angle, offset)
        w = rolling(v) + np.array([0, 0, 20])
        there, back = run(p, v, w, until=2.0), run(p * m, v * m, w * [m[1], m[0], m[0] * m[1]], until=2.0)
        assert np.array_equal(there.potted, back.potted)
        assert np.array_equal(there.counts, back.counts)
        assert np.abs(back.position * m - there.position).max() < 1e-9


def test_a_corner_is_the_same_from_both_its_cushions() -> None:
    p, v = approach(CORNER, 1.0, 0.2, np.linspace(-0.06, 0.06, 41))
    over = (HALF + (p - HALF)[..., ::-1]), v[..., ::-1].copy()
    there, back = run(p, v, until=1.0), run(*over, until=1.0)
    assert np.array_equal(there.potted, back.potted)
    assert np.abs((back.position - HALF)[..., ::-1] - (there.position - HALF)).max() < 1e-9


def test_energy_never_rises() -> None:
    start = near_pockets(200)

    def energy(v: Array, w: Array) -> Array:
        return np.sum(v**2, axis=(1, 2)) + 0.4 * R**2 * np.sum(w**2, axis=(1, 2))

    last = energy(start[1], start[2])
    for until in np.linspace(0.02, 1.5, 75):
        end = run(*start, until=float(until))
        now = energy(end.velocity, end.spin)
        assert (now <= last * (1 + 1e-7)).all()
        last = now


def test_every_shot_ends_and_no_ball_lies_in_a_jaw_or_over_an_edge() -> None:
    end = run(*near_pockets(2000))
    hits = end.event[..., 2][end.event[..., 0] == 1]
    assert (hits >= 4).sum() > 500 and end.potted.sum() > 300
    rest = end.position[~end.potted]
    assert clear(rest).min() > -1e-9
    beyond = (np.abs(rest) > REACH + 1e-9).any(axis=1)
    assert beyond.any()  # some hang in the jaws
    for xy in rest[beyond]:
        rail = 0 if abs(xy[0]) > REACH[0] else 2
        assert in_mouth(xy[1 - rail // 2], rail, HALF, POCKETS.ends)


def test_results_are_the_same_bytes_at_any_thread_count() -> None:
    start = near_pockets(100)
    one, two = (run(*start, threads=k) for k in (1, 2))
    assert one.position.tobytes() == two.position.tobytes()
    assert one.event.tobytes() == two.event.tobytes()


def test_away_from_pockets_nothing_changes() -> None:
    noise = np.random.default_rng(4)
    p = noise.uniform([-1.2, -0.6], [-0.4, 0.6], (300, 2, 2))
    p[:, 1, 0] += 1.6
    v = noise.normal(0, 1.0, (300, 2, 2))
    w = noise.normal(0, 40, (300, 2, 3))
    with_, without = (run(p, v, w, until=2.0, jaws=jaws) for jaws in (True, False))
    met = (with_.event[..., 0] == 1).any(axis=1)
    far = np.array([((e[:, 2] < 4) | (e[:, 0] != 1)).all() and not (e[:, 0] == 2).any() for e in with_.event])
    far &= ~np.array([(e[:, 0] == 2).any() for e in without.event])
    assert (met & far).sum() > 80
    assert np.array_equal(with_.position[far], without.position[far])
    assert np.array_equal(with_.event_time[far], without.event_time[far])


@pytest.mark.parametrize("sides", [CORNER, MIDDLE])
def test_what_comes_in_clean_falls_at_any_speed(sides: tuple[int, int]) -> None:
    for speed in (0.2, 0.5, 1.0, 2.0, 4.0, 6.0):
        p, v = approach(sides, speed, 0.0, np.linspace(-0.018, 0.018, 25))
        end = run(p, v)
        assert end.potted.all()
        assert (end.counts[:, 1] == 0).all()


@pytest.mark.parametrize(("sides", "margin"), [(CORNER, 0.045), (MIDDLE, 0.055)])
def test_jaws_let_in_a_slow_ball_as_far_off_as_published(sides: tuple[int, int], margin: float) -> None:
    # Robotic Billiards (2015): up to 45 mm at a corner and 55 mm at a middle.
    assert half_width(sides, 0.3, 0.0) == pytest.approx(margin, abs=1e-3)
    assert max(half_width(sides, speed, 0.0) for speed in (0.2, 0.7, 1.5, 3.0)) < margin + 1e-3


@pytest.mark.parametrize("sides", [CORNER, MIDDLE])
def test_pockets_let_in_less_at_speed_and_from_aside(sides: tuple[int, int]) -> None:
    for degrees in (0.0, 15.0, 30.0):
        slow, fast = half_width(sides, 0.3, degrees), half_width(sides, 3.0, degrees)
        assert slow - fast > 0.002
    for speed in (0.3, 3.0):
        width = [half_width(sides, speed, degrees) for degrees in (0.0, 15.0, 30.0, 45.0)]
        assert (np.diff(width) < -0.001).all()
        assert width[-1] > 0.01


def test_a_ball_along_the_cushion_falls_into_the_corner_and_passes_the_middle() -> None:
    for gap, speed in itertools.product((0.0, 0.003), (0.5, 1.0, 2.0)):
        p = np.array([[[-0.6, REACH[1] - gap]]])
        end = run(p, np.array([[[np.sqrt(speed**2 + 2 * ROLL * 2.4), 0.0]]]))
        assert end.potted.all()
        assert end.position[0, 0, 0] > 1.7
        met = end.event[0][end.event[0, :, 0] == 1]
        assert set(met[:, 2]) <= {4}  # the far jaw of the corner, which +x ends in


def test_an_impact_at_a_jaw_is_one_of_its_rail() -> None:
    p, v = approach(CORNER, 1.0, 0.0, np.array([0.042, -0.042]))
    shots = [Shot(("white",), *x, np.linspace(0, 2, 11)) for x in zip(p, v, rolling(v), strict=True)]
    first = [track.events[0] for track in play(MODEL, shots, jaws=True)]
    assert [(e.kind, e.rail) for e in first] == [("cushion", "+y"), ("cushion", "+x")]


def test_normals_point_into_what_is_met() -> None:
    assert [outward(rail, 0.3, 0.2, POCKETS.jaws) for rail in range(4)] == [(1, 0), (-1, 0), (0, 1), (0, -1)]
    for number, (x, y, rho, *_) in enumerate(POCKETS.jaws):
        assert outward(4 + number, x - 0.6 * rho, y + 0.8 * rho, POCKETS.jaws) == pytest.approx((0.6, -0.8))


@settings(max_examples=300, derandomize=True)
@given(
    along=st.floats(1.5, 1.74), deep=st.floats(-0.03, 0.03), v=st.lists(st.floats(-2, 2), min_size=2, max_size=2),
    a=st.lists(st.floats(-3, 3), min_size=2, max_size=2), h=st.floats(0.02, 0.5),
)  # fmt: skip
def test_straight_cushions_are_met_where_they_are(along: float, deep: float, v: list[float], a: list[float], h: float):  # type: ignore[no-untyped-def]
    end = HALF[0] - POCKETS.ends[0]
    if (deep > -1e-6 and along <= end + 1e-6) or abs(deep) < 1e-6:
        return
    p = np.array([along, REACH[1] + deep])
    t = float(straight(2, TableGeometry(R, REACH, HALF, *POCKETS), p, np.array(v), np.array(a), h))
    grid = np.linspace(0, min(t, h), 4001)
    x, y = (p[k] + v[k] * grid + 0.5 * a[k] * grid**2 for k in range(2))
    passes = np.flatnonzero((y[:-1] < REACH[1] - 1e-9) & (y[1:] > REACH[1] + 1e-9))
    if t <= h:
        assert y[-1] == pytest.approx(REACH[1], abs=1e-9)
        assert abs(x[-1]) <= end + 1e-9
        passes = passes[:-1]
    assert (x[passes + 1] > end - 1e-3).all()


def test_shots_given_up_early_are_told_by_their_time() -> None:
    p, v = approach(CORNER, 2.0, 0.0, np.array([0.0, 0.06]))
    few, all_ = run(p, v, most=2), run(p, v)
    assert np.isnan(few.time).tolist() == [False, True]
    assert few.position[0].tobytes() == all_.position[0].tobytes()
    assert few.counts[1].sum() == 2 < all_.counts[1].sum()
    assert np.isfinite(few.position).all()


@pytest.mark.parametrize(
    ("table", "ball", "names"),
    [(TABLE, Ball(0.095, 0.2), "95.0 mm"), (Table(0.4, 1.778), BALL, "0.4"), (Table(3.569, 0.2), BALL, "0.2")],
)
def test_what_has_no_jaws_is_named(table: Table, ball: Ball, names: str) -> None:
    with pytest.raises(BadInput, match=names):
        pockets_of(table, ball)


def test_facings_that_miss_the_edge_of_the_slate_close_no_pocket() -> None:
    """They run on beside it for ever, and balls would leave the table there."""
    corner = PocketShape(0.2144, 0.1736, 1.596, 0.0284, 0.0931, 0.0544)
    table = Table(6.456, 1.539, PocketShapes(corner, SNOOKER_POCKETS.middle))
    with pytest.raises(BadInput, match=r"25\.9 mm is none for the pockets"):
        pockets_of(table, Ball(0.0259, 0.00167))


def test_a_table_without_pockets_has_no_jaws() -> None:
    open_ = Table(3.569, 1.778, pockets=False)
    p, v = approach(CORNER, 2.0, 0.0, np.linspace(-0.05, 0.05, 11))
    with_, without = (finish(full_model(open_, BALL), p, v, rolling(v), jaws=jaws) for jaws in (True, False))
    assert with_.position.tobytes() == without.position.tobytes()
    assert not with_.potted.any()
    assert pockets_of(open_, BALL).ends.tolist() == [0, 0, 0]
    assert POCKETS.jaws[0, 2] == pytest.approx(SNOOKER_POCKETS.corner.nose_radius + R * NOSE_COSINE)
