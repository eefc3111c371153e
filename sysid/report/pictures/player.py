"""Shots for playback in the page: measured positions, and each model's misses.

In: comparisons of the same clips. Out: plain values, which scripts/report.js draws. Numbers are small integers, tenths
of a millimetre and milliseconds, each the difference from the one before, so that a hundred shots stay within a
megabyte.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.report.numbers import millimetres
from models.shot import Track
from models.table.palette import ball_colour
from sysid.clips import Clip, Observation
from sysid.residuals.compare import MOVED_M
from sysid.residuals.comparison import Comparison

Array = NDArray[np.float64]

MAX_POINTS = 28_000  # of all shots in a page: some 1.1 MB with two models
UNITS_PER_M, UNITS_PER_S = 1e4, 1e3
MAGNIFICATIONS, MAX_DRAWN_M = (100, 20, 5, 1), 0.06  # of misses, and the length to which a typical one is drawn
NO_BALL = -32768  # where a model has no ball


def playback(comparisons: Sequence[tuple[str, Comparison]]) -> dict[str, Any] | None:
    """All shots of the last comparison, with the misses of the first and the last; None without shots.

    The most instructive shot comes first: the one whose miss changes most, or for a single comparison the worst.
    """
    if not comparisons or not comparisons[-1][1].tracks:
        return None
    last = comparisons[-1][1]
    ends = [comparisons[0], comparisons[-1]] if len(comparisons) > 1 else [comparisons[-1]]
    tracks = [{c.file: t for c, t in zip(one.shots, one.tracks, strict=True)} for _, one in ends]
    rows = [{row.file: row for row in one.clips} for _, one in ends]
    shots = [shot for shot in last.shots if all(shot.file in t for t in tracks) and shot.file in rows[-1]]
    misses = {shot.file: [_finite(row[shot.file].rms_m) for row in rows if shot.file in row] for shot in shots}
    shots.sort(key=lambda shot: (-abs(misses[shot.file][0] - (misses[shot.file][1:] or [0.0])[0]), shot.file))
    points = sum(len(_moving(seen)) for shot in shots for seen in shot.balls.values())
    stride = max(1, math.ceil(points / MAX_POINTS))
    table, ball = last.clip_set.table, last.clip_set.ball
    typical = float(np.median([max(found) for found in misses.values()] or [0.0]))
    return {
        "magnify": next((m for m in MAGNIFICATIONS if m * typical <= MAX_DRAWN_M), 1),
        "models": [name for name, _ in ends] if len(ends) == 1 else [f"before: {ends[0][0]}", f"after: {ends[1][0]}"],
        "table": [table.length, table.width], "pockets": bool(table.pockets), "radius": ball.radius,
        "shots": [
            {"name": PurePosixPath(shot.file).stem,
             "misses": [millimetres(r[shot.file].rms_m) for r in rows if shot.file in r],
             "held": rows[-1][shot.file].held_out, "balls": _balls(shot, [t[shot.file] for t in tracks], stride)}
            for shot in shots
        ],
    }  # fmt: skip


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0


def _moving(seen: Observation) -> NDArray[np.int64]:
    """Indices of a ball's samples before thinning: all, or the first and the last if it rests."""
    good = np.flatnonzero(np.isfinite(seen.xy).all(axis=1))
    if len(good) > 1 and np.ptp(seen.xy[good], axis=0).max() < MOVED_M:
        return good[[0, -1]]
    return good


def _balls(shot: Clip, tracks: Sequence[Track], stride: int) -> list[dict[str, Any]]:
    """Every measured ball: its colour, times, positions and the models' misses."""
    found = []
    for name, seen in shot.balls.items():
        kept = _moving(seen)
        if not len(kept):
            continue
        kept = np.unique(np.append(kept[::stride], kept[-1]))
        time, xy = seen.time[kept], seen.xy[kept]
        found.append({
            "name": name, "colour": "rgb({},{},{})".format(*ball_colour(name)),
            "t": _steps(time * UNITS_PER_S), "x": _steps(xy[:, 0] * UNITS_PER_M), "y": _steps(xy[:, 1] * UNITS_PER_M),
            "miss": [[_misses(track, name, time, xy, axis) for axis in (0, 1)] for track in tracks],
        })  # fmt: skip
    return found


def _misses(track: Track, name: str, time: Array, xy: Array, axis: int) -> list[int]:
    """Model less measurement along an axis, at the nearest of the model's times."""
    if name not in track.names:
        return [NO_BALL] * len(time)
    times = np.asarray(track.times)
    after = np.clip(np.searchsorted(times, time), 1, max(len(times) - 1, 1))
    nearest = np.where(time - times[after - 1] < times[np.minimum(after, len(times) - 1)] - time, after - 1, after)
    place = track.position[np.minimum(nearest, len(times) - 1), track.names.index(name), axis]
    off = np.round((place - xy[:, axis]) * UNITS_PER_M)
    return [int(v) for v in np.where(np.isfinite(off), off, NO_BALL)]


def _steps(values: Array) -> list[int]:
    """Whole numbers as the first and the differences after it."""
    whole = np.round(values).astype(np.int64)
    return [int(v) for v in np.diff(whole, prepend=0)]
