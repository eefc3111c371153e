"""Closed forms against published tables: cloth, throw, cushions, cueing."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from models.analytic.cloth import rolling_velocity, slip, state_at
from models.analytic.cue_impulse import Geometry
from models.analytic.cueing import miscue_limit, squirt
from models.shot import Ball
from tests.reference.ball_ball import THROW, SpeedFriction, collide_balls, frictional, no_spin, throw_angle
from tests.reference.cushion import TwoPiece, collide_cushion, han_restitution, rolling_rebound

Array = NDArray[np.float64]
BALL = Ball(0.0525, 0.1406)
R = BALL.radius
CLOTH = {"radius": R, "slide": 0.212, "roll": 0.0127}

# Start (v, omega); slip, time to roll, place, velocity and sidespin then; slide 0.212, alpha 22, from an independent
# integration of the equations of motion.
SLIDES = [
    ((2, 0), (0, 0, 0), 2.000000, 0.274762, (0.471021, 0), (1.428571, 0), 0),
    ((2, 0), (30, 0, 60), 2.149455, 0.295295, (0.506219, -0.033221), (1.428571, -0.225000), 53.5035),
    ((1.5, 0.5), (-20, -40, -30), 2.550123, 0.350339, (0.397885, 0.176421), (0.771429, 0.507143), -22.2925),
    ((1, 0), (0, 60, 0), 0.575000, 0.078994, (0.085483, 0), (1.164286, 0), 0),
    ((1, 0), (0, -60, 10), 2.575000, 0.353756, (0.223625, 0), (0.264286, 0), 2.2174),
]


@pytest.mark.parametrize(("v", "w", "u", "t", "place", "after", "side"), SLIDES)
def test_slides_agree_with_the_table(
    v: Array, w: Array, u: float, t: float, place: Array, after: Array, side: float
) -> None:
    assert np.linalg.norm(slip(v, w, R)) == pytest.approx(u, abs=1e-6)
    assert 2.0 * u / (7.0 * 0.212 * 9.81) == pytest.approx(t, abs=1e-6)
    p, q, x = state_at(t, (0, 0), v, w, **CLOTH, alpha=22.0)
    assert p == pytest.approx(place, abs=2e-6)
    assert q == pytest.approx(after, abs=2e-6)
    assert x[2] == pytest.approx(side, abs=1e-4)
    assert rolling_velocity(v, w, R) == pytest.approx(after, abs=1e-6)


def test_a_stun_shot_runs_as_far_as_slide_and_roll_together() -> None:
    end = (2 / (7 * 0.212) + 5 / (7 * 0.0127)) / 9.81  # of the slide, then of the roll at 5/7 of the speed
    p, v, w = state_at(end + 1e-9, (0, 0), (1, 0), (0, 0, 0), **CLOTH, alpha=22.0)
    assert p[0] == pytest.approx((12 / (49 * 0.212) + 25 / (98 * 0.0127)) / 9.81, abs=1e-12)
    assert np.array_equal(v, [0, 0])
    assert np.array_equal(w, [0, 0, 0])


def test_motion_does_not_depend_on_where_it_is_cut() -> None:
    start = ((0.1, 0.2), (1.5, 0.5), (-20, -40, 5))
    cut = state_at(0.2, *start, **CLOTH, alpha=22.0)
    times = np.array([0.1, 0.5, 3.0])
    assert state_at(times, *cut, **CLOTH, alpha=22.0)[0] == pytest.approx(
        state_at(times + 0.2, *start, **CLOTH, alpha=22.0)[0], abs=1e-12
    )


def test_without_friction_a_ball_runs_back_to_where_it_came_from() -> None:
    there = state_at(2.0, (0.1, 0.2), (1.5, 0.5), (3, 4, 5), R, 0.0, 0.0, 0.0)
    back = state_at(2.0, there[0], -there[1], -there[2], R, 0.0, 0.0, 0.0)
    assert back[0] == pytest.approx([0.1, 0.2], abs=1e-15)


THROW_CLOTH = {5: (0.757, 0.235), 10: (1.525, 0.468), 20: (2.862, 0.930), 30: (2.862, 1.374), 60: (2.862, 2.460)}


def cut_shot(cut: float, speed: float, roll: float) -> tuple[Array, Array]:
    c, s = math.cos(math.radians(cut)), math.sin(math.radians(cut))
    return speed * np.array([c, s]), roll * speed / R * np.array([-s, c, 0])


@pytest.mark.parametrize(("cut", "stun", "roll"), THROW)
def test_throw_agrees_with_the_table(cut: float, stun: tuple[float, ...], roll: tuple[float, ...]) -> None:
    law = SpeedFriction()
    for factor, row in ((0.0, stun), (1.0, roll)):
        for speed, expected in zip((0.447, 1.341, 3.129), row, strict=True):
            v, w = cut_shot(cut, speed, factor)
            after = frictional(v, w, (0, 0), (0, 0, 0), (1, 0), BALL, restitution=1.0, friction=law)
            assert math.degrees(throw_angle(after[2], (1, 0))) == pytest.approx(expected, abs=2e-3)


@pytest.mark.parametrize("cut", THROW_CLOTH)
def test_throw_of_the_cloth_model_does_not_depend_on_speed(cut: float) -> None:
    for factor, expected in zip((0.0, 1.0), THROW_CLOTH[int(cut)], strict=True):
        for speed in (0.4, 3.0):
            v, w = cut_shot(cut, speed, factor)
            after = collide_balls(v, w, (0, 0), (0, 0, 0), (1, 0), BALL, restitution=0.89, friction=0.05, cloth=0.21)
            assert math.degrees(throw_angle(after[2], (1, 0))) == pytest.approx(expected, abs=0.012)


def test_closed_form_is_near_the_cloth_model() -> None:
    for cut in (0, 30, 60):
        v, w = cut_shot(cut, 1.0, 1.0)
        near = frictional(v, w, (0, 0), (0, 0, 0), (1, 0), BALL, restitution=0.89, friction=0.05)
        full = collide_balls(v, w, (0, 0), (0, 0, 0), (1, 0), BALL, restitution=0.89, friction=0.05, cloth=0.21)
        for a, b in zip(near[::2], full[::2], strict=True):
            assert np.abs(a - b).max() < 6e-3


# Speed, cut [deg]; both balls once they roll: cue ball, object ball, their angles to the cue ball's course [deg].
# Mathavan 2014 as its implementations print it.
FIVE = [
    (1.539, 33.83, 0.914, 0.831, 31.93, 32.20),
    (1.032, 26.36, 0.520, 0.599, 32.45, 25.07),
    (1.364, 40.52, 0.917, 0.676, 29.91, 38.62),
    (1.731, 46.50, 1.28, 0.780, 27.32, 44.38),
    (0.942, 18.05, 0.383, 0.579, 29.47, 17.15),
]


@pytest.mark.parametrize(("speed", "cut", "cue", "red", "cue_angle", "red_angle"), FIVE)
def test_the_five_published_shots(
    speed: float, cut: float, cue: float, red: float, cue_angle: float, red_angle: float
) -> None:
    v, w = cut_shot(cut, speed, 1.0)
    v1, w1, v2, w2 = collide_balls(v, w, (0, 0), (0, 0, 0), (1, 0), BALL, restitution=0.89, friction=0.05, cloth=0.21)
    a, b = rolling_velocity(v1, w1, R), rolling_velocity(v2, w2, R)
    assert np.hypot(*a) == pytest.approx(cue, abs=4e-3)
    assert np.hypot(*b) == pytest.approx(red, abs=1.5e-3)
    assert math.degrees(math.atan2(a[1], a[0])) - cut == pytest.approx(cue_angle, abs=0.04)
    assert cut - math.degrees(math.atan2(b[1], b[0])) == pytest.approx(red_angle, abs=0.04)


def test_the_cloth_rubs_the_lowest_point() -> None:
    # Head-on draw, R omega = -1: one ball is pressed down, and its LOWEST point is what slips.
    draw = collide_balls(
        (1, 0), (0, -1 / R, 0), (0, 0), (0, 0, 0), (1, 0), BALL, restitution=0.89, friction=0.05, cloth=0.21
    )
    assert [draw[0][0], R * draw[1][1], draw[2][0], R * draw[3][1]] == pytest.approx(
        [0.0501, -0.8578, 0.9401, 0.1175], abs=1e-4
    )
    # With a strong cloth the reaction shows: backwards on a ball pressed down that slips forwards, never forwards.
    none, much = (
        collide_balls((1, 0), (0, -1 / R, 0), (0, 0), (0, 0, 0), (1, 0), BALL, restitution=1, friction=0.3, cloth=c)
        for c in (0.0, 0.5)
    )
    assert much[2][0] + much[0][0] < none[2][0] + none[0][0] - 1e-3


def test_without_spin_stun_shots_part_at_a_right_angle() -> None:
    a, b = no_spin((1, 2), (0, 0), (1, 0.3), restitution=1.0)
    assert a @ b == pytest.approx(0, abs=1e-12)


CURVES = """
10 .915 10.6 .917 10.6 .943 10.3 .976 9.9
20 .847 22.7 .843 22.7 .895 21.8 .947 20.4
30 .808 35.8 .788 36.2 .861 34.0 .924 31.5
40 .798 48.8 .759 49.9 .848 46.6 .915 42.9
50 .807 60.7 .761 61.8 .852 58.6 .921 53.9
60 .826 71.1 .785 70.9 .867 68.8 .937 64.1
70 .845 79.5 .811 78.2 .888 76.6 .958 73.5
80 .860 85.8 .831 84.5 .905 83.4 .974 82.0
"""  # Mathavan 2010: angle from the cushion; speed ratio and rebound angle for topspin factors -1, 0, 1, 2


def rebound(angle: float, roll: float, side: float = 0.0, **changed: object) -> tuple[float, float]:
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    law: dict[str, object] = {"restitution": 0.98, "friction": 0.14, "cloth": 0.212, **changed}
    w = np.array([-roll * s, roll * c, side]) / R
    v, _ = collide_cushion((c, s), w, (0, 1), BALL, **law)  # type: ignore[arg-type]
    return float(np.hypot(*v)), math.degrees(math.atan2(-v[1], v[0]))


@pytest.mark.parametrize("row", CURVES.strip().splitlines())
def test_rebound_curves(row: str) -> None:
    angle, *cells = map(float, row.split())
    for k, roll in enumerate((-1, 0, 1, 2)):
        speed, out = rebound(angle, roll)
        assert speed == pytest.approx(cells[2 * k], abs=1e-3)
        assert out == pytest.approx(cells[2 * k + 1], abs=0.1)


SIDE = [
    (45, -2, 0.838, 54.9), (45, -1, 0.840, 54.3), (45, 0.5, 0.866, 49.5), (45, 1, 0.941, 43.2), (45, 2, 1.116, 37.0),
    (75, -2, 0.930, 92.0), (75, -1, 0.920, 90.1), (75, 0, 0.898, 80.0), (75, 1, 0.983, 65.0), (75, 2, 1.063, 60.2),
    (90, 1, 0.968, 76.1), (90, 2, 1.002, 73.1),
]  # fmt: skip


@pytest.mark.parametrize(("angle", "side", "speed", "out"), SIDE)
def test_rebounds_with_side(angle: float, side: float, speed: float, out: float) -> None:
    got = rebound(angle, 1, side)
    assert got[0] == pytest.approx(speed, abs=1.5e-3)
    assert got[1] == pytest.approx(out, abs=0.1)


@pytest.mark.parametrize(
    ("mu", "speed", "out"), [(0.10, 0.89, 50.3), (0.14, 0.85, 52.7), (0.20, 0.79, 55.8), (0.30, 0.74, 54.9)]
)
def test_rebound_with_other_cushion_frictions(mu: float, speed: float, out: float) -> None:
    assert rebound(45, 1, friction=mu) == (pytest.approx(speed, abs=6e-3), pytest.approx(out, abs=0.1))


def test_perpendicular_rebound() -> None:
    for roll, ratio in ((1, 0.9107), (0, 0.8375), (-1, 0.866), (2, 0.980)):
        assert rebound(90, roll)[0] == pytest.approx(ratio, abs=6e-4)
    for cloth, ratio in ((0.18, 0.920), (0.25, 0.901)):
        assert rebound(90, 1, cloth=cloth)[0] == pytest.approx(ratio, abs=1e-3)
    for e in (0.85, 0.9, 0.98):
        assert rebound(90, 1, restitution=e)[0] == pytest.approx(0.0591 + 0.8692 * e, abs=2e-3)
    v, w = collide_cushion((0, 1), (-1 / R, 0, 0), (0, 1), BALL, restitution=0.98, friction=0.14, cloth=0.212)
    assert np.hypot(*rolling_velocity(v, w, R)) == pytest.approx(0.583, abs=1e-3)


def test_slips_after_a_rebound() -> None:
    c = math.sqrt(0.5)
    v0 = 2.0 * np.array([c, c])
    w0 = np.array([-3.0 * c, 3.0 * c, 4.0]) / R
    v, w = collide_cushion(v0, w0, (0, 1), BALL, restitution=0.98, friction=0.14, cloth=0.212)
    cs = math.sqrt(0.84)
    for vel, spin, nose, nose_phase, bed, bed_phase in (
        (v0, w0, 3.03, 4.23, 1.0, 3.93),
        (v, w, 0.572, 3.66, 2.24, 4.51),
    ):
        s = np.array([vel[0] + R * (spin[1] * 0.4 - spin[2] * cs), -vel[1] * 0.4 + R * spin[0]])
        u = slip(vel, spin, R)
        assert np.hypot(*s) == pytest.approx(nose, abs=5e-3)
        assert math.atan2(s[1], s[0]) % (2 * math.pi) == pytest.approx(nose_phase, abs=7e-3)
        assert np.hypot(*u) == pytest.approx(bed, abs=5e-3)
        assert math.atan2(u[1], u[0]) % (2 * math.pi) == pytest.approx(bed_phase, abs=7e-3)


def test_two_piece_restitution_meets_the_measured_rebounds() -> None:
    marks = (
        ".263 .234 .355 .324 .418 .383 .651 .583 .704 .665 .845 .791 1.154 1.069 1.299 1.237 1.526 1.456 1.755 1.645 "
        "1.991 1.824 2.276 2.031 2.530 2.280 2.701 2.265 2.893 2.383 2.985 2.462 3.106 2.620 3.185 2.568 3.405 2.732"
    )
    table = np.array(marks.split(), float).reshape(-1, 2)  # Mathavan 2010 fig. 7a, digitised: speed in, speed out
    off = []
    for speed, out in table:
        w = (-speed / R, 0, 0)
        v, _ = collide_cushion((0, speed), w, (0, 1), BALL, restitution=TwoPiece(), friction=0.14, cloth=0.212)
        off.append(-v[1] - out)
    assert math.sqrt(np.mean(np.square(off))) == pytest.approx(0.038, abs=3e-3)
    assert rolling_rebound([1.0, 3.0]) / [1, 3] == pytest.approx([0.948, 0.836], abs=1e-3)


@pytest.mark.parametrize(
    ("angle", "speed", "out"), [(30, 0.836, 25.3), (45, 0.779, 41.9), (60, 0.759, 59.1), (90, 0.765, 90.0)]
)
def test_han(angle: float, speed: float, out: float) -> None:
    assert rebound(angle, 1, law="han2005") == (pytest.approx(speed, abs=1e-3), pytest.approx(out, abs=0.1))


def test_han_loses_what_goes_upwards() -> None:
    for e, ratio in ((0.85, 0.554), (0.98, 0.663)):
        assert rebound(90, 0, restitution=e, friction=0.0, law="han2005")[0] == pytest.approx(ratio, abs=1e-3)
    assert han_restitution([0.5, 1.0, 1.5, 2.0, 2.5]) == pytest.approx([0.51, 0.60, 0.68, 0.73, 0.76], abs=0.01)


def test_tip_geometry() -> None:
    for axis, contact in ((2, 1.45), (4, 2.90), (6, 4.34), (8, 5.79), (10, 7.24), (11, 7.97), (12, 8.69)):
        assert axis * Geometry(BALL).lever == pytest.approx(contact, abs=6e-3)
    assert miscue_limit(0.6) == pytest.approx(0.514, abs=1e-3)


SQUIRT = [  # ball over end mass; degrees at offsets 0.1, 0.2, 0.25, 0.304, 0.331, 0.5
    (12, (0.92, 1.82, 2.26, 2.72, 2.94, 4.16)),
    (15, (0.77, 1.53, 1.89, 2.27, 2.45, 3.47)),
    (20, (0.61, 1.20, 1.49, 1.78, 1.93, 2.71)),
    (30, (0.43, 0.84, 1.04, 1.25, 1.35, 1.89)),
    (50, (0.27, 0.53, 0.65, 0.78, 0.84, 1.17)),
]


@pytest.mark.parametrize(("ratio", "angles"), SQUIRT)
def test_squirt(ratio: float, angles: tuple[float, ...]) -> None:
    for a, angle in zip((0.1, 0.2, 0.25, 0.304, 0.331, 0.5), angles, strict=True):
        assert math.degrees(squirt(a, 0.0, ratio)) == pytest.approx(angle, abs=0.012)
        assert squirt(-a, 0.0, ratio) == -squirt(a, 0.0, ratio)
