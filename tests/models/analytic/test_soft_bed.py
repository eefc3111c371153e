"""A bed that gives way under a nose: against an independent program, and Han's law where it is not there at all."""

from __future__ import annotations

import numpy as np
import pytest

from models.analytic.impulse import ImpactLaw, collide
from models.shot import Array
from tests.support.impacts import CUSHION, MASS, RADIUS, approaching, energy, random_states
from tests.truth.impact import NOSE, impact, springs

SCALE = np.array([1, 1, RADIUS, RADIUS, RADIUS])


def rebound(state: Array, sink: float, law: tuple[float, float, float], compliance: float = 0.0) -> Array:
    """The state after a cushion of restitution, friction and cloth; spins as R omega [m/s] in and out."""
    out = np.asarray(state, float) / SCALE
    collide(True, out, ImpactLaw(*law, compliance=compliance, sink=sink), RADIUS)
    return out * SCALE


@pytest.mark.parametrize("sink", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("compliance", [0.0, 1.5])
def test_it_is_what_small_increments_make_of_it(sink: float, compliance: float) -> None:
    off = []
    for state in random_states(True, 40):
        a, b, wa, wb, wz = state / SCALE
        met = np.array([[b, -a, wb, -wa, wz], [0, 0, 0, 0, 0.0]])
        if compliance:
            after = springs(met, 0.9, 0.14, 0.2, MASS, RADIUS, 20_000, 0.4, compliance, sink)[0]
        else:
            after = impact(
                NOSE, met, 0.9, (0.14, 0.0, 0.0), 0.2, np.full(2, MASS), RADIUS, 20_000, 0.4, sink
            )[0]  # fmt: skip
        b, a, wb, wa, wz = after
        off.append(np.abs(rebound(state, sink, (0.9, 0.14, 0.2), compliance) - np.array([-a, b, -wa, wb, wz]) * SCALE))
    assert np.median(off) < 2e-5 and np.max(off) < 5e-4


# A rolling ball by Han's closed form, e = 0.98, mu = 0.14: angle from the cushion, speed, angle after it [deg].
@pytest.mark.parametrize(("angle", "speed", "back"), [(30, 0.836, 25.3), (45, 0.779, 41.9), (60, 0.759, 59.1)])
def test_without_a_bed_it_is_the_law_of_han(angle: float, speed: float, back: float) -> None:
    after = rebound(approaching(True, angle, 1.0, 0.0), 1.0, CUSHION)
    assert np.hypot(after[0], after[1]) == pytest.approx(speed, abs=1e-3)
    assert np.degrees(np.arctan2(-after[1], after[0])) == pytest.approx(back, abs=0.1)


@pytest.mark.parametrize("sink", [0.2, 1.0])
def test_energy_never_rises(sink: float) -> None:
    for state in random_states(True, 200):
        after = rebound(state, sink, CUSHION)
        assert np.isfinite(after).all() and energy(after) <= energy(state) * (1 + 1e-7)
