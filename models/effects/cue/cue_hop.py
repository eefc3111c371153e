"""The cue's downward stroke makes the struck ball hop: no cloth under it for a time in proportion to its speed.

A cue at 6.5 degrees presses the ball down, and the slate throws it up: at 2 m/s for some 25 ms, 0.8 mm high. Until it
lands at time k V0 after t = 0, V0 the speed it starts with, the cloth gives neither friction nor loss of sidespin.
Source: ballistic flight, 2 e V0 tan(elevation) / g, with the restitution e of slate and ball. The height of the balls
is held, so it leaves out the flight's height, what a flying ball passes over, and the bounces after the first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from models.effect import STRUCK_BALL, BallState, Effect, param

LANDING_TOLERANCE_S = 1e-12  # this near its landing a ball has landed [s]


@dataclass(frozen=True)
class CueHop(Effect):
    """Flight of the struck ball, which is ball number 0."""

    time_per_speed: float = param(
        0.01, off=0.0, unit="s^2/m", bounds=(0.0, 0.15), source="25 ms at 2 m/s, cue at 6.5 degrees (estimate)"
    )

    first: ClassVar[bool] = True

    def forces(self, ball: BallState) -> None:
        """No weight on the cloth while the struck ball flies."""
        if ball.number == STRUCK_BALL and self.time_per_speed * ball.launch - ball.time > LANDING_TOLERANCE_S:
            ball.weight = 0.0

    def horizon(self, ball: BallState) -> float:
        """Until the landing [s]."""
        left = self.time_per_speed * ball.launch - ball.time
        return left if ball.number == STRUCK_BALL and left > LANDING_TOLERANCE_S else math.inf
