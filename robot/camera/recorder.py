"""Recording of a live camera in the background, without loss, until the bed is still.

In: a source of stamped pictures and the camera's calibration. Out: a video with its frame times, and `Footage`.

A picture's frame number follows from its stamp s_k. With unknown delays and a period T,

    n_k = min(round((s_k - s_0) / T), n_(k+1) - 1),

from the last to the first, so that a late stamp does not shift those after it. Missing frames remain as gaps in time
and are reported. Left out: cameras faster than the disk and the encoder lose frames, which is reported as well.
"""

from __future__ import annotations

import math
import queue
import threading
from collections import deque
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import write_whole
from models.shot import Array
from robot.camera.source import Source
from sysid.vision import Camera, Footage, Picture, lossless_writer, stamped_footage

MAX_RECORDING_S = 300.0
BUFFER_PICTURES = 64  # most pictures waiting to be written
HANG_S = 5.0  # time without a picture after which a camera counts as hung
REST_S, COMPARED_S = 1.0, 0.4  # time for which the bed must be still; time between compared pictures
DOWNSCALE, MOTION_GREY_LEVELS = 4, 12.0  # pixels averaged to detect motion; change that counts as motion
RATE_TOLERANCE = 0.05  # relative difference of a camera's frame rate from the given one
NO_PICTURE = "no picture came from the camera; check that it is filming, and not already recording"


class FilmRecorder:
    """A recording to a file: one thread reads and one writes, so that a slow disk loses no pictures."""

    def __init__(self, source: Source, camera: Camera, path: Path, fps: float) -> None:
        """Start recording."""
        self.path, self.warnings = path, list[str]()
        self._source, self._camera, self._fps = source, camera, fps
        self._stamps: list[float] = []
        self._waiting: queue.Queue[Picture | None] = queue.Queue(BUFFER_PICTURES)
        self._ended, self._asked, self._error = threading.Event(), threading.Event(), ""
        self._writer = lossless_writer(path, fps, camera.size)
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._read, self._write)]
        for thread in self._threads:
            thread.start()

    def finish(self, limit: float) -> None:
        """Wait until the bed is still, or a time limit [s]; BadInput if nothing was recorded."""
        self._asked.set()
        self._threads[0].join(limit)
        if self._threads[0].is_alive():
            self.warnings.append(f"something was still moving on the table after {limit:g} s: the film ends there")
        self.stop()
        if self._error or not self._stamps:
            raise BadInput(self._error or NO_PICTURE)

    def stop(self) -> None:
        """End now."""
        self._ended.set()
        self._threads[0].join(HANG_S)
        if self._threads[0].is_alive():
            self._error = f"the camera gave no picture for {HANG_S:g} s; unplug it and start again"
            self._waiting.put(None)
        self._threads[1].join()
        self._writer.release()
        rows = "".join(f"{k},{stamp - self._stamps[0]:.6f}\n" for k, stamp in enumerate(self._stamps))
        write_whole(self.path.with_suffix(".times.csv"), f"frame,time_s\n{rows}".encode())

    def footage(self) -> Footage:
        """The recorded film, with gaps where frames are missing."""
        numbers, period = frame_numbers(np.array(self._stamps), 1 / self._fps)
        if abs(self._fps * period - 1) > RATE_TOLERANCE:
            self.warnings.append(f"the camera gave {1 / period:.4g} pictures/s instead of {self._fps:.4g}")
        footage = stamped_footage(self.path, numbers, period)
        if footage.count is not None and footage.count < len(numbers):
            self.warnings.append(
                f"only {footage.count} of {len(numbers)} pictures were written: check that the disk has room"
            )
        return footage

    def _read(self) -> None:
        still = _Still(self._camera)
        try:
            while not self._ended.is_set() and (got := self._source.read()) is not None:
                stamp, picture = got
                self._stamps.append(stamp)
                self._waiting.put(checked(picture, self._camera))
                rests = still.since(stamp, picture) >= REST_S
                if (rests and self._asked.is_set()) or stamp - self._stamps[0] > MAX_RECORDING_S:
                    break
        except (BadInput, OSError, cv2.error) as error:
            self._error = str(error)
        finally:
            self._waiting.put(None)

    def _write(self) -> None:
        while (picture := self._waiting.get()) is not None:  # read on, or the reading thread would block
            try:
                self._writer.write(picture)
            except cv2.error as error:
                self._error = f"{self.path}: cannot be written ({error}); check that the disk has room"


class _Still:
    """Measures how long the bed has been still."""

    def __init__(self, camera: Camera) -> None:
        x, y = camera.table.length / 2, camera.table.width / 2
        corners = np.array([[x, y, 0], [-x, y, 0], [-x, -y, 0], [x, -y, 0]], float)
        self._size = (max(camera.size[0] // DOWNSCALE, 1), max(camera.size[1] // DOWNSCALE, 1))
        bed = np.zeros((camera.size[1], camera.size[0]), np.uint8)
        cv2.fillPoly(bed, [np.rint(camera.project(corners)).astype(np.int32)], 1)
        self._bed = cv2.resize(bed, self._size, interpolation=cv2.INTER_NEAREST).astype(bool)
        self._recent: deque[tuple[float, NDArray[np.float32]]] = deque()
        self._moved = math.nan

    def since(self, stamp: float, picture: Picture) -> float:
        """Add a picture taken at a time; returns how long the bed has been still [s]."""
        small = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA).mean(axis=2, dtype=np.float32)
        self._moved = stamp if math.isnan(self._moved) else self._moved
        self._recent.append((stamp, small))
        while stamp - self._recent[0][0] > COMPARED_S:
            before = self._recent.popleft()[1]
            if (np.abs(small - before)[self._bed] > MOTION_GREY_LEVELS).any():
                self._moved = stamp
        return stamp - self._moved


def frame_numbers(stamps: Array, period: float) -> tuple[NDArray[np.int64], float]:
    """Frame numbers from 0 of pictures with stamps (n,) [s], and the fitted period [s]."""
    if len(stamps) < 2:
        return np.zeros(len(stamps), np.int64), period
    usual = float(np.median(np.diff(stamps)))
    period = usual if abs(usual / period - 1) > RATE_TOLERANCE else period
    for _ in range(3):
        numbers = np.rint((stamps - stamps[0]) / period).astype(np.int64)
        for k in range(len(numbers) - 2, -1, -1):
            numbers[k] = min(numbers[k], numbers[k + 1] - 1)
        period = float(np.polyfit(numbers, stamps, 1)[0])
    return numbers - numbers[0], period


def checked(picture: Picture, camera: Camera) -> Picture:
    """The picture; BadInput if it has not the camera's size."""
    (h, w), (width, height) = picture.shape[:2], camera.size
    if (w, h) != (width, height):
        raise BadInput(
            f"the camera gives {w} x {h} pixels, its file {width} x {height}; set it to that size, or calibrate"
        )
    return picture
