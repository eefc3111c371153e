"""Ball on cushion: Coulomb friction at nose and cloth, energetic restitution at the nose.

The nose meets the ball above its centre (sin theta = 2/5); cushion and slate are rigid. A ball that meets it alone
takes the impulse of models/analytic/impulse.py; where more touch at once, the springs of models/analytic/spring.py
hold these coefficients. Source: Mathavan, Jackson, Parkin 2010.
Leaves out any dependence on speed, and that a real cushion gives way.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from models.effect import Effect, ImpactState, param


@dataclass(frozen=True)
class CushionImpact(Effect):
    """Restitution and friction of the cushion."""

    restitution: float = param(
        0.9, off=0.0, unit="1", bounds=(0.3, 1.0), source="Mathavan 2010: 0.98 below 1.5 m/s; carom and pool less",
        published=(0.6, 0.98), published_by="Alciatore, pool: 0.6 to 0.9; Mathavan 2010, snooker: 0.98",
    )  # fmt: skip
    friction: float = param(
        0.14, off=0.0, unit="1", bounds=(0.0, 0.43), source="Mathavan 2010",
        published=(0.092, 0.471), published_by="Han 2005, carom: 0.471 less 0.241 a radian from the normal",
    )  # fmt: skip

    plain: ClassVar[bool] = True
    slot: ClassVar[str] = "cushion_impact"
    resolves: ClassVar[str] = "cushion"

    def impact(self, hit: ImpactState) -> None:
        """Constant coefficients."""
        if hit.cushion:
            hit.restitution += self.restitution
            hit.friction += self.friction
