"""A struck ball that the cloth brakes otherwise than the others: it is polished, worn or chalked.

Sliding friction mu_s (1 + change), or rolling resistance mu_r (1 + change), of ball number 0. Source: an engineer's
estimate; the cue ball bears chalk and is played most, and balls of two polishes differ by some 10 % in friction. Clips
in which other balls move too distinguish it from the base's own. Leaves out the cloth's reaction during impacts, and
that chalk wears off during a shot.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import STRUCK_BALL, BallState, Effect, param


@dataclass(frozen=True)
class StruckBallSlide(Effect):
    """Sliding friction of the struck ball beside that of the others."""

    change: float = param(
        0.05, off=0.0, unit="1", bounds=(-0.7, 1.0), source="estimate: polish and chalk change it by up to 10 %"
    )

    def forces(self, ball: BallState) -> None:
        """The factor on the struck ball's sliding friction."""
        if ball.number == STRUCK_BALL:
            ball.slide_factor *= 1.0 + self.change


@dataclass(frozen=True)
class StruckBallRoll(Effect):
    """Rolling resistance of the struck ball beside that of the others."""

    change: float = param(
        0.05, off=0.0, unit="1", bounds=(-0.7, 1.0), source="estimate: weight and surface change it by some percent"
    )

    def forces(self, ball: BallState) -> None:
        """The factor on the struck ball's rolling resistance."""
        if ball.number == STRUCK_BALL:
            ball.roll_factor *= 1.0 + self.change
