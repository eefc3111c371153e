"""Rolling resistance that grows with speed: a further deceleration k v while a ball rolls.

Force -M k v with the torque that keeps the ball rolling, I k v / R. The rolling deceleration is then mu_r g + k v,
and never less than 0: cloth drives no ball.
Form: physics of rolling on felt gives no unique law; a linear term is the least that a camera can distinguish from
a constant one. Air drag has the same sign and nearly the same shape (v^2), so the two are nearly confounded.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import BallState, Effect, param


@dataclass(frozen=True)
class SpeedDrag(Effect):
    """Rolling resistance linear in speed."""

    rate: float = param(
        0.01, off=0.0, unit="1/s", bounds=(-0.1, 0.2), source="physics estimate: up to 5 % of mu_r g per m/s"
    )

    def forces(self, ball: BallState) -> None:
        """Drag on rolling balls: k v."""
        if ball.rolling:
            ball.drag += self.rate * math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy)
