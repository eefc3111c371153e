"""Where a live camera's pictures come from: a `sysid.vision.Device`, or what stands in for one."""

from __future__ import annotations

from typing import Protocol

from sysid.vision import Picture


class Source(Protocol):
    """Where pictures come from."""

    fps: float  # [1/s]; 0 or NaN where it is not known

    def read(self) -> tuple[float, Picture] | None:
        """When the next picture was taken [s], and the picture; None where there are no more."""

    def newest(self) -> tuple[float, Picture] | None:
        """The same for the present picture; buffered pictures are skipped."""

    def close(self) -> None:
        """Release it."""
