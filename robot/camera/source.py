"""Where a live camera's pictures come from: a `sysid.vision.Device`, or what stands in for one."""

from __future__ import annotations

from typing import Protocol

from sysid.vision import Picture


class Source(Protocol):
    """A source of stamped pictures."""

    fps: float  # [1/s]; 0 or NaN if unknown

    def read(self) -> tuple[float, Picture] | None:
        """The next picture and its time [s]; None if there are no more."""

    def newest(self) -> tuple[float, Picture] | None:
        """The current picture and its time [s]; buffered pictures are skipped."""

    def close(self) -> None:
        """Release it."""
