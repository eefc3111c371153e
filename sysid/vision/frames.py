"""Footage: from a video or a folder of pictures to frames, which are pictures and the times they were taken at.

In: a video, or pictures (sysid/vision/sources), which give stamps and pictures. Out: `Footage`, an iteration of
`Frame`s. Missing frames leave a gap in time.
"""

from __future__ import annotations

import glob
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from models.errors import BadInput
from models.messages import OptionError, counted, option
from sysid.vision.sources.picture_files import Pictures
from sysid.vision.sources.pictures import Picture
from sysid.vision.sources.video import Video

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
SEEK_FRAMES = 1500  # longer videos are sampled by seeking, shorter ones by reading them through


@dataclass(frozen=True)
class Frame:
    """One picture (height, width, 3), blue, green, red, and when it was taken [s], from the first."""

    index: int
    time: float
    picture: Picture
    elsewhere: bool = False  # whether it shows another view than the film's camera has of the table, after a cut


class Footage:
    """Frames in order, read anew on every iteration; only one is in memory at a time."""

    def __init__(self, source: Video | Pictures, fps: float | None) -> None:
        """Read the first frames; `fps` is the rate at which they were taken, if the container cannot know it [1/s]."""
        self._source, self.name = source, source.name
        self.files = source.files  # that hold the frames, in order
        self._frame_times = source.frame_times(fps)
        self._broken = self._missing = 0
        self._whole = False
        self.count = source.count
        first = next((picture for _, picture in source.read() if picture is not None), None)
        if first is None:
            raise BadInput(f"{source.name}: holds no readable picture; record it again or convert it")
        self.size: tuple[int, int] = (first.shape[1], first.shape[0])

    @property
    def fps(self) -> float:
        """Rate at which the frames were taken [1/s]; the median of a variable one."""
        return 1.0 / (self._frame_times.period * self._frame_times.time_scale)

    @property
    def assumed(self) -> tuple[str, ...]:
        """What was assumed, for the user; missing frames are counted in what has been read so far."""
        so_far = "" if self._whole else " so far"
        lines = [*self._frame_times.notes]
        if self._missing:
            lines.append(f"{counted(self._missing, 'frame')} missing{so_far}: left as gaps in time")
        if self._broken:
            lines.append(f"{counted(self._broken, 'frame')} unreadable{so_far}: left out")
        return tuple(lines)

    def __iter__(self) -> Iterator[Frame]:
        """All frames that can be read."""
        return self.frames(None)

    def sample(self, n: int) -> list[Frame]:
        """Up to n frames, evenly spread over the footage."""
        if n < 1:
            return []
        count = self.count
        if isinstance(self._source, Video) and (count is None or count > SEEK_FRAMES):
            if count is not None and len(found := self._jump(n, count)) > n / 2:
                return found
            total = sum(1 for _ in self.frames(set()))
            self.count = count = total
        wanted = set(np.linspace(0, max((count or 1) - 1, 0), n).round().astype(int).tolist())
        found = list(self.frames(wanted))
        if self._whole and self.count is not None and self.count < (count or 0):  # the container announced more
            return self.sample(n) if len(found) < min(n, self.count) else found
        return found

    def _jump(self, n: int, count: int) -> list[Frame]:
        frames: dict[float, Frame] = {}
        first = math.nan
        for stamp, picture in self._source.read(np.linspace(0, count - 1, n).round().astype(int).tolist()):
            first = stamp if math.isnan(first) else first
            if picture is not None and (picture.shape[1], picture.shape[0]) == self.size:
                index = round((stamp - first) / self._frame_times.period)
                time = index * self._frame_times.period if self._frame_times.even else stamp - first
                frames[stamp] = Frame(index, time * self._frame_times.time_scale, picture)
        return [frames[stamp] for stamp in sorted(frames)]

    def frames(self, wanted: set[int] | None) -> Iterator[Frame]:
        """Read through and yield the frames with these indices, or all; the others are not decoded."""
        frame_times, steps, before = self._frame_times, 0, math.nan
        missing = broken = read = 0
        first = math.nan
        for index, (stamp, picture) in enumerate(self._source.read(wanted=wanted)):
            read = index + 1
            if not math.isnan(before):
                step = frame_times.steps(before, stamp)
                steps, missing = steps + step, missing + step - 1
            else:
                first = stamp
            before = stamp
            if picture is not None and (picture.shape[1], picture.shape[0]) != self.size:
                picture = None
            unread = picture is None and (wanted is None or index in wanted)
            broken += unread
            self._missing, self._broken = max(self._missing, missing), max(self._broken, broken)
            if picture is not None:
                time = steps * frame_times.period if frame_times.even else stamp - first
                yield Frame(index, time * frame_times.time_scale, picture)
        self._whole, self.count = True, read


def open_footage(path: Path | str, fps: float | None = None) -> Footage:
    """Footage of a video, a picture, a folder of pictures, or a pattern of their names (`%04d` or `*`).

    Args:
        path: video, picture, folder or pattern.
        fps: rate at which the frames were taken, where the container does not know it or was re-timed [1/s].

    Raises:
        BadInput: nothing there can be read.
    """
    name = str(path)
    if fps is not None and not 0 < fps < math.inf:
        raise OptionError(option("fps"), f" is {fps:g}: give the number of frames taken in a second, above 0")
    location = Path(path)
    if location.is_dir():
        found = [p for p in location.iterdir() if p.suffix.lower() in PICTURE_SUFFIXES and not p.name.startswith(".")]
        if not found:
            kinds = ", ".join(suffix[1:] for suffix in PICTURE_SUFFIXES)
            raise BadInput(f"{name}: holds no pictures ({kinds}); name a video or such a folder")
    elif location.is_file():
        if location.stat().st_size == 0:
            raise BadInput(f"{name}: is empty; record or copy it again")
        if location.suffix.lower() not in PICTURE_SUFFIXES:
            return Footage(Video(location), fps)
        found = [location]
    elif re.search(r"%0?\d*d", location.name):
        pattern = re.compile(re.sub(r"%0?\d*d", r"\\d+", re.escape(location.name)))
        found = [p for p in location.parent.iterdir() if pattern.fullmatch(p.name)] if location.parent.is_dir() else []
    else:
        found = [Path(p) for p in glob.glob(name)] if glob.has_magic(name) else []
    if not found:
        raise BadInput(f"{name}: does not exist; name a video, a folder of pictures or a pattern of their names")
    return Footage(Pictures(name, sorted(found, key=_natural)), fps)


def _natural(path: Path) -> list[tuple[int, str]]:
    """Sort key with which 2 comes before 10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path.name)]
