"""A cushion that gives back less the harder it is hit.

Energetic restitution e - rate (v_n - 1 m/s), v_n the approach speed straight at the rail; held within 0 and 1. Source:
rebounds of a rolling ball, Mathavan 2009 and 2010: constant up to some 2 m/s, then 0.10 per m/s. Leaves out the knee
between the two.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import REFERENCE_SPEED, Effect, ImpactState, param


@dataclass(frozen=True)
class CushionRestitutionSpeed(Effect):
    """Fall of the restitution with speed."""

    rate: float = param(
        0.05, off=0.0, unit="s/m", bounds=(-0.3, 0.3), source="Mathavan 2009, 2010: 0 below, 0.10 above 2.1 m/s"
    )

    def impact(self, hit: ImpactState) -> None:
        """Less for what comes faster."""
        if hit.cushion:
            hit.restitution -= self.rate * (hit.approach - REFERENCE_SPEED)
