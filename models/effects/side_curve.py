"""Sidespin bends a rolling ball's path: lateral acceleration c omega_z.

The centre of pressure lies ahead of the contact by some tenths of a millimetre, so a ball turning about the vertical
rolls off to the side its front turns to: positive omega_z (right side, counter-clockwise) drifts to the left of the
motion for positive c. Torque goes along, so that it keeps rolling. Source: derived from the offset of the rolling
resistance, of order (7/5) mu_r R; sign and size are for the data to say.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from models.effect import Array, Balls, Effect, column, param

ROLLING = 1e-6  # slip below which a ball rolls [m/s]
STEP = 0.2  # sidespin and heading change little in this time [s]


@dataclass(frozen=True)
class SideCurve(Effect):
    """Lateral acceleration in proportion to sidespin."""

    rate: float = param(
        0.001, off=0.0, unit="m/rad/s", bounds=(-0.01, 0.01), source="estimate: 2/7 of 0.5 mm times alpha / omega_z"
    )

    varies: ClassVar[bool] = True

    def forces(self, balls: Balls) -> None:
        """Push to the left of the motion, and the torque that keeps the ball rolling."""
        m, r, inertia = balls.ball.mass, balls.ball.radius, balls.ball.inertia
        slip = balls.slip
        speed = np.hypot(balls.velocity[..., 0], balls.velocity[..., 1])
        rolling = (np.hypot(slip[..., 0], slip[..., 1]) < ROLLING) & (speed > 1e-6) & (balls.normal > 0)
        size = np.where(rolling, column(self.rate) * balls.spin[..., 2], 0.0) / np.where(rolling, speed, 1.0)
        ax, ay = -size * balls.velocity[..., 1], size * balls.velocity[..., 0]
        balls.force[..., 0] += m * ax
        balls.force[..., 1] += m * ay
        balls.torque[..., 0] -= inertia / r * ay
        balls.torque[..., 1] += inertia / r * ax

    def horizon(self, balls: Balls) -> Array:
        """Short steps while a spinning ball rolls: (nsim, nball) [s]."""
        slip = balls.slip
        rolling = np.hypot(slip[..., 0], slip[..., 1]) < ROLLING
        moving = np.hypot(balls.velocity[..., 0], balls.velocity[..., 1]) > 1e-6
        return np.where(rolling & moving & (np.abs(balls.spin[..., 2]) > 1e-3), STEP, np.inf)
