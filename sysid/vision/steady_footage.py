"""Footage whose frames are laid where they would be if the camera stood still."""

from __future__ import annotations

from collections.abc import Iterator

from sysid.vision.camera.camera_motion import SteadyView
from sysid.vision.frames import Footage, Frame


class SteadyFootage(Footage):
    """The frames of other footage, steadied."""

    def __init__(self, footage: Footage, view: SteadyView) -> None:
        """Of footage that is open."""
        self.__dict__.update(vars(footage))
        self._view = view

    def frames(self, wanted: set[int] | None) -> Iterator[Frame]:
        """As of the other footage, steadied."""
        return map(self._view.steady, super().frames(wanted))

    def _jump(self, n: int, count: int) -> list[Frame]:
        return [self._view.steady(frame) for frame in super()._jump(n, count)]
