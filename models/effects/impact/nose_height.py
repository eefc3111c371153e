"""Cushions whose noses stand lower, or higher, than 7/5 of a ball's radius above the slate.

A nose of height h meets the ball at the elevation theta, sin theta = h / R - 1, which is 2/5 in the base (Mathavan,
Jackson, Parkin 2010, snooker). A lower one presses less on the slate, turns less of a rolling ball's spin, and takes
more of a sidespin. Sources: pool 0.625 to 0.645 of the diameter, 1.25 to 1.29 R (WPA, equipment specifications);
carom 36 to 37 mm with balls of 61.5 mm, 1.17 to 1.20 R (UMB, equipment regulations). Leaves out that a lower nose also
meets the ball further out, at R cos theta: 2 mm for carom, which is a fitted size of the table; and that a ball climbs
a low nose.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from models.effect import RAIL_MX, RAIL_MY, RAIL_PX, RAIL_PY, Effect, ImpactState, param


@dataclass(frozen=True)
class NoseHeight(Effect):
    """Height of all noses beside 7/5 of the radius."""

    change: float = param(
        -0.13, off=0.0, unit="R", bounds=(-0.38, 0.3), source="WPA: pool 1.25 to 1.29 R; UMB: carom 1.17 to 1.20 R"
    )

    def impact(self, hit: ImpactState) -> None:
        """The elevation at which the nose meets the ball."""
        if hit.cushion:
            hit.nose += self.change


def height_change() -> Any:
    """The parameter of every rail."""
    return param(
        -0.06, off=0.0, unit="R", bounds=(-0.3, 0.3), source="estimate: a rail 1 to 2 mm lower than the others"
    )


@dataclass(frozen=True)
class NoseHeightPx(Effect):
    """Height of the nose at +x beside that of the others."""

    change: float = height_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PX:
            hit.nose += self.change


@dataclass(frozen=True)
class NoseHeightMx(Effect):
    """Height of the nose at -x beside that of the others."""

    change: float = height_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MX:
            hit.nose += self.change


@dataclass(frozen=True)
class NoseHeightPy(Effect):
    """Height of the nose at +y beside that of the others."""

    change: float = height_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_PY:
            hit.nose += self.change


@dataclass(frozen=True)
class NoseHeightMy(Effect):
    """Height of the nose at -y beside that of the others."""

    change: float = height_change()

    def impact(self, hit: ImpactState) -> None:
        """More at this rail."""
        if hit.cushion and hit.second == RAIL_MY:
            hit.nose += self.change
