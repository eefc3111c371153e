"""The cloth under a ball that is pushed and turned: forces balance, nothing depends on how the axes lie."""

from __future__ import annotations

import numpy as np
import pytest

from models import record as rec
from models.analytic.cloth import RESTING, ROLLING, SLIDING, ClothPhase, add_cloth, turned
from models.shot import GRAVITY, Array

R, SLIDE, ROLL, SPIN = 0.02625, 0.212, 0.0127, 22.0
PUSH = [rec.AX, rec.AY, rec.BX, rec.BY, rec.BZ]


def pushed(
    mode: int, velocity: Array, slip: Array, push: Array, torque: Array, wz: float = 0.0, **factors: float
) -> tuple[Array, Array, bool]:
    """Acceleration (3,) [m/s^2] and angular one (3,) [rad/s^2] with the cloth's, and whether the ball moves."""
    r = np.zeros(rec.BALL_FIELDS)
    r[rec.RADIUS] = R
    r[rec.WEIGHT], r[rec.SLIDE_FACTOR], r[rec.ROLL_FACTOR], r[rec.SPIN_FACTOR] = (
        factors.get(k, 1.0) for k in ("weight", "slide_factor", "roll_factor", "spin_factor")
    )
    r[rec.AX], r[rec.AY], r[rec.BX], r[rec.BY] = *push, *torque
    u, v = float(np.hypot(*slip)), float(np.hypot(*velocity))
    phase = ClothPhase(mode, u, *(slip / (u or 1.0)), v, *(velocity / (v or 1.0)), wz)
    add_cloth(r, phase, np.array([SLIDE, ROLL, SPIN]))
    return np.array([r[rec.AX], r[rec.AY], 0.0]), r[[rec.BX, rec.BY, rec.BZ]], bool(r[PUSH].any())


NONE = np.zeros(2)
WAYS = [np.array([np.cos(a), np.sin(a)]) for a in (0.4, 1.9, 3.6, 5.3)]


def slip_rate(a: Array, b: Array) -> Array:
    """Of the lowest point: a + b x (-R z)."""
    return (a + np.cross(b, [0.0, 0.0, -R]))[:2]


@pytest.mark.parametrize("way", WAYS)
def test_a_sliding_ball_is_braked_at_its_lowest_point(way: Array) -> None:
    push, torque = np.array([0.03, -0.02]), np.array([0.4, 0.7])
    a, b, moves = pushed(SLIDING, NONE, 0.8 * way, push, torque, weight=0.9, slide_factor=0.7)
    force = -0.7 * 0.9 * SLIDE * GRAVITY * np.append(way, 0.0)
    assert moves
    assert a[:2] == pytest.approx(push + force[:2], rel=1e-12)
    assert b == pytest.approx(np.append(torque, 0.0) + np.cross([0, 0, -R], force) / (0.4 * R * R), rel=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_a_rolling_ball_is_held_at_no_slip_and_slows_by_rolling_friction(way: Array) -> None:
    for push, torque in ((NONE, NONE), (np.array([0.05, -0.02]), np.array([0.6, 0.9]))):
        a, b, moves = pushed(ROLLING, 1.3 * way, NONE, push, torque)
        assert moves
        assert slip_rate(a, b) == pytest.approx(NONE, abs=1e-12)
        # Friction at the lowest point does no work on a rolling ball; what the push and torque do, less the drag, is
        # its gain: 7/5 a = push + R (b_y, -b_x) 2/5 - 7/5 mu g.
        given = push + 0.4 * R * np.array([torque[1], -torque[0]])
        assert a[:2] == pytest.approx(given / 1.4 - ROLL * GRAVITY * way, rel=1e-12)


@pytest.mark.parametrize("mode", [ROLLING, RESTING])
def test_what_the_cloth_cannot_hold_slips(mode: int) -> None:
    push = 8.0 * WAYS[1]
    a, b, moves = pushed(mode, NONE, NONE, push, NONE)
    assert moves
    assert a[:2] == pytest.approx(push - SLIDE * GRAVITY * WAYS[1], rel=1e-12)
    assert slip_rate(a, b) @ WAYS[1] > 0.0
    held = pushed(mode, NONE, NONE, 0.99 * 3.5 * SLIDE * GRAVITY * WAYS[1], NONE)
    assert slip_rate(*held[:2]) == pytest.approx(NONE, abs=1e-12)


@pytest.mark.parametrize("way", WAYS)
def test_a_resting_ball_stays_until_the_push_exceeds_rolling_friction(way: Array) -> None:
    threshold = 1.4 * ROLL * GRAVITY
    a, b, moves = pushed(RESTING, NONE, NONE, 0.99 * threshold * way, NONE)
    assert not moves and not a.any() and not b.any()
    a, _, moves = pushed(RESTING, NONE, NONE, 1.01 * threshold * way, NONE)
    assert moves
    assert a[:2] == pytest.approx(0.01 * ROLL * GRAVITY * way, rel=1e-9), "it sets off against the same friction"
    torque = 1.01 * threshold / (0.4 * R) * np.array([-way[1], way[0]])
    assert pushed(RESTING, NONE, NONE, NONE, torque)[2]
    assert not pushed(RESTING, NONE, NONE, NONE, torque / 1.02)[2]


@pytest.mark.parametrize("wz", [30.0, -30.0])
def test_sidespin_is_braked_whatever_else_the_ball_does(wz: float) -> None:
    for mode, velocity, slip in ((SLIDING, NONE, WAYS[0]), (ROLLING, WAYS[0], NONE), (RESTING, NONE, NONE)):
        _, b, _ = pushed(mode, velocity, slip, NONE, NONE, wz, spin_factor=1.5)
        assert b[2] == -1.5 * SPIN * np.sign(wz)
        assert pushed(mode, velocity, slip, NONE, NONE, wz, weight=0.0)[1][2] == 0.0, "no cloth in flight"
        assert pushed(mode, velocity, slip, NONE, NONE, 0.0)[1][2] == 0.0


@pytest.mark.parametrize("wz", [9.0, -9.0])
@pytest.mark.parametrize("t", [0.1, 0.4, 1.0])
def test_the_angle_turned_is_the_area_under_the_sidespin(wz: float, t: float) -> None:
    times = np.linspace(0.0, t, 100_001)
    spin = np.sign(wz) * np.maximum(abs(wz) - SPIN * times, 0.0)
    assert turned(wz, SPIN, t) == pytest.approx((np.trapezoid(spin, times), spin[-1]), rel=1e-8, abs=1e-12)
    assert turned(wz, 0.0, t) == (wz * t, wz)
