"""Rolling resistance that grows with speed: a further deceleration k v while a ball rolls.

Force -M k v with the torque that keeps the ball rolling, I k v / R. The rolling deceleration is then mu_r g + k v.
Form: physics of rolling on felt gives no unique law; a linear term is the least that a camera can tell from a constant
one. Air drag has the same sign and nearly the same shape (v^2), so the two are hard to tell apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from models.effect import Array, Balls, Effect, column, param

ROLLING = 1e-6  # slip below which a ball rolls [m/s]
STEP = 0.3  # the middle of a step is then right to 0.05 mm over ten metres [s]


@dataclass(frozen=True)
class SpeedDrag(Effect):
    """Rolling resistance linear in speed."""

    rate: float = param(
        0.01, off=0.0, unit="1/s", bounds=(-0.1, 0.2), source="physics estimate: up to 5 % of mu_r g per m/s"
    )

    varies: ClassVar[bool] = True

    def forces(self, balls: Balls) -> None:
        """Drag and its torque on rolling balls."""
        m, r, inertia = balls.ball.mass, balls.ball.radius, balls.ball.inertia
        slip = balls.slip
        rolling = (np.hypot(slip[..., 0], slip[..., 1]) < ROLLING) & (balls.normal > 0)
        drag = np.where(rolling, column(self.rate) * np.ones_like(balls.normal), 0.0)[..., None]
        drag = drag * balls.velocity[..., :2]
        balls.force[..., :2] -= m * drag
        balls.torque[..., 0] += inertia / r * drag[..., 1]
        balls.torque[..., 1] -= inertia / r * drag[..., 0]

    def horizon(self, balls: Balls) -> Array:
        """Short steps while any ball rolls: (nsim, nball) [s]."""
        slip = balls.slip
        rolling = np.hypot(slip[..., 0], slip[..., 1]) < ROLLING
        moving = np.hypot(balls.velocity[..., 0], balls.velocity[..., 1]) > 1e-6
        return np.where(rolling & moving, STEP, np.inf)
