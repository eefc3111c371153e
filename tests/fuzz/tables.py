"""Changes to tables: the columns and rows of CSV and Parquet files.

In: a table's head and rows. Out: a changed one, and its bytes, with what no writer would write.
"""

from __future__ import annotations

import contextlib
import csv
import io
import math
import random
from dataclasses import dataclass
from typing import Any

from tests.fuzz.trees import NUMBERS, number, word

MAX_REPEATED_CELLS = 1 << 20
NAN_WORDS = ("nan", "NaN", "inf", "-Infinity", "NA", "null", "", " ", "1_0", "0x1p3", "١", "1e999", "--1", "1,5")


@dataclass
class Table:
    """Cells by row; rows need not be of one length."""

    head: list[str]
    rows: list[list[str]]


def table_of(raw: bytes) -> Table:
    """The table of a sound CSV."""
    head, *rows = list(csv.reader(io.StringIO(raw.decode())))
    return Table(head, rows)


def changed(rng: random.Random, table: Table) -> Table:
    """A table with one to four changes."""
    found = Table(list(table.head), [list(row) for row in table.rows])
    for _ in range(rng.choice((1, 1, 2, 2, 3, 4))):
        kind = rng.choices(("cell", "column", "columns", "row", "order", "times", "names", "scale"),
                           (120, 80, 60, 48, 24, 32, 16, 3))[0]  # fmt: skip
        CHANGES[kind](rng, found)
        if kind == "scale":
            break
    return found


def cell(rng: random.Random, old: str) -> str:
    """Another cell in place of one."""
    try:
        value = float(old)
    except ValueError:
        return word(rng)
    kind = rng.random()
    if kind < 0.6:
        new = number(rng, value)
        return old if isinstance(new, int) and abs(new) > 10**400 else repr(new)
    return rng.choice(NAN_WORDS) if kind < 0.9 else word(rng)


def _cell(rng: random.Random, table: Table) -> None:
    for _ in range(rng.choice((1, 1, 3, 10))):
        row = rng.choice(table.rows or [table.head])
        if row:
            k = rng.randrange(len(row))
            row[k] = cell(rng, row[k])


def _column(rng: random.Random, table: Table) -> None:
    """Every cell of a column by one rule."""
    if not table.head:
        return
    k = rng.randrange(len(table.head))
    kind, scale, one = rng.randrange(6), 10.0 ** rng.randrange(-9, 300), cell(rng, "1")
    for row in table.rows:
        if k < len(row):
            try:
                value = float(row[k])
            except ValueError:
                value = math.nan
            row[k] = (one, repr(value * scale), repr(-value), repr(round(value, 1)), "", repr(value + scale))[kind]


def _columns(rng: random.Random, table: Table) -> None:
    """A column that is gone, doubled, renamed or elsewhere."""
    if not table.head:
        return
    k, kind = rng.randrange(len(table.head)), rng.randrange(5)
    other = rng.randrange(len(table.head))
    every = [table.head, *table.rows]
    for row in every:
        if max(k, other) >= len(row):
            continue
        if kind == 0:
            del row[k]
        elif kind == 1:
            row.insert(other, row[k])
        elif kind == 2:
            row[k], row[other] = row[other], row[k]
    if kind == 3:
        table.head[k] = word(rng)
    elif kind == 4:
        table.head[k] = rng.choice(
            (table.head[other], table.head[k].upper(), f" {table.head[k]}", f"{table.head[k]}_mm")
        )


def _row(rng: random.Random, table: Table) -> None:
    """A row that is gone, doubled, elsewhere, longer or shorter."""
    if not table.rows:
        return
    k, other, kind = rng.randrange(len(table.rows)), rng.randrange(len(table.rows)), rng.randrange(7)
    if kind == 0:
        del table.rows[k]
    elif kind == 1:
        table.rows.insert(other, list(table.rows[k]))
    elif kind == 2:
        table.rows[k], table.rows[other] = table.rows[other], table.rows[k]
    elif kind == 3:
        table.rows[k] = table.rows[k][: rng.randrange(len(table.rows[k]) + 1)]
    elif kind == 4:
        table.rows[k] = table.rows[k] + [word(rng)] * rng.choice((1, 2, 300))
    elif kind == 5:
        table.rows[k:] = []
    else:
        table.rows[:k] = []


def _order(rng: random.Random, table: Table) -> None:
    if rng.random() < 0.5:
        table.rows.reverse()
    else:
        rng.shuffle(table.rows)


def _times(rng: random.Random, table: Table) -> None:
    """The first column as times of another kind."""
    kind, step = rng.randrange(5), 10.0 ** rng.uniform(-12, 6)
    for k, row in enumerate(table.rows):
        if row:
            row[0] = (repr(k * step), "0", repr(step), repr(-k * step), repr(1e9 + k * step))[kind]


def _names(rng: random.Random, table: Table) -> None:
    """Texts that differ in every row, or in every other one."""
    if not table.head:
        return
    column, count = rng.randrange(len(table.head)), rng.choice((2, 10, 1000, 10**9))
    for k, row in enumerate(table.rows):
        if column < len(row):
            row[column] = f"{row[column]}{k % count}"


def _scale(rng: random.Random, table: Table) -> None:
    """Rows or columns many times; rows with times or names that go on, or the same."""
    cells = max(len(table.head) * len(table.rows), 1)
    times = min(round(10 ** rng.uniform(1, 5)), MAX_REPEATED_CELLS // cells + 1)
    if rng.random() < 0.4:
        kind = rng.randrange(3)
        table.head += [("a", f"a{k}", f"{k}_x")[kind] for k in range(times)]
        table.rows = [[*row, *[rng.choice(("", "0"))] * times] for row in table.rows]
        return
    kind, rows = rng.randrange(4), table.rows
    table.rows = [list(row) for _ in range(times) for row in rows]
    for k, row in enumerate(table.rows):
        if len(row) > 1 and kind:
            row[0] = repr(k * 1e-3)
            row[1] = f"{row[1]}{k}" if kind == 2 else row[1]


CHANGES = {
    "cell": _cell, "column": _column, "columns": _columns, "row": _row, "order": _order, "times": _times,
    "names": _names, "scale": _scale,
}  # fmt: skip


def csv_of(rng: random.Random, table: Table) -> bytes:
    """The bytes of a CSV, now and then with other separators, ends of lines, quotes or letters."""
    separator = rng.choice((*[","] * 12, ";", "\t", "|", " "))
    out = io.StringIO()
    quoting = rng.choice((*[csv.QUOTE_MINIMAL] * 8, csv.QUOTE_ALL, csv.QUOTE_NONE))
    if quoting == csv.QUOTE_NONE and [""] in [table.head, *table.rows]:  # which cannot be written so
        quoting = csv.QUOTE_MINIMAL
    writer = csv.writer(
        out,
        delimiter=separator,
        quoting=quoting,
        escapechar="\\",
        lineterminator=rng.choice((*["\n"] * 8, "\r\n", "\r")),
    )
    writer.writerows([table.head, *table.rows])
    text = out.getvalue()
    if rng.random() < 0.05:
        at = rng.randrange(len(text) + 1)
        text = (
            text[:at] + rng.choice(('"', "\0", "\n", '"\n"', "#", "\n" * 5000, '"' + "x" * 200_000, text)) + text[at:]
        )
    raw = text.encode(rng.choice((*["utf-8"] * 20, "utf-8-sig", "utf-16", "latin-1")), "replace")
    return raw[: rng.randrange(len(raw) + 1)] if rng.random() < 0.03 else raw


def parquet_of(rng: random.Random, table: Table) -> bytes:
    """A Parquet file of a table, its columns of many types; now and then bytes of it are changed."""
    import pyarrow as pa
    import pyarrow.parquet

    names = [name.encode("utf-8", "replace").decode() or f"c{k}" for k, name in enumerate(table.head)]
    width = len(names)
    rows = [[*row, *[""] * width][:width] for row in table.rows]
    columns = {}
    for k, name in enumerate(names[:3000]):
        columns[name] = _parquet_column(rng, pa, [row[k] for row in rows])
    sink = pa.BufferOutputStream()
    found = pa.table(columns)
    if rng.random() < 0.02:  # one text or number in very many rows takes hardly any room
        times = round(10 ** rng.uniform(1, 4))
        found = pa.concat_tables([found] * min(times, 3_000_000 // max(found.num_rows * max(width, 1), 1) + 1))
    least = max(7, found.num_rows // 1000)
    with contextlib.suppress(pa.ArrowException):  # of types that Parquet does not hold: what was written until then
        pa.parquet.write_table(
            found, sink, compression=rng.choice(("none", "snappy", "zstd", "gzip")),
            use_dictionary=True if found.nbytes > 1 << 24 else rng.random() < 0.7, dictionary_pagesize_limit=1 << 28,
            row_group_size=rng.choice((least, 100_000, None)), store_schema=rng.random() < 0.5,
        )  # fmt: skip
    raw = bytearray(sink.getvalue()) or bytearray(b"PAR1")
    if rng.random() < 0.3:
        for _ in range(rng.choice((1, 2, 20))):
            at = rng.randrange(len(raw)) if rng.random() < 0.4 else max(0, len(raw) - 1 - int(rng.expovariate(0.01)))
            raw[at] = rng.randrange(256)
    if rng.random() < 0.05:
        del raw[rng.randrange(len(raw)) :]
    return bytes(raw)


def _parquet_column(rng: random.Random, pa: Any, cells: list[str]) -> Any:
    try:
        values: list[Any] = [float(c) if c else None for c in cells]
    except ValueError:
        values = list(cells)
    kind = rng.randrange(14)
    text = [c.encode("utf-8", "replace").decode() for c in cells]
    try:
        if kind == 0:
            return pa.array(text)
        if kind == 1:
            return pa.array(text).dictionary_encode()
        if kind == 2:
            return pa.array([[v] * rng.randrange(3) for v in values])
        if kind == 3:
            return pa.array([{"a": v} for v in values])
        if kind == 4:
            return pa.array([rng.choice((None, True, False)) for _ in values])
        if kind == 5:
            return pa.array([int(v * 1e6) for v in values], pa.timestamp(rng.choice(("s", "ms", "us", "ns"))))
        if kind == 6:
            return pa.array(
                [word(rng)[:9].encode("utf-8", "replace") for _ in values], rng.choice((pa.binary(), pa.large_binary()))
            )
        if kind == 7:
            return pa.array([rng.choice(NUMBERS[:16]) * 1.0 for _ in values])
        if kind == 8:
            return pa.nulls(len(values))
        if kind == 9:
            long = "z" * min(round(10 ** rng.uniform(1, 6.3)), (1 << 28) // max(len(cells), 1))
            return pa.DictionaryArray.from_arrays(pa.array([0] * len(values), pa.int32()), pa.array([long]))
        if kind == 10:
            return pa.array(
                [int(v) for v in values], rng.choice((pa.int8(), pa.uint64(), pa.int32(), pa.decimal128(20)))
            )
        return pa.array(values)
    except (pa.ArrowException, TypeError, ValueError, OverflowError):
        return pa.array(text)
