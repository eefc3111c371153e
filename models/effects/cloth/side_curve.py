"""Sidespin bends a rolling ball's path: lateral acceleration c omega_z.

The centre of pressure lies ahead of the contact by some tenths of a millimetre, so a ball turning about the vertical
rolls off to the side its front turns to: positive omega_z (right side, counter-clockwise) drifts to the left of the
motion for positive c. Torque goes along, so that it keeps rolling. Source: derived from the offset of the rolling
resistance, of order (7/5) mu_r R; sign and size are for the data to say.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import BallState, Effect, param, push_along


@dataclass(frozen=True)
class SideCurve(Effect):
    """Lateral acceleration in proportion to sidespin."""

    rate: float = param(
        0.001, off=0.0, unit="m/rad/s", bounds=(-0.01, 0.01), source="estimate: 2/7 of 0.5 mm times alpha / omega_z"
    )

    def forces(self, ball: BallState) -> None:
        """Push to the left of the motion, and the torque that keeps the ball rolling."""
        if ball.rolling:
            push_along(ball, 0.0, self.rate * ball.wz)
