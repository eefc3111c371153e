"""A picture that is too large or too small all over.

Reported position = (1 + stretch) x. Source: geometry; a camera calibrated on the cloth at height H sees balls, whose
centres lie R higher, by R / (H - R) too far out: 0.0088 to 0.0133 for H = 3 to 2 m. Lengths, speeds and decelerations
all grow alike, so that cushions and the balls' size separate it from friction. Leaves out any change over the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImageState, param


@dataclass(frozen=True)
class ImageScale(Effect):
    """Excess of reported lengths over true ones."""

    stretch: float = param(
        0.005, off=0.0, unit="1", bounds=(-0.1, 0.1), source="parallax of the ball's height, R / (H - R): up to 0.013"
    )

    def observe(self, image: ImageState) -> None:
        """Every position, larger."""
        image.x *= 1.0 + self.stretch
        image.y *= 1.0 + self.stretch
