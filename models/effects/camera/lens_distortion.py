"""A lens that draws points towards the middle of the picture, the more the farther out: barrel distortion.

Reported position = x (1 - barrel r^2), r the distance from the table's centre. Source: the first radial term of Brown
(1966), r_d = r (1 + k1 r^2), k1 = -barrel. A straight roll bows, and a ball seems to slow down on its way outwards.
Leaves out higher and tangential terms, and a lens that is not above the table's centre. Beyond 0.037 /m^2 the corners
of a full-size table would be folded back.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImageState, param


@dataclass(frozen=True)
class LensDistortion(Effect):
    """Barrel distortion, positive; pincushion, negative."""

    barrel: float = param(
        0.003, off=0.0, unit="1/m^2", bounds=(-0.03, 0.03), source="estimate: 0.5 to 2 % at the corner, 1.99 m out"
    )

    def observe(self, image: ImageState) -> None:
        """Every position moved along its radius."""
        inward = 1.0 - self.barrel * (image.x * image.x + image.y * image.y)
        image.x *= inward
        image.y *= inward
