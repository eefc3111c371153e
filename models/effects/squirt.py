"""Squirt: a ball struck off centre leaves to the side away from the tip.

Direction = aim + per_offset b, b the side offset commanded, positive to the right as the player sees it: the right side
sends the ball to the left. b = 2 R^2 omega_S / (5 v), where an elevated cue has tilted omega_S = (omega_z, omega_aim).
The spin's horizontal part turns along. Source: Alciatore TP A.31, Cross 2008: tan = 5/2 (b / R) / (1 + M/m_e + 5/2),
with no dependence on speed. In a fit the own unknowns of a shot are then what was commanded, and only clips with a cue
tell of it. Leaves out the spin that squirt costs, the curvature at large offsets, and strikes beyond the miscue limit,
which count as at the limit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.effect import STILL, Array, Effect, param
from models.shot import Ball

MISCUE = 0.5  # largest offset over radius (Robotic Billiards 2015)
LEVEL = 0.03  # offset over radius below which spin about the aim says nothing of the cue's elevation


@dataclass(frozen=True)
class Squirt(Effect):
    """Angle between the aim and the ball's direction, per side offset."""

    per_offset: float = param(
        3.0, off=0.0, unit="rad/m", bounds=(-20.0, 20.0), source="Alciatore TP A.31: 2.5 / (R (3.5 + M/m_e)), 12 to 50"
    )

    def strike(self, ball: Ball, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """Velocity and horizontal spin, turned."""
        speed = np.hypot(velocity[:, 0], velocity[:, 1])
        moving = speed > STILL
        lever = 0.4 * ball.radius**2 / np.where(moving, speed, 1.0)
        up, aim = lever * spin[:, 2], lever * np.sum(spin[:, :2] * velocity, axis=-1) / np.where(moving, speed, 1.0)
        offset = up * np.sqrt(1 + aim**2 / (up**2 + (LEVEL * ball.radius) ** 2))
        limit = MISCUE * ball.radius
        angle = np.where(moving, self.per_offset * np.clip(offset, -limit, limit), 0.0)
        c, s = np.cos(angle), np.sin(angle)

        def turned(a: Array) -> Array:
            return np.stack([c * a[:, 0] - s * a[:, 1], s * a[:, 0] + c * a[:, 1]], axis=-1)

        return turned(velocity), np.concatenate([turned(spin), spin[:, 2:]], axis=-1)
