"""When pictures were taken, as a file beside them says: a time in seconds on each line.

In: the file, and how many pictures there are. Out: their times.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import read_text
from models.files.faults import Faults
from models.files.limits import excess

Array = NDArray[np.float64]
MAX_REMARKS = 1000  # lines beside two for each picture
MIN_RATE_HZ = 1.0  # below this frame rate the times of pictures cannot be in seconds


def read_times(path: Path, count: int) -> Array:
    """Times of pictures [s] from a text file, one per line: the column headed time or t, else the last."""
    faults = Faults()
    text = faults.settle(read_text(path, str(path), faults, "write one time in seconds on a line"))
    if problem := excess(
        text.count("\n"), 2 * count + MAX_REMARKS, "lines", f"write one time for each of {count} pictures"
    ):
        raise BadInput(f"{path}: {problem}")
    lines = [re.split(r"[,;\s]+", line.strip().rstrip(",;")) for line in text.splitlines()]
    rows = [row for row in lines if row != [""] and not row[0].startswith("#")]
    column = -1
    if rows and not _number(rows[0][-1]):
        columns = [head.lower() for head in rows.pop(0)]
        column = next((k for k, head in enumerate(columns) if head in ("t", "time", "timestamp", "time_s")), -1)
    for number, row in enumerate(rows, 1):
        if column >= len(row) or not _number(row[column]):
            raise BadInput(f"{path}: time {number} is {' '.join(row)!r}; write one time in seconds on a line")
    times = np.array([float(row[column]) for row in rows])
    if len(times) != count:
        raise BadInput(f"{path}: holds {len(times)} times for {count} pictures; write one for each")
    steps = np.diff(times)
    if not np.isfinite(times).all() or (len(steps) and steps.min() <= 0):
        raise BadInput(f"{path}: times must increase; put them in the order of the pictures' names")
    if len(steps) and np.median(steps) > 1 / MIN_RATE_HZ:
        raise BadInput(f"{path}: pictures {np.median(steps):g} apart; times must be in seconds")
    return times


def _number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
