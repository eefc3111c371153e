"""A video that OpenCV reads: its pictures with their time stamps, and the frame times that these stamps mean.

Stamps that keep to the container's rate, up to the rounding of some formats to a millisecond, are put on that rate
exactly; others are used as they are. In: a file. Out: stamps [s] and pictures, in order or by seeking.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import cv2
import numpy as np

from models.errors import BadInput
from models.files.limits import MAX_FRAMES
from models.messages import OptionError, option
from sysid.vision.sources.frame_times import GAP_PERIODS, FrameTimes, retimed
from sysid.vision.sources.pictures import Picture, as_colour, check_size, grabbed, quiet, retrieved

PROBED_FRAMES = 60  # first frames of a container, from which its frame rate is judged
STAMP_ROUNDING_S = 0.6e-3  # some containers round stamps to a millisecond: half of that and a little more
MAX_JITTER_PERIODS = 0.05  # stamps farther off the even rate than this make it a variable rate


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
                    picture = None if found is None else as_colour(found)
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
            return retimed(FrameTimes(period, True, 1.0, (f"frame times from the rate {1 / period:.6g}/s",)), fps)
        if math.isfinite(rate):
            # Stamps may be rounded to a millisecond: the nominal rate of the container is tried first.
            period, elapsed = 1.0 / rate, stamps - stamps[0]
            residual = elapsed - period * np.round(elapsed / period)
            step_periods = np.median(steps) / period  # some containers give the finest rate that they can hold
            if (
                np.abs(residual).max() < max(STAMP_ROUNDING_S, MAX_JITTER_PERIODS * period)
                and 0.5 < step_periods < GAP_PERIODS
            ):
                return retimed(FrameTimes(period, True, 1.0, (f"frame times from the container, {rate:.6g}/s",)), fps)
        notes = f"frame times from the container, a variable rate of about {1 / np.median(steps):.4g}/s"
        return retimed(FrameTimes(float(np.median(steps)), False, 1.0, (notes,)), fps)
