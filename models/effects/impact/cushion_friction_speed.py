"""A cushion that rubs less the harder it is hit.

Friction mu - rate (v_n - 1 m/s), v_n the approach speed straight at the rail; never below 0, nor above 0.43, where the
ball would climb the nose. Source: a law of the first order about the figure of Mathavan 2010, which was measured at one
friction for all speeds. Leaves out that the friction may follow the slip along the nose instead.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import REFERENCE_SPEED, Effect, ImpactState, param


@dataclass(frozen=True)
class CushionFrictionSpeed(Effect):
    """Fall of the friction with speed."""

    rate: float = param(
        0.02, off=0.0, unit="s/m", bounds=(-0.2, 0.2), source="none measured; Mathavan 2010 has 0.14 at all speeds"
    )

    def impact(self, hit: ImpactState) -> None:
        """Less for what comes faster."""
        if hit.cushion:
            hit.friction -= self.rate * (hit.approach - REFERENCE_SPEED)
