"""Sidespin that decays faster on a ball that moves: alpha (1 + k v), v the speed of the ball.

Source: derived; the one measured alpha (Robotic Billiards, 2015) is that of a ball spun on the spot, and a moving one
drags its patch over fresh cloth. A linear law is the simplest that a camera can identify. Never below zero. Leaves out
that slip and sidespin share a patch (spin_slide_coupling), which has the opposite sign.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import BallState, Effect, param


@dataclass(frozen=True)
class SpinDecaySpeed(Effect):
    """Growth of the sidespin's deceleration with speed."""

    rate: float = param(
        0.2, off=0.0, unit="s/m", bounds=(-0.5, 2.0), source="estimate; alpha was measured at rest only"
    )

    def forces(self, ball: BallState) -> None:
        """The factor of the sidespin's deceleration."""
        speed = math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy)
        ball.spin_factor *= max(1.0 + self.rate * speed, 0.0)
