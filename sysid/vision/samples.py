"""Pictures spread over a video or a folder of pictures, in which no times are needed: for a calibration."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from models.errors import BadInput
from sysid.vision.sources.pictures import Picture, check_size, grabbed, quiet, read_picture, retrieved

PICTURE_SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp", ".ppm"}


def spread_pictures(path: Path, count: int) -> Iterator[Picture]:
    """Up to so many pictures, spread over a video or a folder, or the one that a file holds: (height, width, 3)."""
    if not (path.is_file() or path.is_dir()):
        raise BadInput(f"{path}: does not exist; name a video, a picture, or a folder of pictures")
    if path.is_dir() or path.suffix.lower() in PICTURE_SUFFIXES:
        yield from _of_files(path, count)
        return
    with quiet():
        video = cv2.VideoCapture(str(path))
    check_size(path, video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT))
    try:
        total = int(video.get(cv2.CAP_PROP_FRAME_COUNT)) if video.isOpened() else 0
        yielded = False
        for k in np.unique(np.linspace(0, max(total - 1, 0), count).astype(int)):
            if k > 0:
                video.set(cv2.CAP_PROP_POS_FRAMES, int(k))
            picture = retrieved(video) if grabbed(video) else None
            if picture is not None:
                yielded = True
                yield picture
        if not yielded:
            raise BadInput(f"{path}: is not a video that can be read; convert it, to H.264 in mp4 for instance")
    finally:
        video.release()


def _of_files(path: Path, count: int) -> Iterator[Picture]:
    """The same of a picture, or of a folder of pictures."""
    files = sorted(f for f in path.iterdir() if f.suffix.lower() in PICTURE_SUFFIXES) if path.is_dir() else [path]
    if not files:
        raise BadInput(f"{path}: holds no pictures ({', '.join(sorted(PICTURE_SUFFIXES))}); name a video or a picture")
    shape: tuple[int, ...] | None = None
    for k in np.unique(np.linspace(0, len(files) - 1, min(count, len(files))).astype(int)):
        picture = read_picture(files[k])
        if picture is None:
            raise BadInput(f"{files[k]}: is not a picture that can be read; remove it or convert it to PNG")
        if shape not in (None, picture.shape):
            raise BadInput(f"{files[k]}: differs in size from those before it; remove it")
        shape = picture.shape
        yield picture
