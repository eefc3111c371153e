"""Small steps of an impact add up to the rigid impact, and obey what any impact does."""

from __future__ import annotations

import numpy as np
import pytest

from models.analytic.impulse import ImpactLaw, collide
from models.analytic.increments import ball_step, cushion_step
from models.shot import NOSE_SINE, Array

MASS, R, CLOTH = 0.1406, 0.02625, 0.212
STEPS = 400  # of a compression, about


def ball(noise: np.random.Generator, way: tuple[float, float]) -> Array:
    """A ball (va, vb, wa, wb, wz) on its way, between sliding and rolling, with side."""
    x, y = way
    roll = noise.uniform(-0.5, 1.5)
    return np.array([x, y, -roll * y / R, roll * x / R, noise.uniform(-1, 1) / R])


def compressed(
    cushion: bool, state: Array, mu: tuple[float, float, float], ratio: float, sine: float = NOSE_SINE
) -> Array:
    """The state where the approach ends, by small steps; the first ball is `ratio` times as heavy as the second."""
    own, s = ratio * MASS, state.copy()
    moved = own / np.sqrt(1.0 - sine**2) if cushion else own / (1.0 + ratio)
    dp = moved * (s[1] if cushion else s[0] - s[5]) / STEPS
    for _ in range(10 * STEPS):
        after = s.copy()
        if cushion:
            cushion_step(s, dp, (mu[0], CLOTH, own, R), after, sine)
        else:
            ball_step(s, dp, mu, (CLOTH, own, MASS, R), after)
        u, v = (s[1], after[1]) if cushion else (s[0] - s[5], after[0] - after[5])
        if v <= 0.0:
            return s + u / (u - v) * (after - s)
        s = after
    pytest.fail("the approach does not end")


@pytest.mark.parametrize(("mu", "sine"), [(0.05, 0.4), (0.14, 0.4), (0.4, 0.4), (0.2, 0.2), (0.14, 0.27)])
def test_steps_at_a_cushion_are_its_rigid_impact(mu: float, sine: float) -> None:
    noise = np.random.default_rng(1)
    for angle in (0.2, 0.7, 1.2, 1.9, 2.8):
        state = ball(noise, (np.cos(angle), np.sin(angle)))
        expected = state.copy()
        collide(True, expected, ImpactLaw(0.0, mu, CLOTH, sine=sine), R)
        error = (compressed(True, state, (mu, 0.0, 0.0), 1.0, sine) - expected) * [1, 1, R, R, R]
        assert np.abs(error).max() < 5e-5


@pytest.mark.parametrize("mu", [(0.05, 0.0, 0.0), (0.02, 0.108, 1.088), (0.3, 0.0, 0.0)])
@pytest.mark.parametrize("ratio", [1.0, 0.8, 1.25])
def test_steps_of_two_balls_are_their_rigid_impact(mu: tuple[float, float, float], ratio: float) -> None:
    noise = np.random.default_rng(2)
    for angle in (-1.1, -0.4, 0.3, 0.9):
        state = np.concatenate([ball(noise, (np.cos(angle), np.sin(angle))), ball(noise, (0.2, -0.1))])
        expected = state.copy()
        collide(False, expected, ImpactLaw(0.0, mu[0], CLOTH, mu[1], mu[2], ratio), R)
        error = (compressed(False, state, mu, ratio) - expected) * np.tile([1, 1, R, R, R], 2)
        assert np.abs(error).max() < 5e-5


@pytest.mark.parametrize("cushion", [True, False])
def test_mirrored_steps_are_mirrored(cushion: bool) -> None:
    """In the vertical plane of the normal; spins are axial."""
    noise = np.random.default_rng(3)
    flip = np.array([-1, 1, 1, -1, -1]) if cushion else np.tile([1, -1, -1, 1, -1], 2)
    state = ball(noise, (0.4, 0.9)) if cushion else np.concatenate([ball(noise, (0.9, 0.4)), ball(noise, (0.1, 0.2))])
    one, other = np.zeros_like(state), np.zeros_like(state)
    for s, out in ((state, one), (state * flip, other)):
        if cushion:
            cushion_step(s, 0.02, (0.14, CLOTH, MASS, R), out)
        else:
            ball_step(s, 0.02, (0.05, 0.1, 1.0), (CLOTH, MASS, 1.1 * MASS, R), out)
    assert other == pytest.approx(one * flip, rel=1e-12)
