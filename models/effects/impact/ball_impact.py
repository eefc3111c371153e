"""Ball on ball: Coulomb friction and energetic restitution, with the cloth's reaction.

Two balls that meet alone take the impulse of models/analytic/impulse.py; where more bodies touch at once, the springs
of models/analytic/spring.py hold these coefficients. Source: Mathavan, Jackson, Parkin 2014. Leaves out any dependence
on speed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class BallImpact(Effect):
    """Restitution and friction between two balls."""

    restitution: float = param(
        0.92, off=0.0, unit="1", bounds=(0.5, 1.0), source="Mathavan 2014: 0.89; pool 0.92 to 0.98 (Alciatore)",
        published=(0.89, 0.98), published_by="Mathavan 2014: 0.89; Alciatore, pool: 0.92 to 0.98",
    )  # fmt: skip
    friction: float = param(
        0.05, off=0.0, unit="1", bounds=(0.0, 0.5), source="Mathavan 2014",
        published=(0.03, 0.08), published_by="Alciatore, pool: 0.03 to 0.08",
    )  # fmt: skip

    plain: ClassVar[bool] = True
    slot: ClassVar[str] = "ball_impact"
    resolves: ClassVar[str] = "ball"

    def impact(self, hit: ImpactState) -> None:
        """Constant coefficients."""
        if not hit.cushion:
            hit.restitution += self.restitution
            hit.friction += self.friction
