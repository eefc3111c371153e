"""A sensor that reads its rows one after another, along the table's width.

A ball at y is caught `delay` y later than the stamp says: reported position = x(t + delay y), to first order
x + v delay y. Source: kinematics; a readout of 5 ms over 1.52 m is 0.0033 s/m. Speeds along the rows' scan look larger
or smaller by v delay, with the sense of the motion. Leaves out the acceleration within the delay (0.01 mm), what an
impact within it changes, and the mark's angle.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, ImageState, param


@dataclass(frozen=True)
class RollingShutter(Effect):
    """Delay of the readout per way along y; positive where rows towards +y are read later."""

    delay: float = param(
        0.003, off=0.0, unit="s/m", bounds=(-0.02, 0.02), source="estimate: a readout of 5 ms over 1.52 m"
    )

    def observe(self, image: ImageState) -> None:
        """Every ball, moved on by its delay."""
        late = self.delay * image.y
        image.x += late * image.vx
        image.y += late * image.vy
