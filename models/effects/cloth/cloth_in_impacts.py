"""Cloth with one law of sliding friction, within impacts as outside them.

A nose presses a ball onto the cloth, and a collision presses one of the two. The base meets them with its own sliding
friction, whatever another effect makes of it (a worn place, a chalked ball, a speed). Here what such effects change
acts within impacts as well, or a share of it does: at the place of the impact, and at the slip that the ball has when
it is pressed most. Source: one surface has one law of friction, so that 1 is expected; whether it holds at loads a
hundred times the ball's weight and within milliseconds nobody seems to have measured. Nothing changes without an effect
that changes sliding friction. Leaves out that a slip changes during an impact.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class ClothInImpacts(Effect):
    """Share of what changes the cloth's sliding friction that acts within impacts."""

    beside: ClassVar[tuple[str, ...]] = (
        "struck_ball_slide", "worn_patch", "slide_friction_speed", "spin_slide_coupling",
    )  # fmt: skip

    share: float = param(
        1.0, off=0.0, unit="1", bounds=(0.0, 1.5), source="1 is one law of friction at any load; 0 is the base"
    )

    def impact(self, hit: ImpactState) -> None:
        """The cloth under a ball that is pressed onto it."""
        hit.cloth_share += self.share
