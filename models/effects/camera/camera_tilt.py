"""A camera that does not look straight down: what is nearer to it looks larger.

Reported position = (x, y) / (1 + along_x x + along_y y). Source: the pinhole's perspective, along = tan(tilt) / H for a
camera at height H; calibration takes out what it knows of. Leaves out the shift of the centre and the change of scale
with the tilt squared, which calibration takes along with the table's corners.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImageState, param


@dataclass(frozen=True)
class CameraTilt(Effect):
    """Gradient of the scale along both axes; positive shrinks what lies towards +x, +y."""

    along_x: float = param(
        0.002, off=0.0, unit="1/m", bounds=(-0.03, 0.03), source="tan(tilt) / H; 0.007 for 1 degree at 2.5 m"
    )
    along_y: float = param(0.002, off=0.0, unit="1/m", bounds=(-0.03, 0.03), source="as along_x")

    def observe(self, image: ImageState) -> None:
        """Every position over its depth."""
        depth = 1.0 + self.along_x * image.x + self.along_y * image.y
        image.x /= depth
        image.y /= depth
