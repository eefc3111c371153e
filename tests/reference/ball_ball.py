"""Two balls: the impulse model with cloth, its closed form without, and the baseline that knows no spin.

`collide_balls`: Mathavan, Jackson, Parkin 2014 (models/analytic/impulse.py). `frictional`: with v_z free and no cloth
the slip s = v_i - v_j + R (omega_i + omega_j) x n keeps its direction, so J_n = M (1 + e) v_n / 2 and
J_t = min(mu J_n, M |s| / 7) against s (Alciatore TP A.14). mu is a number, or the law mu(s) = a + b exp(-c s) that
Alciatore fitted to Marlow's pool balls: of the slip of the moment in the impulse model, of the slip before the impact
in the closed form, as he has it. `no_spin`: normal velocities alone. All leave out that
the line of centres turns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.analytic.coulomb import MIN_STEPS
from models.analytic.impulse import ImpactLaw, collide
from models.shot import Ball

Array = NDArray[np.float64]
State = tuple[Array, Array, Array, Array]


@dataclass(frozen=True)
class SpeedFriction:
    """mu(s) = a + b exp(-c s) for a slip speed s [m/s]; pool balls, after Marlow (Alciatore TP A.14)."""

    a: float = 0.009951  # [1], bounds 0 to 0.1
    b: float = 0.108  # [1], bounds 0 to 0.5
    c: float = 1.088  # [s/m], bounds 0 to 10

    def __call__(self, slip_speed: ArrayLike) -> Array:
        """Friction at slip speeds [m/s]."""
        return self.a + self.b * np.exp(-self.c * np.asarray(slip_speed, float))


Friction = float | SpeedFriction


def _unit(normal: ArrayLike) -> Array:
    n = np.zeros(3)
    n[:2] = np.asarray(normal, float)[:2]
    return n / np.linalg.norm(n)


def contact_slip(v1: ArrayLike, w1: ArrayLike, v2: ArrayLike, w2: ArrayLike, normal: ArrayLike, radius: float) -> Array:
    """Slip of ball 1 over ball 2 where they touch: (3,) [m/s]."""
    n = _unit(normal)
    d = np.zeros(3)
    d[:2] = np.asarray(v1, float)[:2] - np.asarray(v2, float)[:2]
    s = d + radius * np.cross(np.asarray(w1, float) + np.asarray(w2, float), n)
    return s - n * (s @ n)


def _friction(mu: Friction, slip: Array) -> float:
    return float(mu(np.linalg.norm(slip))) if callable(mu) else float(mu)


def collide_balls(
    v1: ArrayLike, w1: ArrayLike, v2: ArrayLike, w2: ArrayLike, normal: ArrayLike, ball: Ball, *, restitution: float,
    friction: Friction, cloth: float, steps: int = MIN_STEPS,
) -> State:  # fmt: skip
    """Velocities (2,) [m/s] and spins (3,) [rad/s] of both balls after an impact; `normal` (2,) points from 1 to 2."""
    n = _unit(normal)
    turn = np.array([[n[0], n[1]], [-n[1], n[0]]])
    mu, gain, decay = (
        (friction.a, friction.b, friction.c) if isinstance(friction, SpeedFriction) else (friction, 0.0, 0.0)
    )
    state = np.empty(10)
    for k, (v, w) in enumerate(((v1, w1), (v2, w2))):
        spin = np.asarray(w, float)
        state[5 * k : 5 * k + 2] = turn @ np.asarray(v, float)[:2]
        state[5 * k + 2 : 5 * k + 4] = turn @ spin[:2]
        state[5 * k + 4] = spin[2]
    law = ImpactLaw(float(restitution), float(mu), float(cloth), float(gain), float(decay))
    collide(False, state, law, ball.radius, steps)
    out = [
        np.concatenate([turn.T @ state[5 * k : 5 * k + 2], turn.T @ state[5 * k + 2 : 5 * k + 4], [state[5 * k + 4]]])
        for k in range(2)
    ]
    return out[0][:2], out[0][2:], out[1][:2], out[1][2:]


def frictional(
    v1: ArrayLike, w1: ArrayLike, v2: ArrayLike, w2: ArrayLike, normal: ArrayLike, ball: Ball, *, restitution: float,
    friction: Friction,
) -> State:  # fmt: skip
    """The same by the closed form: no cloth, and what would be vertical velocity is discarded."""
    n = _unit(normal)
    a, b = np.asarray(v1, float)[:2], np.asarray(v2, float)[:2]
    p, q = np.asarray(w1, float), np.asarray(w2, float)
    approach = max(float((a - b) @ n[:2]), 0.0)
    s = contact_slip(v1, w1, v2, w2, normal, ball.radius)
    size = float(np.linalg.norm(s))
    push = 0.5 * (1.0 + restitution) * approach
    rub = -min(_friction(friction, s) * push, size / 7.0) * s / size if size > 0.0 else np.zeros(3)
    spun = 2.5 / ball.radius * np.cross(n, rub)
    return a - push * n[:2] + rub[:2], p + spun, b + push * n[:2] - rub[:2], q + spun


def no_spin(v1: ArrayLike, v2: ArrayLike, normal: ArrayLike, *, restitution: float) -> tuple[Array, Array]:
    """Velocities (2,) [m/s] after an impact without friction; with restitution 1 a stun shot parts at 90 degrees."""
    n = _unit(normal)[:2]
    a, b = np.asarray(v1, float)[:2], np.asarray(v2, float)[:2]
    push = 0.5 * (1.0 + restitution) * max(float((a - b) @ n), 0.0) * n
    return a - push, b + push


def throw_angle(velocity: ArrayLike, normal: ArrayLike) -> float:
    """By how much the object ball leaves the line of centres, counter-clockwise positive [rad]."""
    n, v = _unit(normal), np.asarray(velocity, float)
    return float(np.arctan2(n[0] * v[1] - n[1] * v[0], n[:2] @ v[:2]))


THROW = [  # cut [deg]: stun at 0.447, 1.341, 3.129 m/s; roll at the same; Alciatore's law, e = 1 [deg]
    (5, (0.716, 0.716, 0.716), (0.381, 0.175, 0.068)),
    (10, (1.443, 1.443, 1.443), (0.760, 0.349, 0.135)),
    (20, (2.976, 2.976, 2.500), (1.496, 0.687, 0.265)),
    (30, (4.715, 3.549, 1.698), (2.186, 1.004, 0.388)),
    (45, (4.945, 2.773, 1.127), (3.091, 1.420, 0.549)),
    (60, (4.621, 2.318, 0.895), (3.783, 1.739, 0.672)),
]
