"""A nose that gives way along its face: against an independent program, its limits, and what any impact obeys."""

from __future__ import annotations

import numpy as np
import pytest

from models.analytic.compliant import MIN_COMPLIANCE
from models.analytic.impulse import ImpactLaw, collide
from models.shot import Array
from tests.support.impacts import CUSHION, MASS, MIRROR, RADIUS, energy, random_states
from tests.truth.impact import springs

SCALE = np.array([1, 1, RADIUS, RADIUS, RADIUS])


def rebound(
    state: Array, compliance: float, e: float = 0.9, mu: float = 0.14, cloth: float = 0.2, sine: float = 0.4
) -> Array:
    """The state after a cushion; spins as R omega [m/s] in and out."""
    out = np.asarray(state, float) / SCALE
    collide(True, out, ImpactLaw(e, mu, cloth, sine=sine, compliance=compliance), RADIUS)
    return out * SCALE


@pytest.mark.parametrize("compliance", [0.1, 0.5, 1.5, 4.0, 12.0])
@pytest.mark.parametrize(("e", "mu", "sine"), [(0.9, 0.14, 0.4), (0.5, 0.3, 0.2), (1.0, 0.05, 0.27)])
def test_it_is_what_two_springs_make_of_it(compliance: float, e: float, mu: float, sine: float) -> None:
    off = []
    for state in random_states(True, 40):
        a, b, wa, wb, wz = state / SCALE
        met = np.array([[b, -a, wb, -wa, wz], [0, 0, 0, 0, 0.0]])
        b, a, wb, wa, wz = springs(met, e, mu, 0.2, MASS, RADIUS, 30_000, sine, compliance)[0]
        off.append(np.abs(rebound(state, compliance, e, mu, 0.2, sine) - np.array([-a, b, -wa, wb, wz]) * SCALE).max())
    assert np.median(off) < 1e-4 and max(off) < 1e-3


def test_a_stiff_face_is_the_rigid_one() -> None:
    off = [np.abs(rebound(s, MIN_COMPLIANCE) - rebound(s, 0.0)).max() for s in random_states(True, 100)]
    assert np.median(off) < 1e-3 and max(off) < 0.02


@pytest.mark.parametrize("e", [0.0, 0.02, 0.5, 1.0])
def test_without_friction_the_face_does_nothing(e: float) -> None:
    for state in random_states(True, 10):
        assert rebound(state, 1.5, e, 0.0, 0.0) == pytest.approx(state * [1, -e, 1, 1, 1], abs=1e-4)


def test_a_face_that_grips_turns_sidespin_back() -> None:
    """Straight on, without a cloth, friction enough: rubbing stops the slip, a spring reverses it."""
    state = np.array([0.0, 1.0, 0.0, 0.0, 0.5])

    def slip(after: Array) -> float:
        return float(after[0] - np.sqrt(0.84) * after[4] + 0.4 * after[3])

    before = slip(state)
    assert abs(slip(rebound(state, 0.0, 0.9, 0.4, 0.0))) < 1e-9
    assert -0.6 < slip(rebound(state, 1.5, 0.9, 0.4, 0.0)) / before < -0.3


@pytest.mark.parametrize("compliance", [0.01, 0.3, 1.5, 6.0])
def test_energy_never_rises_and_mirrors_agree(compliance: float) -> None:
    for state in random_states(True, 200):
        after = rebound(state, compliance, *CUSHION)
        assert np.isfinite(after).all() and after[1] < 0
        assert energy(after) <= energy(state) * (1 + 1e-4)
        assert np.array_equal(rebound(state * MIRROR[True], compliance, *CUSHION), after * MIRROR[True])


def test_results_scale_with_speed() -> None:
    for state in random_states(True, 50):
        assert rebound(3.0 * state, 1.5) == pytest.approx(3.0 * rebound(state, 1.5), abs=1e-12)


def test_results_follow_the_start_smoothly() -> None:
    """Slopes of differences of two sizes agree, so that fits can use them."""
    for state in random_states(True, 100):
        way = np.array([0.3, 0.2, 0.1, -0.2, 0.5])
        small, large = ((rebound(state + h * way, 1.5) - rebound(state - h * way, 1.5)) / (2 * h) for h in (1e-6, 1e-4))
        assert np.abs(small - large).max() < 0.1
