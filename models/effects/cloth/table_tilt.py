"""A table that is not level: gravity pulls every ball downhill, g slope.

Force M g slope along x and y, through the centre: a sliding ball gets g slope, a rolling one 5/7 of it, as the cloth
turns it along; so does a flying one. A resting ball stays until the slope exceeds the rolling friction. Source: Newton;
fitters aim at 0.4 mm in a metre, players notice some 1.7 (AzBilliards). Leaves out that gravity presses a little less
on a slope.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import BallState, Effect, param
from models.shot import GRAVITY


@dataclass(frozen=True)
class TableTilt(Effect):
    """Slope of the table along its two axes; positive runs downhill towards +x, +y."""

    slope_x: float = param(
        0.0005, off=0.0, unit="rad", bounds=(-0.01, 0.01), source="0.4 mm/m is aimed at, 1.7 mm/m noticed (AzBilliards)"
    )
    slope_y: float = param(0.0005, off=0.0, unit="rad", bounds=(-0.01, 0.01), source="as slope_x")

    def forces(self, ball: BallState) -> None:
        """The pull downhill."""
        ball.ax += GRAVITY * self.slope_x
        ball.ay += GRAVITY * self.slope_y
