"""Cloth that resists rolling more along one line than across it: the weave, or a nap brushed one way.

Rolling resistance mu_r (1 + along cos 2 phi + diagonal sin 2 phi), phi the heading from +x: the same there and back.
With amplitude a and the line of most resistance at phi0 they are a cos 2 phi0 and a sin 2 phi0. Never less than 0.05 of
mu_r. Source: an engineer's estimate; the lowest term that is the same in both senses, beside cloth_nap, which is not.
Leaves out that sliding friction may follow the weave too.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import MIN_FRICTION_SHARE, STILL, BallState, Effect, param


@dataclass(frozen=True)
class ClothGrain(Effect):
    """Share of the rolling resistance that turns with twice the heading."""

    along: float = param(
        0.05, off=0.0, unit="1", bounds=(-0.9, 0.9), source="estimate: some percent more along the weave than across"
    )
    diagonal: float = param(0.02, off=0.0, unit="1", bounds=(-0.9, 0.9), source="as along, at 45 degrees")

    def forces(self, ball: BallState) -> None:
        """The factor on the rolling resistance."""
        squared = ball.vx * ball.vx + ball.vy * ball.vy
        if squared > STILL * STILL:
            cosine, sine = (ball.vx * ball.vx - ball.vy * ball.vy) / squared, 2.0 * ball.vx * ball.vy / squared
            ball.roll_factor *= max(1.0 + self.along * cosine + self.diagonal * sine, MIN_FRICTION_SHARE)
