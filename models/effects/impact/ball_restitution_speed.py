"""Balls that give back less the harder they meet.

Energetic restitution e - rate (v_n - 1 m/s), v_n the approach speed along the line of centres; held within 0 and 1.
Source: the restitution of hard spheres falls slowly with speed; a law of the first order. Leaves out the curvature of
that fall (Hertz contacts with losses: 1 - e grows as v^(1/5)).
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import REFERENCE_SPEED, Effect, ImpactState, param


@dataclass(frozen=True)
class BallRestitutionSpeed(Effect):
    """Fall of the restitution with speed."""

    rate: float = param(
        0.02,
        off=0.0,
        unit="s/m",
        bounds=(-0.2, 0.2),
        source="none measured; pool 0.92 to 0.98 (Alciatore)",
    )

    def impact(self, hit: ImpactState) -> None:
        """Less for what comes faster."""
        if not hit.cushion:
            hit.restitution -= self.rate * (hit.approach - REFERENCE_SPEED)
