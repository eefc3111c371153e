"""What OpenCV films with and records to: a camera's pictures with their times, and a film without loss.

In: a device's number, an address or a file. Out: stamped pictures. What is recorded comes back as `Footage` of frames
whose times are known.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.frames import Footage
from sysid.vision.sources.frame_times import FrameTimes
from sysid.vision.sources.pictures import Picture, grabbed, quiet, retrieved
from sysid.vision.sources.video import Video


class Device:
    """What OpenCV films with: a number of a camera, an address, or a file that stands in for one."""

    def __init__(self, name: int | str, size: tuple[int, int] | None = None) -> None:
        """Open it, and ask a camera for pictures of a size (width, height)."""
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
        """The next picture; a live one is stamped as it comes."""
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


def lossless_writer(path: Path, fps: float, size: tuple[int, int]) -> cv2.VideoWriter:
    """A film to write pictures of a size (width, height) to; BadInput where none can be written."""
    with quiet():
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, size)
    if not writer.isOpened():
        raise BadInput(f"{path}: cannot be written; name a writable folder")
    return writer


def stamped_footage(path: Path, numbers: NDArray[np.int64], period: float) -> Footage:
    """A film whose pictures are those of a camera's frames with these numbers (n,), a period [s] apart."""
    return Footage(_Stamped(path, numbers, period), None)


class _Stamped(Video):
    """A video whose frames were taken at uneven times."""

    def __init__(self, path: Path, numbers: NDArray[np.int64], period: float) -> None:
        """`numbers` (n,): the camera's frame number of each picture; `period` of the frames [s]."""
        super().__init__(path)
        self._numbers, self._period = numbers, period

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Stamps [s] and pictures."""
        for stamp, picture in super().read(jumps, wanted, most):
            k = min(round(stamp * self.rate), len(self._numbers) - 1)
            yield float(self._numbers[k]) * self._period, picture

    def frame_times(self, fps: float | None) -> FrameTimes:
        """The camera's own."""
        return FrameTimes(self._period, True, 1.0, (f"frame times from the camera's stamps, {1 / self._period:.6g}/s",))
