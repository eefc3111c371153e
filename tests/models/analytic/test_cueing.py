"""Squirt of a stroke off centre in both directions, and the balance of impulses against the laws it must keep."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models.analytic.cue_impulse import Constants, Geometry, launch
from models.analytic.cueing import squirt
from models.shot import Array, Ball

BALL = Ball(0.0525, 0.1406)
R, LEVER = BALL.radius, Geometry(BALL).lever
PLAIN = Constants(0.75, 0.5, 0.00703, 0.0, 0.0)


def test_height_takes_from_squirt_by_the_arm_that_is_left() -> None:
    """Only a^2 + b^2 enters c: the tip touches at the same depth for the same distance from the centre."""
    for a, b in ((0.3, 0.4), (0.3, -0.4)):
        c = math.sqrt(1.0 - a * a - b * b)
        assert math.tan(squirt(a, b, 20.0)) == pytest.approx(2.5 * a * c / (21.0 + 2.5 * c * c), rel=1e-12)
    assert squirt(1.0, 0.2, 20.0) == 0.0


def balance(constants: Constants, geometry: Geometry, side: float, height: float) -> tuple[Array, Array, Array]:
    """Velocity, spin, and the contact's normal from the ball's centre, of a stroke at 1.5 m/s."""
    v, w = launch(constants, geometry, np.array([1.5]), np.array([side]), np.array([height]))
    el = geometry.elevation
    along, up = np.array([np.cos(el), 0.0, -np.sin(el)]), np.array([np.sin(el), 0.0, np.cos(el)])
    a, b = side * geometry.lever / R, height * geometry.lever / R
    normal = -a * np.array([0.0, 1.0, 0.0]) + b * up - math.sqrt(1.0 - a * a - b * b) * along
    return v[0], w[0], normal


@pytest.mark.parametrize(("side", "height"), [(0.0, 0.0), (0.006, 0.0), (-0.005, 0.004), (0.003, -0.009)])
def test_tip_and_slate_give_all_momentum_and_spin(side: float, height: float) -> None:
    """The impulses at two known points are three and three numbers; six of motion, one of them no sinking."""
    for friction in (0.0, 0.21):
        made = dataclasses.replace(PLAIN, slate_friction=friction)
        v, w, normal = balance(made, Geometry(BALL), side, height)
        matrix = np.zeros((6, 6))
        for k, arm in enumerate((normal, np.array([0.0, 0.0, -1.0]))):
            matrix[:3, 3 * k : 3 * k + 3] = np.eye(3)
            matrix[3:, 3 * k : 3 * k + 3] = np.cross(arm, np.eye(3)).T * R
        motion = np.concatenate([BALL.mass * v, BALL.inertia * w])
        impulses, *_ = np.linalg.lstsq(matrix, motion, rcond=None)
        assert matrix @ impulses == pytest.approx(motion, abs=1e-9)
        assert v[2] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("height", [0.006, -0.006])
def test_the_slate_rubs_against_the_slip_by_no_more_than_its_friction(height: float) -> None:
    geometry = Geometry(BALL)
    free, spun, _ = balance(PLAIN, geometry, 0.004, height)
    rubbed, turned, _ = balance(dataclasses.replace(PLAIN, slate_friction=0.05), geometry, 0.004, height)
    slip = free[:2] + R * np.array([-spun[1], spun[0]])
    after = rubbed[:2] + R * np.array([-turned[1], turned[0]])
    assert np.linalg.norm(after) < np.linalg.norm(slip)
    assert (after - slip) @ slip < -0.95 * np.linalg.norm(after - slip) * np.linalg.norm(slip), "against the slip"
    # The tip presses down by some M V tan(elevation), and takes some of what the slate does: 7/2 of slip a speed.
    most = 3.5 * 0.05 * np.linalg.norm(free[:2]) * math.tan(geometry.elevation)
    assert 0.3 * most < np.linalg.norm(after - slip) < 1.1 * most


@pytest.mark.parametrize("friction", [0.05, 0.21, 0.6])
def test_a_stroke_scales_with_its_speed(friction: float) -> None:
    """Impulses and Coulomb friction know no speed, but for the tip that is carried outwards meanwhile."""
    made = dataclasses.replace(PLAIN, slate_friction=friction)
    speed, place = np.array([0.2, 1.0, 5.0]), np.full(3, 0.004)
    for height in (0.009, 0.0, -0.009):
        v, w = launch(made, Geometry(BALL), speed, place, np.full(3, height))
        assert v / speed[:, None] == pytest.approx(np.tile(v[1], (3, 1)), abs=1e-12)
        assert w / speed[:, None] == pytest.approx(np.tile(w[1], (3, 1)), abs=1e-9)


def test_contact_time_carries_the_tip_outwards() -> None:
    """The offset grows by 5/2 V c T / (8 (R + r_t)) of itself: the stroke is that of the larger offset."""
    level = Geometry(BALL, elevation=0.0)
    for side, height in ((0.006, 0.0), (0.0, 0.005), (-0.004, 0.003)):
        rho2 = (side * side + height * height) * LEVER**2 / R**2
        speed = 1.75 * 1.5 / (1.0 + BALL.mass / 0.5 + 2.5 * rho2)
        grown = 1.0 + 2.5 * speed * math.sqrt(1.0 - rho2) * 1e-3 / (8.0 * (R + level.tip_radius))
        long, _, _ = balance(dataclasses.replace(PLAIN, contact_time=1e-3), level, side, height)
        far, _, _ = balance(PLAIN, level, side * grown, height * grown)
        assert long == pytest.approx(far, rel=1e-12)


def test_zeros_shift_offsets_and_turn_the_aim() -> None:
    off = dataclasses.replace(PLAIN, side_zero=1e-3, height_zero=-2e-3, aim_zero=0.05)
    v, w, _ = balance(off, Geometry(BALL), 0.002, 0.003)
    there, spun, _ = balance(PLAIN, Geometry(BALL), 0.003, 0.001)
    c, s = math.cos(0.05), math.sin(0.05)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    assert v == pytest.approx(turn @ there, rel=1e-12)
    assert w == pytest.approx(turn @ spun, rel=1e-12)
