"""Files of other programs as columns of cells: CSV of any separator, JSON of most shapes, Parquet.

In: a file. Out: its `TextColumns`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from models.errors import BadInput, one_line
from models.files import limits, parse, read_text
from models.files.documents import file_problem
from models.files.faults import Faults, shown
from models.files.limits import excess
from models.files.tables import COLUMNS_REMEDY, SPLIT_REMEDY, csv_rows
from models.files.texts import TextPacker

COLUMN_SEPARATORS = ",;\t|"
FILE_REMEDY = "name a CSV, JSON or Parquet file"
PARQUET_BATCH_ROWS = 4096
PLACE_NAMES = ("xy", "pos", "position", "center", "centre", "point", "location")  # names of columns of pairs (x, y)
MAX_SAID_CHARS = 120  # longest quotation of a library's message
MAKE_AGAIN = "save it again, or save it as CSV"
GROUP_KEYS = ("balls", "tracks", "objects", "detections", "frames", "data", "samples", "points", "shots", "positions")


@dataclass(frozen=True)
class TextColumns:
    """A table of cells as texts, all columns of one length; an empty text stands for no value."""

    file: str
    cells: Mapping[str, Sequence[str]]
    first_line: int = 2  # line of the first row, for messages
    lines: Sequence[int] = ()  # line of each row, if rows are not on consecutive lines

    def line(self, row: int) -> int:
        """The line of a row; rows count from 0."""
        return self.lines[row] if self.lines else row + self.first_line

    def rows(self, kept: Sequence[int]) -> TextColumns:
        """Some of its rows."""
        cells = {name: [column[k] for k in kept] for name, column in self.cells.items()}
        return TextColumns(self.file, cells, self.first_line, [self.line(k) for k in kept])

    @property
    def names(self) -> tuple[str, ...]:
        """Number of rows."""
        return tuple(self.cells)


def read_columns(path: Path) -> TextColumns:
    """Read the columns of a file; BadInput if it has none."""
    suffix = path.suffix.lower()
    if suffix in (".parquet", ".pq"):
        return TextColumns(str(path), _parquet(path))
    if suffix == ".json" or _looks_like_json(path):
        faults = Faults()
        text = faults.settle(read_text(path, str(path), faults, FILE_REMEDY, limits.MAX_TRACKS_JSON_BYTES))
        return TextColumns(str(path), _json(text, str(path)), 1)
    return _csv(path)


def _looks_like_json(path: Path) -> bool:
    """Whether a readable file begins as JSON does."""
    if file_problem(path, FILE_REMEDY, limits.MAX_TABLE_BYTES):
        return False
    try:
        with path.open("rb") as file:
            return file.read(1000).removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[")
    except OSError:
        return False


def _csv(path: Path) -> TextColumns:
    """Columns of a CSV; lines beginning with # are comments, and with another separator the comma may be decimal."""
    file, head, first_line = str(path), list[str](), 2
    packers: list[TextPacker] = []
    rows = csv_rows(path, file, Faults(), FILE_REMEDY, separators=COLUMN_SEPARATORS, remarks=True)
    for line, row in rows:
        if not head:
            head, first_line = [name.strip().lstrip("\ufeff") for name in row], line + 1
            if len(set(head)) < len(head) or not any(c.isalpha() for c in "".join(head)):
                raise BadInput(f"{file}: row {line} names no columns, or some twice: begin with a row of names")
            packers = [TextPacker() for _ in head]
        elif len(row) != len(head):
            raise BadInput(f"{file}, row {line}: {len(row)} cells, but {len(head)} columns are named: complete it")
        else:
            for packer, cell in zip(packers, row, strict=True):
                cell = cell.strip()
                packer.add(_decimal(cell) if "," in cell else cell)
    if not packers or not len(packers[0]):
        raise BadInput(f"{file}: holds no rows: name the tracker's CSV, JSON or Parquet file")
    return TextColumns(file, {name: packer.texts() for name, packer in zip(head, packers, strict=True)}, first_line)


def _decimal(cell: str) -> str:
    """The text of a number with a decimal point instead of a comma."""
    changed = cell.replace(",", ".")
    try:
        float(changed)
    except ValueError:
        return cell
    return changed


def _parquet(path: Path) -> dict[str, Sequence[str]]:
    try:
        import pyarrow
        import pyarrow.compute
        import pyarrow.parquet
    except ImportError as error:
        raise BadInput(
            f"{path}: Parquet needs pyarrow: pip install 'cuelab[parquet]', or save the file as CSV"
        ) from error
    if problem := file_problem(path, FILE_REMEDY, limits.MAX_TABLE_BYTES) or _long_head(path):
        raise BadInput(f"{path}: {problem}")
    try:
        return _parquet_columns(pyarrow, path)
    except BadInput:
        raise
    except (OSError, pyarrow.ArrowException, OverflowError, ValueError) as error:  # OverflowError: invalid dates
        said = one_line(" ".join(str(error).split()).split(". ")[0].removesuffix("."))
        said = said if len(said) <= MAX_SAID_CHARS else f"{said[:MAX_SAID_CHARS]} ..."
        raise BadInput(f"{path}: is damaged, or not a Parquet file ({said}): {MAKE_AGAIN}") from error


def _long_head(path: Path) -> str:
    """The fault of a Parquet file's metadata by its length, which stands at the file's end; "" if there is none."""
    try:
        with path.open("rb") as file:
            file.seek(max(path.stat().st_size - 8, 0))
            end = file.read(8)
    except OSError as error:
        return f"cannot be read ({error.strerror}): {FILE_REMEDY}"
    if len(end) < 8 or end[4:] != b"PAR1":
        return f"does not end as a Parquet file does: {MAKE_AGAIN}"
    size = int.from_bytes(end[:4], "little")
    return excess(size, limits.MAX_PARQUET_HEAD_BYTES, "MB of description", COLUMNS_REMEDY, 1 << 20)


def _parquet_columns(pyarrow: Any, path: Path) -> dict[str, Sequence[str]]:
    """Read the columns of a Parquet file, after a check of the sizes in its metadata and of its longest texts."""
    with pyarrow.parquet.ParquetFile(path) as plain:
        # The metadata of single columns are not read: if they are damaged, pyarrow aborts the whole process.
        about, schema = plain.metadata, plain.schema_arrow
        groups = [about.row_group(k) for k in range(about.num_row_groups)]
    problem = (
        excess(about.num_columns, limits.MAX_COLUMNS, "columns", COLUMNS_REMEDY)
        or excess(about.num_rows, limits.MAX_ROWS, "rows", SPLIT_REMEDY)
        or excess(about.num_rows * about.num_columns, limits.MAX_CELLS, "cells", SPLIT_REMEDY)
        or excess(
            sum(max(group.total_byte_size, 0) for group in groups), limits.MAX_TABLE_BYTES, "MB unpacked", SPLIT_REMEDY,
            1 << 20,
        )
    )  # fmt: skip
    if problem:
        raise BadInput(f"{path}: {problem}")
    # Texts stay dictionary-encoded, each stored once: a small file may hold a long one for every row.
    names = [field.name for field in schema if pyarrow.types.is_string(field.type) or _is_bytes(pyarrow, field.type)]
    packers = {name: TextPacker() for name in schema.names}
    with pyarrow.parquet.ParquetFile(path, read_dictionary=names) as file:
        for batch in file.iter_batches(batch_size=PARQUET_BATCH_ROWS):
            for name, column in zip(batch.schema.names, batch.columns, strict=True):
                if problem := _long_text(pyarrow, column):
                    raise BadInput(f"{path}, column {shown(name)}: {problem}")
                packers[name].extend([_text(value) for value in column.to_pylist()])
            size = sum(packer.size for packer in packers.values())
            if problem := excess(size, limits.MAX_CELL_BYTES, "MB of texts", SPLIT_REMEDY, 1 << 20):
                raise BadInput(f"{path}: {problem}")
    return {name: packer.texts() for name, packer in packers.items()}


def _is_bytes(pyarrow: Any, kind: Any) -> bool:
    return bool(pyarrow.types.is_binary(kind))


def _long_text(pyarrow: Any, column: Any) -> str:
    """The fault of a column by its longest text, or by the size of its lists; "" if there is none."""
    if pyarrow.types.is_dictionary(column.type):
        column = column.dictionary
    if pyarrow.types.is_string(column.type) or _is_bytes(pyarrow, column.type):
        longest = pyarrow.compute.max(pyarrow.compute.binary_length(column)).as_py() or 0
        return excess(longest, limits.MAX_CELL_CHARS, "characters in a cell", "remove that column")
    if pyarrow.types.is_nested(column.type):
        return excess(column.nbytes, limits.MAX_CELL_CHARS * max(len(column), 1), "bytes in lists", "leave it out")
    return ""


def _json(text: str, file: str) -> dict[str, Sequence[str]]:
    faults = Faults()
    data = faults.settle(parse(text, file, faults, json.loads))
    del text
    packers: dict[str, TextPacker] = {}
    count = 0
    for record in _records(data, {}, file):
        for name, value in record.items():
            if name not in packers:
                packers[name] = TextPacker()
                _within(file, len(packers), limits.MAX_COLUMNS, "columns", COLUMNS_REMEDY)
            packers[name].pad(count)
            packers[name].add(_text(value))
        count += 1
        if count > limits.MAX_ROWS or count * len(packers) > limits.MAX_CELLS:
            _within(file, count, min(limits.MAX_ROWS, limits.MAX_CELLS // len(packers)), "rows", SPLIT_REMEDY)
    if not packers:
        raise BadInput(
            f"{file}: holds no rows: write a list of objects such as " + '{"t": 0, "ball": "cue", "x": 0, "y": 0}'
        )
    for packer in packers.values():
        packer.pad(count)
    return {name: packer.texts() for name, packer in packers.items()}


def _within(file: str, count: int, most: int, what: str, remedy: str) -> None:
    """Raise BadInput if a file holds more than the limit."""
    if problem := excess(count, most, what, remedy):
        raise BadInput(f"{file}: {problem}")


def _records(data: Any, known: Mapping[str, Any], file: str) -> Iterator[dict[str, Any]]:
    """Rows of nested lists and objects: an inner one inherits the outer entries, and the key it is stored under."""
    if isinstance(data, list):
        for item in data:
            yield from _records(item, known, file)
        return
    if not isinstance(data, dict):
        return
    columns = {key: value for key, value in data.items() if isinstance(value, list) and _is_flat(value)}
    pairs = {key: columns.pop(key) for key in list(columns) if key.lower() in PLACE_NAMES and len(columns[key]) == 2}
    inner = {key: value for key, value in data.items() if isinstance(value, dict | list) and key not in columns}
    inner = {key: value for key, value in inner.items() if key not in pairs}
    own = {key: value for key, value in data.items() if not isinstance(value, dict | list)}
    own = {**known, **own, **{axis: v for pair in pairs.values() for axis, v in zip("xy", pair, strict=True)}}
    _within(file, len(own) + len(columns), limits.MAX_COLUMNS, "columns", COLUMNS_REMEDY)  # each row has them all
    if columns and len({len(column) for column in columns.values()}) == 1:
        for row in zip(*columns.values(), strict=True):
            yield {**own, **dict(zip(columns, row, strict=True))}
    elif not inner:
        yield dict(own)
    for key, value in inner.items():
        name = {} if key.lower() in GROUP_KEYS or "ball" in own else {"ball": key}
        yield from _records(value, {**own, **name}, file)


def _is_flat(values: list[Any]) -> bool:
    return bool(values) and not any(isinstance(value, dict | list) for value in values)


def _text(value: Any) -> str:
    """A cell as text; empty for no value."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return ""
    return repr(value) if isinstance(value, float) else str(value)


def numbers(found: TextColumns, name: str) -> list[float]:
    """A column as numbers, NaN where it is empty; BadInput names the row of a text."""
    cells, where = found.cells[name], f"{found.file}, column {shown(name)}"
    values = []
    for k, cell in enumerate(cells):
        try:
            values.append(float(cell) if cell and cell.lower() not in ("na", "none", "null") else math.nan)
        except ValueError:
            raise BadInput(f"{where}, row {found.line(k)}: {shown(cell)} is not a number: correct it") from None
    return values
