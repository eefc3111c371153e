"""Pictures as OpenCV reads them, from files and captures: in colour, within the limits, and without its own messages.

In: a file, or an open capture. Out: pictures (height, width, 3), blue, green, red; None where none can be read.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files.limits import MAX_PICTURE_PIXELS

os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # it is read once, when a video is first opened or written

Picture = NDArray[np.uint8]
PNG_BEGINS = b"\x89PNG\r\n\x1a\n"
STDERR_DESCRIPTOR = 2  # its descriptor


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
            picture = as_colour(cv2.imread(str(path), cv2.IMREAD_COLOR))
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


def as_colour(picture: NDArray[np.uint8] | None) -> Picture | None:
    if picture is None or picture.size == 0:
        return None
    if picture.ndim == 2 or picture.shape[2] == 1:
        return np.asarray(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR))
    return picture[..., :3]


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
