"""Sources of a live camera's pictures.

In: a device's number, an address or a file, opened by OpenCV. Out: pictures with their times.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Protocol

import cv2

from models.errors import BadInput
from sysid.vision.frames import Picture, grabbed, quiet, retrieved


class Source(Protocol):
    """A source of stamped pictures."""

    fps: float  # [1/s]; 0 or NaN if unknown

    def read(self) -> tuple[float, Picture] | None:
        """The next picture and its time [s]; None if there are no more."""

    def newest(self) -> tuple[float, Picture] | None:
        """The current picture and its time [s]; buffered pictures are skipped."""

    def close(self) -> None:
        """Release it."""


class Device:
    """A source that OpenCV opens: a camera's number, an address, or a film file in its place."""

    def __init__(self, name: int | str, size: tuple[int, int] | None = None) -> None:
        """Open the source, and request pictures of a size (width, height)."""
        number = int(name) if str(name).isdecimal() else None
        self._live = number is not None or not Path(str(name)).is_file()
        with quiet():
            self._capture = cv2.VideoCapture(str(name) if number is None else number)
            opened = self._capture.isOpened()
        if not opened:
            raise BadInput(
                f"camera {name}: cannot be opened; check that it is plugged in, that its number, address or file is "
                "right, and that no other program holds it"
            )
        if self._live and size is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, size[0])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, size[1])
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        self.fps = float(self._capture.get(cv2.CAP_PROP_FPS))

    def read(self) -> tuple[float, Picture] | None:
        """The next picture; a live one is stamped on arrival."""
        if not grabbed(self._capture):
            return None
        stamp = time.monotonic() if self._live else float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        picture = retrieved(self._capture)
        return None if picture is None else (stamp, picture)

    def newest(self) -> tuple[float, Picture] | None:
        """Skip buffered pictures, which arrive at once."""
        for _ in range(10 if self._live and self.fps > 0 else 0):
            began = time.monotonic()
            if not grabbed(self._capture) or time.monotonic() - began > 0.3 / self.fps:
                break
        return self.read()

    def close(self) -> None:
        """Release the camera."""
        self._capture.release()
