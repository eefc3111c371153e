"""When bodies meet, by the roots of polynomials: a straight line, and what presses or parts at the start."""

from __future__ import annotations

import numpy as np
import pytest

from models.analytic.events import in_mouth, line, meeting
from models.analytic.geometry import Parabola

D = 0.0525


def first_root(coefficients: list[float], h: float) -> float:
    """The first real root in (0, h] of a polynomial, lowest power first; inf for none."""
    roots = np.polynomial.Polynomial(coefficients).roots()
    real = roots[np.abs(roots.imag) < 1e-9].real
    return float(min((t for t in real if 0.0 < t <= h), default=np.inf))


def test_a_line_is_met_at_the_first_root() -> None:
    noise = np.random.default_rng(7)
    met = 0
    for _ in range(300):
        gap, v, a, h = noise.uniform(0.001, 0.5), noise.normal(), 2.0 * noise.normal(), noise.uniform(0.1, 3.0)
        expected = first_root([-gap, v, 0.5 * a], h)
        assert line(gap, v, a, h) == pytest.approx(expected, rel=1e-9)
        met += expected < np.inf
    assert 50 < met < 250
    assert line(0.3, 0.5, 0.0, 1.0) == pytest.approx(0.6)
    assert line(0.3, 0.5, 0.0, 0.5) == np.inf


def test_at_a_line_what_approaches_meets_it_at_once_and_what_leaves_when_it_is_back() -> None:
    assert line(0.0, 1.0, -5.0, 1.0) == 0.0
    assert line(0.0, 0.0, 2.0, 1.0) == -1.0, "pressed"
    assert line(0.0, 0.0, -2.0, 1.0) == np.inf
    assert line(0.0, -1.0, 4.0, 1.0) == pytest.approx(0.5)
    assert line(0.0, -1.0, 4.0, 0.4) == line(0.0, -1.0, -4.0, 1.0) == np.inf


@pytest.mark.parametrize("angle", [0.2, 1.1, 2.5, 4.0])
def test_straight_ways_of_two_balls_meet_by_the_quadratic(angle: float) -> None:
    """Relative motion along one line: none, or along it, speeding up, slowing down, turning back."""
    way, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    for offset in (0.0, 0.5 * D, -0.9 * D, 1.1 * D):
        for speed, push in ((0.8, 0.0), (0.8, 0.5), (0.8, -0.2), (0.8, -0.9), (0.0, 0.7), (-0.5, 0.9)):
            x, v, a = -0.4 * way + offset * across, speed * way, push * way
            room = D * D - offset * offset
            gap = 0.4 - np.sqrt(room) if room > 0.0 else np.inf
            expected = first_root([-gap, speed, 0.5 * push], 2.0) if room > 0.0 else np.inf
            assert meeting(Parabola(*x, *v, *a), D, 2.0) == pytest.approx(expected, rel=1e-7)


@pytest.mark.parametrize("angle", [0.2, 1.1, 2.5, 4.0])
def test_balls_that_touch_meet_press_or_part(angle: float) -> None:
    way, across = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    x = -(D - 1e-15) * way
    assert meeting(Parabola(*x, *(0.3 * way + across), *(0.0 * way)), D, 1.0) == 0.0
    assert meeting(Parabola(*x, *(0.0 * way), *(0.2 * way)), D, 1.0) == -1.0
    assert meeting(Parabola(*x, *(0.0 * way), *(-0.2 * way)), D, 1.0) == np.inf
    assert meeting(Parabola(*x, *(0.1 * across), *(0.05 * way)), D, 1.0) == np.inf, "it flies off: v^2 / D > a"
    assert meeting(Parabola(*x, *(-0.3 * way), *(1.5 * way)), D, 1.0) == pytest.approx(0.4)
    assert meeting(Parabola(*x, *(-0.3 * way), *(1.5 * way)), D, 0.3) == np.inf


def test_meetings_are_the_same_in_any_mirror() -> None:
    noise = np.random.default_rng(9)
    for _ in range(100):
        x, v, a = noise.uniform(-0.3, 0.3, 2), noise.normal(size=2), noise.normal(size=2)
        if np.hypot(*x) < 1.01 * D:
            continue
        t = meeting(Parabola(*x, *v, *a), D, 1.0)
        for m in (np.array([[0, 1], [1, 0]]), np.diag([-1, 1]), np.diag([1, -1])):
            assert meeting(Parabola(*(m @ x), *(m @ v), *(m @ a)), D, 1.0) == pytest.approx(t, rel=1e-9)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_mouths_are_at_the_ends_of_all_rails_and_in_the_middle_of_long_ones(side: float) -> None:
    half, mouths = np.array([1.77, 0.88]), np.array([0.06, 0.05])
    for rail in range(4):
        length = half[1 - rail // 2]
        assert in_mouth(side * (length - 0.059), rail, half, mouths)
        assert not in_mouth(side * (length - 0.061), rail, half, mouths)
        assert in_mouth(side * 0.049, rail, half, mouths) == (rail >= 2)
        assert not in_mouth(side * 0.051, rail, half, mouths)
        assert not in_mouth(side * (length - 0.059), rail, half, np.zeros(2)), "no pockets"
