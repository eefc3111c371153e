"""Files of other programs as columns of cells: CSV of any separator, JSON of most shapes, Parquet.

In: a file. Out: its `Columns`.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.errors import BadInput
from models.files import parse, read_text
from models.files.faults import Faults, shown

COLUMN_SEPARATORS = ",;\t|"
MAX_BYTES = 1 << 30  # of one file
PLACE_NAMES = ("xy", "pos", "position", "center", "centre", "point", "location")  # of pairs (x, y)
GROUP_KEYS = ("balls", "tracks", "objects", "detections", "frames", "data", "samples", "points", "shots", "positions")


@dataclass(frozen=True)
class Columns:
    """A table of cells as texts, all columns of one length; an empty text where there is no value."""

    file: str
    cells: Mapping[str, Sequence[str]]
    first_line: int = 2  # of the first row, for messages

    @property
    def names(self) -> tuple[str, ...]:
        """Of the columns."""
        return tuple(self.cells)


def read_columns(path: Path) -> Columns:
    """The columns of a file; BadInput where it has none."""
    suffix = path.suffix.lower()
    if suffix in (".parquet", ".pq"):
        return Columns(str(path), _parquet(path))
    faults = Faults()
    text = faults.settle(read_text(path, str(path), faults, "name a CSV, JSON or Parquet file", MAX_BYTES))
    if suffix == ".json" or text.lstrip()[:1] in ("{", "["):
        return Columns(str(path), _json(text, str(path)), 1)
    return _csv(text, str(path))


def _csv(text: str, file: str) -> Columns:
    """Of a CSV: lines that begin with # are remarks, and a comma may be the decimal one beside other separators."""
    lines = text.splitlines()
    skipped = next((k for k, line in enumerate(lines) if line.strip() and not line.startswith("#")), len(lines))
    body = lines[skipped:]
    separator = max(COLUMN_SEPARATORS, key="".join(body[:1]).count)
    try:
        rows = [row for row in csv.reader(io.StringIO("\n".join(body)), delimiter=separator, strict=True) if row]
    except csv.Error as error:
        raise BadInput(f"{file}: is not CSV ({error}): save it again as CSV") from error
    if len(rows) < 2:
        raise BadInput(f"{file}: holds no rows: name the tracker's CSV, JSON or Parquet file")
    head = [name.strip().lstrip("\ufeff") for name in rows[0]]
    if len(set(head)) < len(head) or not any(c.isalpha() for c in "".join(head)):
        raise BadInput(f"{file}: row {skipped + 1} names no columns, or some twice: begin with a row of names")
    for number, row in enumerate(rows[1:], skipped + 2):
        if len(row) != len(head):
            raise BadInput(f"{file}, row {number}: {len(row)} cells where {len(head)} columns are named: complete it")
    columns = [[cell.strip() for cell in column] for column in zip(*rows[1:], strict=True)]
    if separator != ",":
        columns = [[_decimal(cell) for cell in column] for column in columns]
    return Columns(file, dict(zip(head, columns, strict=True)), skipped + 2)


def _decimal(cell: str) -> str:
    """A number with a decimal comma as one with a point."""
    changed = cell.replace(",", ".")
    try:
        float(changed)
    except ValueError:
        return cell
    return changed


def _parquet(path: Path) -> dict[str, list[str]]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError as error:
        raise BadInput(
            f"{path}: Parquet needs pyarrow: pip install 'cuelab[parquet]', or save the file as CSV"
        ) from error
    try:
        found = pyarrow.parquet.read_table(path).to_pydict()
    except (OSError, pyarrow.ArrowException) as error:
        raise BadInput(f"{path}: cannot be read as Parquet ({' '.join(str(error).split())[:80]})") from error
    return {name: [_text(value) for value in column] for name, column in found.items()}


def _json(text: str, file: str) -> dict[str, list[str]]:
    faults = Faults()
    data = faults.settle(parse(text, file, faults, json.loads))
    records = list(_records(data, {}))
    names = list(dict.fromkeys(name for record in records for name in record))
    if not records or not names:
        raise BadInput(
            f"{file}: holds no rows: write a list of objects such as " + '{"t": 0, "ball": "cue", "x": 0, "y": 0}'
        )
    return {name: [_text(record.get(name)) for record in records] for name in names}


def _records(data: Any, known: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Rows of nested lists and objects: an inner one has what the outer ones say, and the name it is known by."""
    if isinstance(data, list):
        for item in data:
            yield from _records(item, known)
        return
    if not isinstance(data, dict):
        return
    columns = {key: value for key, value in data.items() if isinstance(value, list) and _is_flat(value)}
    pairs = {key: columns.pop(key) for key in list(columns) if key.lower() in PLACE_NAMES and len(columns[key]) == 2}
    inner = {key: value for key, value in data.items() if isinstance(value, dict | list) and key not in columns}
    inner = {key: value for key, value in inner.items() if key not in pairs}
    own = {key: value for key, value in data.items() if not isinstance(value, dict | list)}
    own = {**known, **own, **{axis: v for pair in pairs.values() for axis, v in zip("xy", pair, strict=True)}}
    if columns and len({len(column) for column in columns.values()}) == 1:
        for row in zip(*columns.values(), strict=True):
            yield {**own, **dict(zip(columns, row, strict=True))}
    elif not inner:
        yield dict(own)
    for key, value in inner.items():
        name = {} if key.lower() in GROUP_KEYS or "ball" in own else {"ball": key}
        yield from _records(value, {**own, **name})


def _is_flat(values: list[Any]) -> bool:
    return bool(values) and not any(isinstance(value, dict | list) for value in values)


def _text(value: Any) -> str:
    """A cell as text; empty for none."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def numbers(cells: Sequence[str], where: str, first_line: int = 2) -> list[float]:
    """A column as numbers, NaN where it is empty; BadInput names the row of a text."""
    found = []
    for k, cell in enumerate(cells):
        try:
            found.append(float(cell) if cell and cell.lower() not in ("na", "none", "null") else math.nan)
        except ValueError:
            raise BadInput(f"{where}, row {k + first_line}: {shown(cell)} is not a number: correct it") from None
    return found
