"""A bed that gives way where a nose presses a ball down.

A nose stands above the ball's centre and pushes it into the cloth. The base's slate returns all of that push, and its
friction with it (Mathavan, Jackson, Parkin 2010); here it leaves a share of it unreturned while the impact lasts, and
the ball's vertical speed is forgotten after it. With a share of 1 the bed is not there, which is the law of Han 2005
(Int. J. Precision Engineering and Manufacturing 6, 75). Leaves out what the ball does while it hops; where more bodies
touch at once the bed is rigid.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class SoftBed(Effect):
    """Share of a nose's downward push that the bed does not return."""

    share: float = param(
        0.3, off=0.0, unit="1", bounds=(0.0, 1.0), source="0 is Mathavan 2010, 1 is Han 2005; between them an estimate"
    )

    def impact(self, hit: ImpactState) -> None:
        """The bed gives way under a ball at a cushion."""
        if hit.cushion:
            hit.sink += self.share
