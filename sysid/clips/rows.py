"""The rows of one clip: CSV with the columns `t,ball,x,y,theta` in any order, and others that are preserved.

In: a CSV file. Out: `Rows`, and its faults in `Faults`.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files.faults import Faults, closest, listed, shown
from models.files.limits import MAX_BALLS, excess
from models.files.tables import csv_rows
from models.files.texts import TextPacker, Texts
from models.shot import Array
from sysid.clips.header import SET_REMEDY
from sysid.clips.names import name_fault

COLUMN_NAMES = ("t", "ball", "x", "y", "theta")
NUMBER_REMEDIES = {
    "t": "write seconds, such as 0.125",
    "x": "write metres, such as -0.34",
    "y": "write metres, such as -0.34",
}
MAX_ANGLE_RAD = 1e6  # largest turned angle of a ball
MAX_STAMP, MAX_PLACE = 1e16, 1e9  # larger numbers are, in any unit, neither stamps of a camera nor places on a table
ANGLE_REMEDY = "write radians, or leave it empty where the mark was not seen"


@dataclass(frozen=True)
class Rows:
    """The rows of one clip; a cell that is not a number is NaN here and reported as a fault."""

    line: Sequence[int]  # line number in the file, from 1
    names: tuple[str, ...]  # of the balls, as they appear
    ball: NDArray[np.int64]  # (n,) index into names
    time: Array  # (n,) [s]
    xy: Array  # (n, 2) [m]
    theta: Array  # (n,) [rad]
    extra: Mapping[str, Sequence[str]]  # cells of other columns


def read_rows(path: Path, file: str, faults: Faults) -> Rows | None:
    """The rows of a clip; None, with the fault noted, where its header cannot be used.

    Args:
        path: the file.
        file: its name in messages.
        faults: get what is wrong in it.
    """
    lines = array("L")
    header: list[str] = []
    packers: list[TextPacker] = []
    try:
        for line, row in csv_rows(path, file, faults, SET_REMEDY):
            if not packers:
                header = [name.strip() for name in row]
                if not _header_is_good(header, line, file, faults):
                    return None
                packers = [TextPacker() for _ in header]
            elif len(row) != len(header):
                count = f"{len(row)} cells where the header has {len(header)} columns"
                faults.add(file, f"{shown(','.join(row))} has {count}: complete or remove the row", line)
            else:
                lines.append(line)
                for packer, cell in zip(packers, row, strict=True):
                    packer.add(cell)
    except BadInput:  # already in the faults
        return None
    if not packers:
        faults.add(file, f"is empty: {SET_REMEDY}")
        return None
    columns = {}
    for name in header:
        columns[name] = packers.pop(0).texts()
    return _rows(columns, lines, file, faults)


def _rows(columns: Mapping[str, Texts], lines: Sequence[int], file: str, faults: Faults) -> Rows | None:
    index: dict[str, int] = {}
    ball = np.array([index.setdefault(name, len(index)) for name in columns["ball"]], dtype=np.int64)
    if problem := excess(len(index), MAX_BALLS, "balls", "give a ball one name in all its rows"):
        faults.add(file, problem)
        return None
    values = {key: _numbers(columns[key], key, lines, file, faults) for key in NUMBER_REMEDIES}
    theta = _angles(columns["theta"], lines, file, faults)
    for name, k in index.items():
        if fault := name_fault(name):
            faults.add(file, f"ball = {shown(name)} {fault}", lines[int(np.argmax(ball == k))])
    extra = {key: column for key, column in columns.items() if key not in COLUMN_NAMES}
    xy = np.stack([values["x"], values["y"]], axis=1)
    return Rows(lines, tuple(index), ball, values["t"], xy, theta, extra)


def _header_is_good(header: list[str], line: int, file: str, faults: Faults) -> bool:
    missing = [key for key in COLUMN_NAMES if key not in header]
    twice = sorted(key for key, count in Counter(header).items() if count > 1)
    if missing:
        others = [key for key in header if key not in COLUMN_NAMES]
        slips = [f"{meant!r}, not {key!r}" for key in others if (meant := closest(key, missing))]
        remedy = f"begin with the header {','.join(COLUMN_NAMES)}"
        if slips:
            remedy = "write " + ", ".join(slips)
        elif len(header) == 1 and (found := [mark for mark in ";\t|" if mark in header[0]]):
            remedy = f"separate the columns by commas, not {found[0]!r}"
        plural = "columns {} are" if len(missing) > 1 else "column {} is"
        faults.add(file, f"{plural.format(listed(missing))} missing ({listed(header)} found): {remedy}", line)
    if twice:
        faults.add(file, f"columns named {listed(twice)} appear more than once: keep one of each", line)
    return not missing and not twice


def _plain_numbers(cells: Sequence[str]) -> Array | None:
    """All cells as finite numbers, or None. Python's `1_000` and non-ASCII digits are not accepted in a CSV."""
    joined = "".join(cells)
    if "_" in joined or not joined.isascii():
        return None
    try:
        values = np.array(list(map(float, cells)), dtype=np.float64)
    except ValueError:
        return None
    return values if np.isfinite(values).all() else None


def _numbers(cells: Sequence[str], key: str, lines: Sequence[int], file: str, faults: Faults) -> Array:
    """A column of numbers (n,); a cell that is not a number becomes NaN and a fault."""
    most = MAX_STAMP if key == "t" else MAX_PLACE
    if (values := _plain_numbers(cells)) is not None and (np.abs(values) <= most).all():
        return values
    return np.array([_number(cell, key, line, file, faults) for cell, line in zip(cells, lines, strict=True)])


def _angles(cells: Sequence[str], lines: Sequence[int], file: str, faults: Faults) -> Array:
    """The angles (n,) [rad], NaN where empty."""
    angles = np.full(len(cells), np.nan)
    seen = [i for i, cell in enumerate(cells) if cell]
    if seen and (values := _plain_numbers([cells[i] for i in seen])) is not None:
        angles[seen] = values
    else:
        for i in seen:
            if cells[i].strip():
                angles[i] = _number(cells[i], "theta", lines[i], file, faults)
    for i in np.flatnonzero(np.abs(angles) > MAX_ANGLE_RAD).tolist():
        faults.add(file, f"theta = {shown(cells[i])} is not a valid angle of a ball: {ANGLE_REMEDY}", lines[i])
        angles[i] = np.nan
    return angles


def _number(cell: str, key: str, line: int, file: str, faults: Faults) -> float:
    """One cell as a number; NaN and a fault if it is not one."""
    remedy = NUMBER_REMEDIES.get(key, ANGLE_REMEDY)
    if not cell.strip():
        faults.add(file, f"{key} is empty: {remedy}, or remove the row where the ball was not seen", line)
        return math.nan
    values = _plain_numbers([cell])
    if values is not None and abs(values[0]) > {"t": MAX_STAMP, "theta": math.inf}.get(key, MAX_PLACE):
        faults.add(file, f"{key} = {shown(cell)} is too large: {remedy}", line)
        return math.nan
    if values is not None:
        return float(values[0])
    try:
        problem = "is not a number" if math.isfinite(float(cell)) else "is not finite"
    except ValueError:
        problem = "is not a number"
        if _plain_numbers([cell.replace(",", ".")]) is not None:
            remedy = "write a decimal point, not a comma"
    faults.add(file, f"{key} = {shown(cell)} {problem}: {remedy}", line)
    return math.nan
