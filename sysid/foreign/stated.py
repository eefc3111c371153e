"""What a user states about tracks of another program; the rest is inferred from them.

In: options of a command, or arguments. Out: the `Reading`s of coordinates that are consistent with them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import product

from models.messages import OptionError, option
from sysid.clips.consistency.readings import (
    METRES_BY_UNIT,
    Reading,
)


@dataclass(frozen=True)
class Stated:
    """Stated properties of the files; None if they are to be inferred from the tracks."""

    unit: str | None = None
    corner: bool | None = None
    exchanged: bool | None = None
    y_down: bool | None = None
    turned: bool | None = None
    time: str | None = None
    fps: float | None = None
    nominal_fps: float | None = None  # frame rate as stated, which stamps may contradict
    struck: str | None = None
    running: bool = False  # whether tracks that begin with a ball in motion show no strike
    columns: Mapping[str, str] = field(default_factory=dict)

    def for_pixels(self) -> bool | None:
        """Whether y points down in pictures; BadInput if something is stated that the camera's file determines."""
        apart = {"unit": self.unit, "origin": self.corner, "x_along": self.exchanged, "turned": self.turned}
        for stated in (name for name, value in apart.items() if value is not None):
            raise OptionError(option(stated), ": the camera's file determines this; omit one of the two")
        return self.y_down

    def readings(self, unit: str | None) -> list[Reading]:
        """The readings that are consistent with the statements and the unit in the columns' names."""
        units = [self.unit or unit] if self.unit or unit else list(METRES_BY_UNIT)
        corners = [False, True] if self.corner is None else [self.corner]
        exchanged = [False, True] if self.exchanged is None else [self.exchanged]
        return [
            Reading(one, corner, swap, bool(self.y_down), bool(self.turned))
            for one, corner, swap in product([u for u in units if u], corners, exchanged)
        ]
