"""How fast footage is tracked: pictures of three balls, held in memory, on one core."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import cast

import cv2
import numpy as np

from models.model_file import full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.vision.balls.colours.palette import default_palette
from sysid.vision.balls.learning import learn_detector
from sysid.vision.frames import Footage
from sysid.vision.sources.frame_times import FrameTimes
from sysid.vision.sources.picture_files import Pictures
from sysid.vision.tracks.track import track
from tests.footage.cameras import overhead
from tests.footage.film import Look, film
from tests.footage.motion import motion_of

SIZE, SPAN, TABLE, BALL = (1280, 960), 1.6, Table(1.4, 0.9), Ball(0.0525, 0.1406)
FPS, SECONDS = 120.0, 1.5
COLOURS = ("white", "red", "yellow")


class Held:
    """Pictures in memory, as a source of footage."""

    name = "pictures in memory"

    def __init__(self, pictures: Sequence[np.ndarray]) -> None:
        self.pictures, self.count, self.files = pictures, len(pictures), list[Path]()

    def frame_times(self, fps: float | None) -> FrameTimes:
        """Evenly."""
        return FrameTimes(1.0 / FPS, True, 1.0, ())

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Times and pictures."""
        for index in jumps if jumps is not None else range(self.count if most is None else min(most, self.count)):
            yield index / FPS, self.pictures[index]


def video_rows() -> list[tuple[str, ...]]:
    """Frames a second, and how that compares with one Gaussian blur of each picture."""
    camera = overhead(TABLE, BALL.diameter, SIZE, 2.0, SPAN, (0.01, -0.015))
    times = np.arange(0.0, SECONDS, 1e-3)
    velocity = np.array([[1.3, 0.25], [0.0, 0.0], [-0.5, 0.4]])
    start = np.array([[-0.45, -0.1], [0.05, 0.0], [0.35, -0.3]])
    shot = Shot(COLOURS, start, velocity, np.zeros((3, 3)), times)
    motion = motion_of(simulate(full_model(TABLE, BALL), [shot])[0])
    taken = np.arange(0.0, SECONDS, 1 / FPS)
    held = Held(list(film(camera, motion, taken, Look())))
    footage = Footage(cast(Pictures, held), None)
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        detector = learn_detector(camera, footage, default_palette())
        result = track(footage, camera, detector, dict.fromkeys(COLOURS, 1))
        began = time.perf_counter()
        for picture in held.pictures:
            cv2.GaussianBlur(picture, (0, 0), 2.0)
        blur = held.count / (time.perf_counter() - began)
    finally:
        cv2.setNumThreads(threads)
    radius = float(camera.radius_px(np.zeros((1, 2)))[0])
    names = ", ".join(sorted(t.name for t in result.scene.tracks))
    return [
        (f"tracking {SIZE[0]} x {SIZE[1]}, one core", "frames/s", "blurs a frame"),
        (f"{held.count} frames; {names}; {radius:.0f} px in radius", f"{result.rate:.0f}", f"{blur / result.rate:.2f}"),
    ]
