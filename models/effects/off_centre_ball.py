"""A struck ball whose centre of mass is off its centre: it rolls to the heavy side, now left, now right.

Lateral acceleration g d/R sin(phi) along z x v while the ball rolls, phi the angle that it has rolled since t = 0.
Source: derived, (5/7) g d_axis/R for a centre of mass d_axis along the axis that it rolls about; an offset of 0.05 mm
is 0.002. Leaves out how the ball lay when it was struck, the tumbling of its axis, and the ripple of its speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from models.effect import Array, Balls, Effect, column, param
from models.shot import GRAVITY

TURN = 1.0  # of a rolling ball, along which the sine is followed [rad]
SLOW = 0.02  # below this speed steps do not shorten as much as the angle asks for [m/s]


@dataclass(frozen=True)
class OffCentreBall(Effect):
    """Lateral pull of the struck ball, which is ball number 0."""

    offset: float = param(
        0.001, off=0.0, unit="1", bounds=(-0.02, 0.02), source="0.05 mm of 26 mm would be 0.002 (estimate)"
    )

    varies: ClassVar[bool] = True

    def forces(self, balls: Balls) -> None:
        """The pull across the way of the struck ball, and the torque that keeps it rolling."""
        v = balls.velocity[:, :1, :2]
        speed = np.hypot(v[..., 0], v[..., 1])
        rolls = balls.rolling[:, :1]
        size = np.where(rolls, GRAVITY * column(self.offset) * np.sin(balls.rolled[:, :1]), 0.0)
        pull = np.zeros_like(balls.velocity[..., :2])
        pull[:, :1] = (size / np.where(rolls, speed, 1.0))[..., None] * np.stack([-v[..., 1], v[..., 0]], axis=-1)
        balls.push_rolling(pull)

    def horizon(self, balls: Balls) -> Array:
        """A part of a turn of the struck ball: (nsim,) [s]."""
        v = balls.velocity[:, 0]
        speed = np.hypot(v[:, 0], v[:, 1])
        return np.where(balls.rolling[:, 0], TURN * balls.ball.radius / np.maximum(speed, SLOW), np.inf)
