"""A ball and a cushion as others have it: Han's law, measured rebounds, and one call for the 2010 impulse model.

`mathavan2010`: nose at 7/5 R, rigid, friction at nose and cloth, energetic restitution, the ball stays on the cloth
(Mathavan, Jackson, Parkin 2010; models/analytic/impulse.py). `han2005`: a free ball meets the nose once,
P = (1 + e) M v_y cos(theta), friction stops the slip s with 2 M / 7 |s| or is mu P, and the vertical velocity is
discarded (Han 2005, with the misprints mended). So Han's ball loses what it would take upwards and needs a restitution
above the measured one. Both leave out that a real cushion gives way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.analytic.coulomb import MIN_STEPS
from models.analytic.impulse import ImpactLaw, collide
from models.shot import NOSE_COSINE, NOSE_SINE, Ball

Array = NDArray[np.float64]
Restitution = float | Callable[[float], ArrayLike]


@dataclass(frozen=True)
class TwoPiece:
    """Restitution that falls beyond a normal speed: the figure with which the 2010 model meets its own measurements."""

    low: float = 0.98  # [1]; Mathavan 2010
    slope: float = 0.10  # [s/m]; from the markers of Mathavan 2010 fig. 7
    knee: float = 2.1  # [m/s]; the same

    def __call__(self, speed: ArrayLike) -> Array:
        """Restitution at normal speeds [m/s]."""
        return np.clip(self.low - self.slope * np.maximum(np.asarray(speed, float) - self.knee, 0.0), 0.0, 1.0)


def han_restitution(speed: ArrayLike) -> Array:
    """Han's carom cushion: 0.39 + 0.257 v - 0.044 v^2 for a normal speed [m/s]."""
    v = np.asarray(speed, float)
    return 0.39 + 0.257 * v - 0.044 * v * v


def rolling_rebound(speed: ArrayLike) -> Array:
    """Speed after a perpendicular rolling rebound, as Mathavan 2009 measured it from 0.28 to 3.5 m/s [m/s]."""
    v = np.asarray(speed, float)
    return -0.0877 * v * v + 1.131 * v - 0.0953


def han2005(state: Array, e: float, friction: float, radius: float) -> None:
    """Han's impact of a state (va, vb, wa, wb, wz), b into the cushion, in place."""
    if state[1] <= 0.0:
        return
    p = (1.0 + e) * state[1] * NOSE_COSINE
    sx = state[0] + radius * (state[3] * NOSE_SINE - state[4] * NOSE_COSINE)
    sy = -state[1] * NOSE_SINE + radius * state[2]
    size = math.hypot(sx, sy)
    rub = min(friction * p, 2.0 / 7.0 * size) / size if size > 0.0 else 0.0
    fx, fy = -rub * sx, -rub * sy
    state[0] += fx
    state[1] -= p * NOSE_COSINE + fy * NOSE_SINE
    state[2] += 2.5 / radius * fy
    state[3] += 2.5 / radius * fx * NOSE_SINE
    state[4] -= 2.5 / radius * fx * NOSE_COSINE


def collide_cushion(
    velocity: ArrayLike, spin: ArrayLike, normal: ArrayLike, ball: Ball, *, restitution: Restitution, friction: float,
    cloth: float = 0.0, law: str = "mathavan2010", steps: int = MIN_STEPS,
) -> tuple[Array, Array]:  # fmt: skip
    """Velocity (2,) [m/s] and spin (3,) [rad/s] after an impact.

    `normal` (2,) points into the cushion; a restitution may be a function of the normal speed [m/s]; `law` is
    "mathavan2010" or "han2005", which knows no cloth.
    """
    b = np.asarray(normal, float)[:2] / np.linalg.norm(np.asarray(normal, float)[:2])
    turn = np.array([[b[1], -b[0]], [b[0], b[1]]])
    w = np.asarray(spin, float)
    state = np.concatenate([turn @ np.asarray(velocity, float)[:2], turn @ w[:2], w[2:3]])
    speed = max(float(state[1]), 0.0)
    e = float(np.asarray(restitution(speed))) if callable(restitution) else float(restitution)
    if law == "han2005":
        han2005(state, e, float(friction), ball.radius)
    else:
        collide(True, state, ImpactLaw(e, float(friction), float(cloth)), ball.radius, steps)
    return turn.T @ state[:2], np.concatenate([turn.T @ state[2:4], state[4:5]])
