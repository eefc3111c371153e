"""A webcam over a small table: where it stands, and balls that roll under it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from models.shot import Array, Table
from tests.footage.cameras import overhead
from tests.footage.motion import Motion

TABLE = Table(1.2, 0.65)
CAMERA = overhead(TABLE, 0.0523, (640, 380), 1.5, 1.36, (0.02, -0.02))
FPS = 30.0
NAMES = ("white", "red")


def rolling(places: Array, velocities: Sequence[tuple[float, float]], seconds: float, rest: float) -> Motion:
    """Balls that rest for a while, then roll, slowing by 0.1 m/s^2."""
    times = np.arange(0, seconds + 0.5, 1e-3)
    v = np.array(velocities, float)
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    ends = np.maximum(speed / 0.1, 1e-9)
    t = np.clip(times - rest, 0, None)[:, None, None]
    t = np.minimum(t, ends)
    xy = places + v * t - 0.05 * v / np.maximum(speed, 1e-9) * t**2
    turned = np.tile([1.0, 0, 0, 0], (*xy.shape[:2], 1))
    return Motion(NAMES[: len(places)], times, xy, turned)
