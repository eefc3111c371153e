"""One rail that gives back less, or more, than the others: a dead cushion.

Energetic restitution e + change at that rail, e at the other three; held within 0 and 1. Source: an engineer's
estimate; rubber of another age, or a loose bolt, takes 0.02 to 0.1. All four rails together would be the base's own
restitution, and any three of them the opposite of the fourth: what clips name is the fewest rails that differ. Leaves
out the jaws of the pockets, and any change along the rail.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from models.effect import RAIL_MX, RAIL_MY, RAIL_PX, RAIL_PY, Effect, ImpactState, param


def restitution_change() -> Any:
    """The parameter of every rail."""
    return param(-0.05, off=0.0, unit="1", bounds=(-0.5, 0.5), source="estimate: 0.02 to 0.1 less at a dead cushion")


@dataclass(frozen=True)
class CushionRestitutionPx(Effect):
    """Restitution of the rail at +x beside that of the others."""

    change: float = restitution_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PX:
            hit.restitution += self.change


@dataclass(frozen=True)
class CushionRestitutionMx(Effect):
    """Restitution of the rail at -x beside that of the others."""

    change: float = restitution_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MX:
            hit.restitution += self.change


@dataclass(frozen=True)
class CushionRestitutionPy(Effect):
    """Restitution of the rail at +y beside that of the others."""

    change: float = restitution_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PY:
            hit.restitution += self.change


@dataclass(frozen=True)
class CushionRestitutionMy(Effect):
    """Restitution of the rail at -y beside that of the others."""

    change: float = restitution_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MY:
            hit.restitution += self.change
