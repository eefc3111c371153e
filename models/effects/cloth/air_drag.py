"""Drag of the air, in proportion to the speed squared, whether a ball slides or rolls.

Force -M k |v| v through the centre; a rolling ball is slowed by 5/7 of k v^2, as the cloth turns it along.
k = rho C_d pi R^2 / (2 M) = 0.0042 /m for a snooker ball (C_d 0.45, Reynolds number 3500 at 1 m/s). Never below 0: air
at rest drives no ball. It is confounded with speed_drag, whose power of the speed is one less, unless shots differ much
in speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import BallState, Effect, param


@dataclass(frozen=True)
class AirDrag(Effect):
    """Deceleration per speed squared."""

    rate: float = param(
        0.0042, off=0.0, unit="1/m", bounds=(0.0, 0.1), source="sphere, C_d 0.45; derived for a snooker ball"
    )

    def forces(self, ball: BallState) -> None:
        """-k |v| v."""
        speed = math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy)
        ball.ax -= self.rate * speed * ball.vx
        ball.ay -= self.rate * speed * ball.vy
