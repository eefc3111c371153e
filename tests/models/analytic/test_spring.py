"""The springs of contacts against closed forms: contact times, restitution and damping, the depth at the nose."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.analytic.spring import (
    BALL_TIME,
    CUSHION_TIME,
    NOSE_RADIUS,
    SPRING_STEP_S,
    damping_of,
    damping_table,
    dampings,
    depth_of,
    spring,
)
from models.shot import NOSE_COSINE, NOSE_SINE

R = 0.02625


def contact(cushion: bool, speed: float, damping: float) -> tuple[float, float]:
    """How long a contact per unit of mass takes [s] and the speed it gives back over that it began with."""
    step, depth, v, time = 0.05 * SPRING_STEP_S, 0.0, speed, 0.0
    while depth >= 0.0 and time < 1.0:
        k, b = spring(cushion, depth, damping)
        v -= step * max(k * depth + b * v, 0.0)
        depth, time = depth + step * v, time + step
    return time, -v / speed


@pytest.mark.parametrize("speed", [0.25, 1.0, 4.0])
def test_contact_times_are_those_of_hertz_and_of_half_a_period(speed: float) -> None:
    assert contact(False, speed, 0.0)[0] == pytest.approx(BALL_TIME * speed**-0.2, rel=0.01)
    assert contact(True, speed, 0.0)[0] == pytest.approx(CUSHION_TIME, rel=0.01)


def damped_restitution(ratio: float) -> float:
    """Of an oscillator with this damping ratio that is let go where its force ends (Schwager, Pöschel 2007)."""
    root = math.sqrt(1.0 - ratio * ratio)
    return math.exp(-ratio / root * (math.pi - math.atan2(2.0 * ratio * root, 1.0 - 2.0 * ratio * ratio)))


@pytest.mark.parametrize("e", [0.4, 0.6, 0.8, 0.95])
def test_restitution_follows_from_damping_in_closed_form(e: float) -> None:
    """The spring of Hertz is the linear one in d^(5/4), with sqrt(5) times its damping (Antypov, Elliott 2011)."""
    table = damping_table()
    for cushion, scale in ((True, 1.0), (False, math.sqrt(5.0))):
        damping = damping_of(cushion, e, table)
        assert damped_restitution(damping / scale) == pytest.approx(e, abs=0.02)
        assert float(dampings(cushion, np.array([e]))[0]) == pytest.approx(damping, rel=1e-12)
        for speed in (0.5, 2.0):
            assert contact(cushion, speed, damping)[1] == pytest.approx(e, abs=0.02)


def test_damping_ends_where_restitution_does() -> None:
    table = damping_table()
    for row, cushion in enumerate((False, True)):
        assert damping_of(cushion, -0.1, table) == table[2, 0] == 4.0
        assert damping_of(cushion, 1.1, table) == table[2, -1] == 0.0
        between = np.linspace(table[row, 5], table[row, -5], 40)
        assert np.all(np.diff([damping_of(cushion, e, table) for e in between]) < 0.0)


@pytest.mark.parametrize("gap", [0.0, -1e-5, -1e-3])
def test_depths_are_those_of_spheres_and_of_a_capsule(gap: float) -> None:
    assert depth_of(False, gap, R) == (-gap, 1.0)
    touch = np.array([NOSE_COSINE, NOSE_SINE]) * (R + NOSE_RADIUS)  # from the ball's centre to the capsule's
    apart = touch + np.array([gap, 0.0])
    depth, level = depth_of(True, gap, R)
    assert depth == pytest.approx(R + NOSE_RADIUS - np.hypot(*apart), abs=1e-15)
    assert level == pytest.approx(math.cos(math.atan2(apart[1], apart[0])), rel=1e-12)
