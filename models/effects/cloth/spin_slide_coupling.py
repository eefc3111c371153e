"""Sidespin and slip share one patch of contact: each weakens the friction that the other meets.

While a ball slides at u, F = mu_s N u / sqrt(u^2 + (b omega_z)^2) and the sidespin's deceleration is
alpha |b omega_z| / sqrt(u^2 + (b omega_z)^2), with a lever b of the order of the patch. A rolling or resting ball is
left as it was. Source: Contensou (1963), in Zhuravlev's first-order form. Leaves out the exact law of a Hertz patch,
which differs by up to 40 %, and that rolling shares the patch too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import STILL, BallState, Effect, param

FAR_SLIP_RATIO, NEAR_SLIP_RATIO = 3.0, 2.0  # slip over the share of sidespin, where a step must end, and where it does


@dataclass(frozen=True)
class SpinSlideCoupling(Effect):
    """Friction of slip and sidespin shared by a lever."""

    lever: float = param(
        0.005, off=0.0, unit="m", bounds=(0.0, 0.03), source="Hertz patch of 4.95 mm, from alpha = 22 rad/s^2"
    )

    def forces(self, ball: BallState) -> None:
        """What is left of either friction where a ball slides."""
        slip = math.sqrt(ball.slip_x * ball.slip_x + ball.slip_y * ball.slip_y)
        twist = abs(self.lever * ball.wz)
        if slip > STILL and self.lever > 0.0:
            total = math.sqrt(slip * slip + twist * twist)
            ball.slide_factor *= slip / total
            ball.spin_factor *= twist / total

    def horizon(self, ball: BallState) -> float:
        """Until slip is no longer far above the share of sidespin, where friction turns soft [s]."""
        slip = math.sqrt(ball.slip_x * ball.slip_x + ball.slip_y * ball.slip_y)
        twist = abs(self.lever * ball.wz)
        pull_x, pull_y = ball.ax - ball.radius * ball.by, ball.ay + ball.radius * ball.bx
        rate = math.sqrt(pull_x * pull_x + pull_y * pull_y)
        if slip > FAR_SLIP_RATIO * twist and slip > STILL and twist > 0.0 and rate > 0.0:
            return (slip - NEAR_SLIP_RATIO * twist) / rate
        return math.inf
