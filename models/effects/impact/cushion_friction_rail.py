"""One rail that rubs less, or more, than the others: a strip of cloth that is new, worn or stretched otherwise.

Friction mu + change at that rail, mu at the other three; never below 0, nor above 0.43, where the ball would climb the
nose. Source: an engineer's estimate; Mathavan 2010 has 0.14 on one table, and a new strip may differ by a third. All
four rails together would be the base's own friction: what clips name is the fewest rails that differ. Leaves out the
jaws of the pockets, and any change along the rail.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from models.effect import RAIL_MX, RAIL_MY, RAIL_PX, RAIL_PY, Effect, ImpactState, param


def friction_change() -> Any:
    """The parameter of every rail."""
    return param(0.04, off=0.0, unit="1", bounds=(-0.4, 0.4), source="estimate: a third of the 0.14 of Mathavan 2010")


@dataclass(frozen=True)
class CushionFrictionPx(Effect):
    """Friction of the rail at +x beside that of the others."""

    change: float = friction_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PX:
            hit.friction += self.change


@dataclass(frozen=True)
class CushionFrictionMx(Effect):
    """Friction of the rail at -x beside that of the others."""

    change: float = friction_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MX:
            hit.friction += self.change


@dataclass(frozen=True)
class CushionFrictionPy(Effect):
    """Friction of the rail at +y beside that of the others."""

    change: float = friction_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PY:
            hit.friction += self.change


@dataclass(frozen=True)
class CushionFrictionMy(Effect):
    """Friction of the rail at -y beside that of the others."""

    change: float = friction_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MY:
            hit.friction += self.change
