"""A picture that is too long and too narrow, or too short and too wide.

Reported position = ((1 + aspect) x, (1 - aspect) y). Source: geometry; pixels that are not square, or a table whose
length and width were measured with opposite errors: a tape errs by some millimetres, 0.003 of a width. `image_scale` is
the error that both directions share. Leaves out any change over the picture.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImageState, param


@dataclass(frozen=True)
class ImageAspect(Effect):
    """Excess of reported lengths along the table, and as much lack of those across it."""

    aspect: float = param(
        0.003, off=0.0, unit="1", bounds=(-0.1, 0.1), source="errors of a tape over a table's width: 0.003"
    )

    def observe(self, image: ImageState) -> None:
        """Longer along x, shorter along y."""
        image.x *= 1.0 + self.aspect
        image.y *= 1.0 - self.aspect
