"""What an impact is told to effects as, what counts as crowded, and how bodies that overlap are put apart."""

from __future__ import annotations

import numpy as np
import pytest

from models import record as rec
from models.analytic.geometry import TableGeometry
from models.engine.columns import TERM_COUNT
from models.engine.impacts import describe, part
from models.engine.impacts import is_crowded as crowded
from models.engine.motion import POTTED
from models.engine.workspace import Balls, Contact, Pair
from models.shot import NOSE_COSINE, NOSE_SINE, SESSION_FIELDS, Array, Session

R, REACH = 0.02625, np.array([1.75, 0.85])  # radius, and limits of centres [m]
SESSION = Session(0.3, 14.0, 2.5, 80.0, 2.0, 1.0)
HALF, NO_MOUTHS, NO_ARCS = np.array([1.77, 0.88]), np.zeros(3), np.zeros((0, 5))


def table(mouths: Array = NO_MOUTHS, jaws: Array = NO_ARCS) -> TableGeometry:
    """A table of these limits."""
    return TableGeometry(R, REACH, HALF, mouths, jaws, np.zeros((0, 3)))


def told(cushion: bool, one: Array, two: Array, normal: tuple[float, float]) -> Array:
    """The record of an impact of bodies (x, y, vx, vy, wx, wy, wz)."""
    h = np.zeros(rec.IMPACT_FIELDS)
    describe(h, np.array([one, two]), Contact(0, -1 if cushion else 1, 1, *normal), R, SESSION.row, 0.5)
    return h


@pytest.mark.parametrize("cushion", [True, False])
def test_slip_is_that_of_the_points_that_touch(cushion: bool) -> None:
    """v + omega x r at the contact, less its part along the contact's normal, in three dimensions."""
    noise = np.random.default_rng(4)
    for angle in noise.uniform(-np.pi, np.pi, 12):
        one, two = noise.normal(size=(2, 7)) * [1, 1, 1, 1, 1 / R, 1 / R, 1 / R]
        n = np.array([np.cos(angle), np.sin(angle), 0.0])
        at = np.array([NOSE_COSINE * n[0], NOSE_COSINE * n[1], NOSE_SINE]) if cushion else n
        points = [np.append(b[2:4], 0.0) + np.cross(b[4:7], side * R * at) for b, side in ((one, 1.0), (two, -1.0))]
        relative = points[0] if cushion else points[0] - points[1]
        h = told(cushion, one, two, (n[0], n[1]))
        assert h[rec.APPROACH] == pytest.approx((one[2:4] - (not cushion) * two[2:4]) @ n[:2], rel=1e-12)
        assert h[rec.SLIP] == pytest.approx(np.linalg.norm(relative - (relative @ at) * at), rel=1e-9)
        assert h[rec.CUSHION_HIT] == cushion
        assert np.array_equal(h[rec.HIT_SESSION : rec.HIT_SESSION + SESSION_FIELDS], SESSION.row)
        assert h[rec.HIT_TIME] == 0.5 and h[rec.RESTITUTION] == 0.0
        assert (h[rec.HIT_X], h[rec.HIT_Y], h[rec.HIT_VX], h[rec.HIT_VY]) == tuple(one[:4])


def is_crowded(places: Array, kind: Array, near: float, hit: tuple[int, int], mouths: Array = NO_MOUTHS) -> bool:
    """Of balls hit[0] and hit[1], or of ball hit[0] and rail -1 - hit[1]."""
    i, j = hit
    n = len(places)
    balls = Balls(
        places, np.zeros((n, 1, TERM_COUNT)), np.array(kind), np.zeros(n, bool), np.zeros((n, rec.BALL_FIELDS))
    )
    return bool(crowded(balls, Pair(i, max(j, -1), -1 - j), near, table(mouths)))


PAIR = [(0.0, 0.0), (2 * R, 0.0)]


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("behind", [0, 1])
def test_a_third_ball_crowds_from_either_side(turn: int, behind: int) -> None:
    c, s = ((1, 0), (0, 1), (-1, 0), (0, -1))[turn]
    for gap, expected in ((0.9e-3, True), (1.1e-3, False)):
        third = PAIR[behind][0] + (2 * R + gap) * (1 if behind else -1)
        places = np.array([*PAIR, (third, 0.0)]) @ [[c, s], [-s, c]]
        assert is_crowded(places, np.ones(3, int), 1e-3, (0, 1)) == expected
        assert is_crowded(places[::-1].copy(), np.ones(3, int), 1e-3, (2, 1)) == expected


def test_potted_balls_crowd_nothing() -> None:
    places = np.array([*PAIR, (-2 * R, 0.0)])
    assert is_crowded(places, np.array([1, 1, 1]), 1e-3, (0, 1))
    assert not is_crowded(places, np.array([1, 1, POTTED]), 1e-3, (0, 1))


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rail_crowds_two_balls_and_a_corner_crowds_one(axis: int, sign: float) -> None:
    rail = 2 * axis + (sign < 0)
    for gap, expected in ((0.9e-3, True), (1.1e-3, False)):
        places = np.zeros((2, 2))
        places[0, axis] = sign * (REACH[axis] - gap)
        places[1] = places[0]
        places[1, axis] -= sign * 2 * R
        assert is_crowded(places, np.ones(2, int), 1e-3, (0, 1)) == expected
        assert is_crowded(places, np.ones(2, int), 1e-3, (1, 0)) == expected
        alone = np.zeros((1, 2))
        alone[0, axis] = sign * REACH[axis]
        assert not is_crowded(alone, np.ones(1, int), 1e-3, (0, -1 - rail)), "the rail that is met is no third body"
        alone[0, 1 - axis] = REACH[1 - axis] - gap
        assert is_crowded(alone, np.ones(1, int), 1e-3, (0, -1 - rail)) == expected


def test_a_mouth_is_no_rail() -> None:
    places = np.array([[0.01, REACH[1]], [0.01, REACH[1] - 2 * R]])
    assert is_crowded(places, np.ones(2, int), 1e-3, (0, 1), np.array([0.06, 0.001, 0.0]))
    assert not is_crowded(places, np.ones(2, int), 1e-3, (0, 1), np.array([0.06, 0.05, 0.0]))


@pytest.mark.parametrize("angle", [0.3, 2.0, -1.4])
def test_balls_that_overlap_part_to_a_touch_about_their_middle(angle: float) -> None:
    way = np.array([np.cos(angle), np.sin(angle)])
    b = np.array([[0.1, 0.2] + 0 * way, [0.1, 0.2] + 1.9 * R * way])
    middle = b.mean(axis=0)
    part(b, Pair(0, 1, 0), table())
    assert b[1] - b[0] == pytest.approx(2 * R * way, rel=1e-12)
    assert b.mean(axis=0) == pytest.approx(middle, rel=1e-12)
    apart = b.copy()
    apart[1] += 0.1 * way
    still = apart.copy()
    part(apart, Pair(0, 1, 0), table())
    assert np.array_equal(apart, still)


@pytest.mark.parametrize("rail", range(4))
def test_a_ball_beyond_a_rail_or_in_a_jaw_is_put_back(rail: int) -> None:
    axis, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
    for depth in (1e-3, -1e-3):
        b = np.array([[0.3, 0.2]])
        b[0, axis] = sign * (REACH[axis] + depth)
        part(b, Pair(0, -1, rail), table())
        assert b[0, axis] == pytest.approx(sign * (REACH[axis] + min(depth, 0.0)), rel=1e-12)
        assert b[0, 1 - axis] == (0.3, 0.2)[1 - axis]
    jaw = np.array([[0.5, 0.4, 0.1, 0.0, 0.0]])
    way = np.array([np.cos(rail + 0.3), np.sin(rail + 0.3)])
    for distance in (0.09, 0.12):
        b = jaw[:, :2] + distance * way
        part(b, Pair(0, -1, 4), table(jaws=jaw))
        assert b[0] == pytest.approx(jaw[0, :2] + max(distance, 0.1) * way, rel=1e-12)
