"""Sliding friction that depends on the slip: mu_s (1 - k (u - 1 m/s)), u the speed of the lowest point.

Source: Witters and Duymelinck (1986) found 0.14 to 0.21, rising with slip, on a pool table; Mathavan, Jackson, Parkin
(2009) could not confirm it. A linear law is the least that separates a fast shot from a slow one. Never less
than 0.05 of mu_s. Leaves out what happens at impacts, where the cloth has its plain friction.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import MIN_FRICTION_SHARE, REFERENCE_SPEED, STILL, BallState, Effect, param


@dataclass(frozen=True)
class SlideFrictionSpeed(Effect):
    """Fall of the sliding friction with slip, relative to its value at 1 m/s."""

    rate: float = param(
        0.05, off=0.0, unit="s/m", bounds=(-0.3, 0.3), source="Witters, Duymelinck 1986: some -0.2; Mathavan 2009: none"
    )

    def forces(self, ball: BallState) -> None:
        """The friction's factor where a ball slides."""
        slip = math.sqrt(ball.slip_x * ball.slip_x + ball.slip_y * ball.slip_y)
        if slip > STILL:
            ball.slide_factor *= max(1.0 - self.rate * (slip - REFERENCE_SPEED), MIN_FRICTION_SHARE)
