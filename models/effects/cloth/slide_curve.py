"""Sidespin bends a sliding ball's path: friction with a part across the motion.

Lateral acceleration k omega_z v to the left of the motion: the cloth pushes with M k omega_z z x v at the lowest
point, and so turns the ball too, as sliding friction does. The pressure of a moving ball is highest ahead of the
contact, where a ball that turns moves sideways over the cloth. Source: an engineer's estimate, of first order in spin
and speed; a lead d of the pressure gives mu_s g d omega_z / u at a slip u: d = 0.5 mm is k = 0.001 at 1 m/s. Sign and
size are for the data to say. Once the ball rolls it is side_curve. Leaves out what a raised cue gives, which is in the
stroke's spin.
As it is friction, it is never more than the friction against the slip: the cloth only takes energy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import BallState, Effect, param


@dataclass(frozen=True)
class SlideCurve(Effect):
    """Lateral acceleration of a sliding ball in proportion to sidespin and speed."""

    rate: float = param(
        0.001, off=0.0, unit="1", bounds=(-0.01, 0.01), source="estimate: the pressure leads by 0.5 mm, slip 1 m/s"
    )

    def forces(self, ball: BallState) -> None:
        """The cloth's push across the motion, with its torque."""
        ball.across += self.rate * ball.wz * math.sqrt(ball.vx * ball.vx + ball.vy * ball.vy)
