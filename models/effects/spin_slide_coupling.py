"""Sidespin and slip share one patch of contact: each weakens the friction that the other meets.

While a ball slides at u, F = mu_s N u / sqrt(u^2 + (b omega_z)^2) and the sidespin's deceleration is
alpha |b omega_z| / sqrt(u^2 + (b omega_z)^2), with a lever b of the order of the patch. A rolling or resting ball is
left as it was. Source: Contensou (1963), in Zhuravlev's first-order form. Leaves out the exact law of a Hertz patch,
which differs by up to 40 %, and that rolling shares the patch too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from models.effect import STILL, Array, Balls, Effect, column, param

FAR, NEAR = 3.0, 2.0  # slip over the share of sidespin, where a step must end, and where it does


@dataclass(frozen=True)
class SpinSlideCoupling(Effect):
    """Friction of slip and sidespin shared by a lever."""

    lever: float = param(
        0.005, off=0.0, unit="m", bounds=(0.0, 0.03), source="Hertz patch of 4.95 mm, from alpha = 22 rad/s^2"
    )

    varies: ClassVar[bool] = True

    def forces(self, balls: Balls) -> None:
        """What is left of either friction where a ball slides."""
        slip = np.hypot(balls.slip[..., 0], balls.slip[..., 1])
        lever = np.broadcast_to(column(self.lever), slip.shape)
        twist = np.abs(lever * balls.spin[..., 2])
        total = np.hypot(slip, twist)
        shared = (slip > STILL) & (lever > 0)
        balls.slide_factor *= np.divide(slip, total, out=np.ones_like(slip), where=shared)
        balls.spin_factor *= np.divide(twist, total, out=np.ones_like(slip), where=shared)

    def horizon(self, balls: Balls) -> Array:
        """Until slip is no longer far above the share of sidespin, where friction turns soft: (nsim, nball) [s]."""
        slip = np.hypot(balls.slip[..., 0], balls.slip[..., 1])
        twist = np.broadcast_to(np.abs(column(self.lever) * balls.spin[..., 2]), slip.shape)
        turn = balls.torque / balls.ball.inertia * balls.ball.radius
        pull = balls.force[..., :2] / balls.ball.mass + np.stack([-turn[..., 1], turn[..., 0]], axis=-1)
        rate = np.hypot(pull[..., 0], pull[..., 1])
        far = (slip > FAR * twist) & (slip > STILL) & (twist > 0) & (rate > 0)
        return np.divide(slip - NEAR * twist, rate, out=np.full_like(slip, np.inf), where=far)
