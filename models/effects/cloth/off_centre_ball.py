"""A struck ball whose centre of mass is off its centre: it rolls to the heavy side, now left, now right.

Lateral acceleration g d/R sin(phi) along z x v while the ball rolls, phi the angle that it has rolled since t = 0.
Source: derived, (5/7) g d_axis/R for a centre of mass d_axis along the axis that it rolls about; an offset of 0.05 mm
is 0.002. Leaves out how the ball lay when it was struck, the tumbling of its axis, and the ripple of its speed.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import STRUCK_BALL, BallState, Effect, param, push_along
from models.shot import GRAVITY

TURN_PER_STEP = 2.0  # of a rolling ball, along which the sine is followed [rad]
SLOW_SPEED = 0.02  # below this speed steps do not shorten as much as the angle asks for [m/s]


@dataclass(frozen=True)
class OffCentreBall(Effect):
    """Lateral pull of the struck ball, which is ball number 0."""

    offset: float = param(
        0.001, off=0.0, unit="1", bounds=(-0.02, 0.02), source="0.05 mm of 26 mm would be 0.002 (estimate)"
    )

    def forces(self, ball: BallState) -> None:
        """The pull across the way of the struck ball, and the torque that keeps it rolling."""
        if ball.rolling and ball.number == STRUCK_BALL:
            push_along(ball, 0.0, GRAVITY * self.offset * math.sin(ball.rolled))

    def horizon(self, ball: BallState) -> float:
        """A part of a turn of the struck ball [s]."""
        if not (ball.rolling and ball.number == STRUCK_BALL):
            return math.inf
        return TURN_PER_STEP * ball.radius / max(math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy), SLOW_SPEED)
