"""Films in which the grey level tells the frame."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

FILM_RATE = 60.0  # [1/s]
FILM_SIZE = (800, 450)


def grey(frame: int) -> int:
    """Level of a frame's pictures, apart from its neighbours' by more than compression spoils."""
    return 10 + 9 * (int(frame) % 25)


def write_film(path: Path, count: int) -> None:
    """A film of so many frames."""
    path.parent.mkdir(parents=True, exist_ok=True)
    code = "FFV1" if path.suffix == ".mkv" else "mp4v"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*code), FILM_RATE, FILM_SIZE)
    for k in range(count):
        writer.write(np.full((FILM_SIZE[1], FILM_SIZE[0], 3), grey(k), np.uint8))
    writer.release()
