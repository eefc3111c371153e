"""The springs of contacts against closed forms: contact times, restitution and damping, the depth at the nose."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.analytic.spring import (
    BALL_TIME,
    CUSHION_TIME,
    MIN_GIVEN_BACK,
    NOSE_RADIUS,
    SPRING_STEP_S,
    depth_of,
    pushed,
)
from models.shot import NOSE_COSINE, NOSE_SINE

R = 0.02625


def contact(cushion: bool, speed: float, e: float, finer: int = 20) -> tuple[float, float]:
    """How long a contact per unit of mass takes [s], and the speed it gives back over that it began with."""
    step, depth, deepest, v, time = SPRING_STEP_S / finer, 0.0, 0.0, speed, 0.0
    while depth >= 0.0 and time < 1.0:
        deepest = max(deepest, depth)
        force = pushed(cushion, depth, deepest, e, v)
        if force == 0.0 and time > 0.0 and v <= 0.0:
            break
        v -= step * force
        depth, time = depth + step * v, time + step
    return time, -v / speed


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0])
def test_contact_times_are_those_of_hertz_and_of_half_a_period(speed: float) -> None:
    assert contact(False, speed, 1.0)[0] == pytest.approx(BALL_TIME * speed**-0.2, rel=0.01)
    assert contact(True, speed, 1.0)[0] == pytest.approx(CUSHION_TIME, rel=0.01)


@pytest.mark.parametrize("e", [0.15, 0.4, 0.6, 0.8, 0.95, 1.0])
@pytest.mark.parametrize("cushion", [False, True])
def test_restitution_is_what_was_asked_for_at_any_speed(cushion: bool, e: float) -> None:
    for speed in (0.05, 0.5, 2.0, 6.0):
        assert contact(cushion, speed, e)[1] == pytest.approx(e, abs=0.003)
        assert contact(cushion, speed, e, finer=1)[1] == pytest.approx(e, abs=0.03)


def test_an_impact_takes_half_a_period_to_load_and_less_to_unload() -> None:
    assert contact(True, 1.0, 0.5)[0] == pytest.approx(CUSHION_TIME * (1.0 + 0.5) / 2.0, rel=0.01)


@pytest.mark.parametrize("cushion", [False, True])
def test_what_gives_nothing_back_comes_to_rest(cushion: bool) -> None:
    assert contact(cushion, 5e-4, 0.0)[1] < 0.1
    assert contact(cushion, 1.0, 0.5 * MIN_GIVEN_BACK)[1] == pytest.approx(MIN_GIVEN_BACK, abs=0.02)


def test_what_is_pressed_again_gives_back_no_more() -> None:
    """Work done on the way back in comes back as a whole: it goes up the line that it came down."""
    deep = 1e-4
    down = [pushed(True, x, deep, 0.6, -1.0) for x in np.linspace(0.7, 1.0, 20) * deep]
    again = [pushed(True, x, deep, 0.6, 1.0) for x in np.linspace(0.7, 1.0, 20) * deep]
    assert down == again
    assert pushed(True, deep, deep, 0.6, 0.0) == pytest.approx(deep * (np.pi / CUSHION_TIME) ** 2)


@pytest.mark.parametrize("gap", [0.0, -1e-5, -1e-3])
def test_depths_are_those_of_spheres_and_of_a_capsule(gap: float) -> None:
    assert depth_of(False, gap, R) == (-gap, 1.0)
    touch = np.array([NOSE_COSINE, NOSE_SINE]) * (R + NOSE_RADIUS)  # from the ball's centre to the capsule's
    apart = touch + np.array([gap, 0.0])
    depth, level = depth_of(True, gap, R)
    assert depth == pytest.approx(R + NOSE_RADIUS - np.hypot(*apart), abs=1e-15)
    assert level == pytest.approx(math.cos(math.atan2(apart[1], apart[0])), rel=1e-12)
