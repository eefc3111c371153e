"""Clips to be recorded for Rerun, and a recording read back."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from models.recording.clips import Review
from models.shot import Array, Ball, Event, Table, Track

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
OFFSET = np.array([0.003, -0.004])  # modelled - measured: 5 mm


def clip(name: str, *, duration: float = 2.0, fps: float = 60.0, balls: tuple[str, ...] = ("cue", "red")) -> Review:
    """Balls that slow down along +x, and a model that is OFFSET away and sampled at other times."""
    seen, modelled = np.arange(0.0, duration, 1 / fps), np.linspace(0.0, duration, 500)

    def path(times: Array, ball: int) -> Array:
        return np.column_stack([-1.0 + 0.9 * times - 0.1 * times**2, np.full(times.size, 0.03 * ball)])

    position = np.stack([path(modelled, k) + OFFSET for k in range(len(balls))], axis=1)
    velocity = np.zeros_like(position)
    velocity[..., 0] = (0.9 - 0.2 * modelled)[:, None]
    spin, theta = np.zeros((*position.shape[:2], 3)), np.zeros(position.shape[:2])
    events = (Event(1.0, "cushion", ("cue",), "+x"), Event(0.5, "ball", balls[:2]))
    track = Track(balls, modelled, position, velocity, spin, theta, events)
    return Review(
        name, {ball: (seen, path(seen, k)) for k, ball in enumerate(balls)}, {"found": track}, note=f"note of {name}"
    )


def read(path: Path) -> dict[str, list[Any]]:
    """Entity path -> its chunks, as record batches."""
    from rerun.chunk import RrdReader

    found: dict[str, list[Any]] = {}
    for chunk in RrdReader(path).stream().to_chunks():
        found.setdefault(chunk.entity_path, []).append(chunk.to_record_batch())
    return found


def column(batches: list[Any], name: str) -> list[Any]:
    """The rows of the column whose name ends so, in the order of `shot_time` within a batch."""
    rows = []
    for batch in batches:
        rows += [row for label in batch.schema.names if label.endswith(name) for row in batch[label].to_pylist()]
    return rows


def seconds(batches: list[Any]) -> list[float]:
    times = [
        row
        for batch in batches
        if "shot_time" in batch.schema.names
        for row in batch["shot_time"].cast("int64").to_pylist()
    ]
    return [1e-9 * nanoseconds for nanoseconds in times]
