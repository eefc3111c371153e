"""A sequence of pictures in files: their times are in a file beside them, in the numbers of their names, or even.

In: the files in order. Out: times and pictures.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from models.messages import OptionError, option
from sysid.vision.sources.frame_times import FrameTimes, retimed
from sysid.vision.sources.pictures import Picture, read_picture
from sysid.vision.sources.times import read_times

TIME_FILES = ("times.csv", "timestamps.txt")  # looked for beside the pictures


class Pictures:
    """A sequence of pictures, with or without a file of times beside them."""

    def __init__(self, name: str, paths: Sequence[Path]) -> None:
        """`name` is what the user gave."""
        self.name, self.paths, self.files, self.count = name, list(paths), list(paths), len(paths)
        self._read_times = np.arange(len(paths), dtype=float)

    def frame_times(self, fps: float | None) -> FrameTimes:
        """Times from the file beside the pictures, from the numbers in their names, or at an even rate."""
        time_file = next((p for n in TIME_FILES if (p := self.paths[0].parent / n).is_file()), None)
        if time_file is not None:
            self._read_times = read_times(time_file, len(self.paths))
            if len(self._read_times) > 1:
                period = float(np.median(np.diff(self._read_times)))
                return retimed(
                    FrameTimes(period, False, 1.0, (f"frame times from {time_file.name}, {1 / period:.6g}/s",)), fps
                )
        if fps is None and len(self.paths) > 1:
            text = f"{self.name}: pictures have no times; put times.csv beside them, or give their frame rate with "
            raise OptionError(text, option("fps"))
        numbers = [int(found[-1]) if (found := re.findall(r"\d+", p.stem)) else -1 for p in self.paths]
        steps = np.diff(numbers)
        notes = f"pictures taken at an even {fps or 1.0:.6g}/s"
        if len(steps) and (steps > 0).all():
            step = float(np.median(steps))
            if (steps % step == 0).all():
                self._read_times = (np.array(numbers) - numbers[0]) / step
                notes += ", numbers missing from their names counted as frames missing" if (steps > step).any() else ""
        return FrameTimes(1.0, True, 1.0 / (fps or 1.0), (notes,))

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Times and pictures; None for those not wanted or unreadable."""
        for index in jumps if jumps is not None else range(len(self.paths) if most is None else most):
            picture = None
            if wanted is None or index in wanted:
                picture = read_picture(self.paths[index])
            yield float(self._read_times[index]), picture
