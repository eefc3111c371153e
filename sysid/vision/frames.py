"""Footage: from a video or a folder of pictures to frames, which are pictures and the times they were taken at.

Times come from the container's time stamps. Stamps that keep to the container's rate, up to the rounding of some
formats to a millisecond, are put on that rate exactly; others are used as they are. Missing frames leave a gap in time.
"""

from __future__ import annotations

import contextlib
import glob
import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files.limits import MAX_FRAMES, MAX_PICTURE_PIXELS
from models.messages import OptionError, counted, option
from sysid.vision.times import read_times

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # it is read once, when a video is first opened or written

Picture = NDArray[np.uint8]

PICTURE_SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm")
TIME_FILES = ("times.csv", "timestamps.txt")  # looked for beside the pictures
PROBED_FRAMES = 60  # first frames of a container, from which its frame rate is judged
STAMP_ROUNDING_S = 0.6e-3  # some containers round stamps to a millisecond: half of that and a little more
MAX_JITTER_PERIODS = 0.05  # stamps farther off the even rate than this make it a variable rate
RATE_TOLERANCE = 0.003  # relative difference from the rate given by the user that needs no note
GAP_PERIODS = 1.75  # time between two frames from which on frames are missing
SEEK_FRAMES = 1500  # longer videos are sampled by seeking, shorter ones by reading them through
PNG_BEGINS = b"\x89PNG\r\n\x1a\n"
STDERR_DESCRIPTOR = 2  # its descriptor


@dataclass(frozen=True)
class Frame:
    """One picture (height, width, 3), blue, green, red, and when it was taken [s], from the first."""

    index: int
    time: float
    picture: Picture
    elsewhere: bool = False  # whether it shows another view than the film's camera has of the table, after a cut


@dataclass(frozen=True)
class FrameTimes:
    """How time stamps become times: put on an even rate or used as they are, then scaled."""

    period: float  # between frames, by the stamps [s]
    even: bool  # whether frames keep to that period
    time_scale: float  # seconds of the scene per second of the stamps
    notes: tuple[str, ...]  # for the user

    def steps(self, before: float, now: float) -> int:
        """Periods between two stamps [s], at least one."""
        periods = (now - before) / self.period
        return max(1, round(periods)) if self.even or periods >= GAP_PERIODS else 1


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


class Video:
    """A file that OpenCV reads."""

    def __init__(self, path: Path) -> None:
        """Open it once to check that it can be read."""
        self.path, self.name, self.files = path, str(path), [path]
        with quiet():
            capture = cv2.VideoCapture(self.name)
            self.rate = float(capture.get(cv2.CAP_PROP_FPS)) if capture.isOpened() else 0.0
            counted = float(capture.get(cv2.CAP_PROP_FRAME_COUNT)) if capture.isOpened() else 0.0
            opened = capture.isOpened()
            width, height = (float(capture.get(k)) for k in (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT))
            capture.release()
        check_size(path, width, height)
        if not opened:
            raise BadInput(f"{self.name}: is not a readable video; convert it to MP4 (H.264) or to pictures")
        self.count = int(counted) if 0 < counted <= MAX_FRAMES else None

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Stamps [s] and pictures of all frames, or of those to seek to; those not `wanted` are not decoded."""
        with quiet():
            capture = cv2.VideoCapture(self.name)
        try:
            for index in jumps if jumps is not None else range(most if most is not None else MAX_FRAMES):
                if jumps is not None:
                    capture.set(cv2.CAP_PROP_POS_FRAMES, index)
                if not grabbed(capture):
                    if jumps is None:
                        return
                    continue
                stamp = float(capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
                picture = None
                if wanted is None or index in wanted:
                    found = retrieved(capture)
                    picture = None if found is None else _as_colour(found)
                yield stamp, picture
            if jumps is None and most is None:
                raise BadInput(f"{self.name}: has more than {MAX_FRAMES} frames: cut it into several")
        finally:
            capture.release()

    def frame_times(self, fps: float | None) -> FrameTimes:
        """Its frame times, judged by the first frames."""
        stamps = np.array([stamp for stamp, _ in self.read(wanted=set(), most=PROBED_FRAMES)])
        rate = self.rate if 0.1 < self.rate < 1e6 else math.nan
        steps = np.diff(stamps)
        if len(steps) == 0 or not (steps > 0).all():
            if len(steps) and not (math.isfinite(rate) or fps):
                raise OptionError(
                    f"{self.name}: has neither frame times nor a frame rate; give one with ", option("fps")
                )
            # Every frame is then assumed to follow the one before: `steps` counts at least one.
            period = 1.0 / (rate if math.isfinite(rate) else fps or 1.0)
            return _retimed(FrameTimes(period, True, 1.0, (f"frame times from the rate {1 / period:.6g}/s",)), fps)
        if math.isfinite(rate):
            # Stamps may be rounded to a millisecond: the nominal rate of the container is tried first.
            period, elapsed = 1.0 / rate, stamps - stamps[0]
            residual = elapsed - period * np.round(elapsed / period)
            step_periods = np.median(steps) / period  # some containers give the finest rate that they can hold
            if (
                np.abs(residual).max() < max(STAMP_ROUNDING_S, MAX_JITTER_PERIODS * period)
                and 0.5 < step_periods < GAP_PERIODS
            ):
                return _retimed(FrameTimes(period, True, 1.0, (f"frame times from the container, {rate:.6g}/s",)), fps)
        notes = f"frame times from the container, a variable rate of about {1 / np.median(steps):.4g}/s"
        return _retimed(FrameTimes(float(np.median(steps)), False, 1.0, (notes,)), fps)


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
                return _retimed(
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


def check_size(name: Path | str, width: float, height: float) -> None:
    """BadInput for a film whose pictures have too many pixels."""
    if width * height > MAX_PICTURE_PIXELS:
        most = MAX_PICTURE_PIXELS >> 20
        raise BadInput(f"{name}: has {width:.0f} x {height:.0f} pixels; convert it to {most} million at most")


def read_picture(path: Path) -> Picture | None:
    """A picture of a file; None where there is none that can be read, or one of too many pixels."""
    if not path.is_file():
        return None
    with quiet():
        try:
            if _claims_more_than_it_has(path):
                return None
            picture = _as_colour(cv2.imread(str(path), cv2.IMREAD_COLOR))
        except (OSError, cv2.error):
            return None
    # OpenCV refuses these before it decodes them, unless it was imported before a command had set that limit.
    if picture is not None and picture.shape[0] * picture.shape[1] > MAX_PICTURE_PIXELS:
        return None
    return picture


def _claims_more_than_it_has(path: Path) -> bool:
    """Whether a chunk of a PNG file says that it is longer than the file: OpenCV takes as much memory as it says."""
    with path.open("rb") as file:
        whole, chunked = path.stat().st_size, file.read(len(PNG_BEGINS)) == PNG_BEGINS
        while chunked and len(head := file.read(8)) == 8:
            if (size := int.from_bytes(head[:4], "big")) > whole:
                return True
            file.seek(size + 4, os.SEEK_CUR)
    return False


def _as_colour(picture: NDArray[np.uint8] | None) -> Picture | None:
    if picture is None or picture.size == 0:
        return None
    if picture.ndim == 2 or picture.shape[2] == 1:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    return picture[..., :3]


def _retimed(frame_times: FrameTimes, fps: float | None) -> FrameTimes:
    """The times of frames that were taken at another rate than their stamps give."""
    if fps is None:
        return frame_times
    scale = 1.0 / (fps * frame_times.period)
    effect = f"{1 / scale:.6g} times slower" if scale < 1 else f"{scale:.6g} times faster"
    notes = f"taken at {fps:.6g}/s as given: the container, with {1 / frame_times.period:.6g}/s, shows it {effect}"
    return FrameTimes(
        frame_times.period,
        frame_times.even,
        scale,
        (*frame_times.notes, notes) if abs(scale - 1) > RATE_TOLERANCE else frame_times.notes,
    )


def grabbed(capture: cv2.VideoCapture) -> bool:
    """Go to the next picture; False where there is none, or where OpenCV fails at a damaged one."""
    try:
        return bool(capture.grab())
    except cv2.error:
        return False


def retrieved(capture: cv2.VideoCapture) -> Picture | None:
    """The picture gone to; None where it cannot be decoded, or where OpenCV fails at it."""
    try:
        done, picture = capture.retrieve()
    except cv2.error:
        return None
    return np.asarray(picture, np.uint8) if done else None


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Silence OpenCV and the libraries below it, which write to descriptor 2: our own messages name what failed."""
    logging = cv2.utils.logging
    before, nowhere = logging.getLogLevel(), os.open(os.devnull, os.O_WRONLY)
    try:
        kept = os.dup(STDERR_DESCRIPTOR)
    except OSError:  # it is closed
        kept = nowhere
    logging.setLogLevel(logging.LOG_LEVEL_SILENT)
    os.dup2(nowhere, STDERR_DESCRIPTOR)
    try:
        yield
    finally:
        os.dup2(kept, STDERR_DESCRIPTOR)
        logging.setLogLevel(before)
        for descriptor in {kept, nowhere}:
            os.close(descriptor)
