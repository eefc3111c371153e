"""CSV files, read row by row within the limits of models/files/limits.py.

In: a file. Out: its rows in order, with the line at which each begins; faults in `Faults`.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from pathlib import Path
from typing import TextIO

from models.files import limits
from models.files.documents import encoding_of, file_problem, kind_of
from models.files.faults import Faults
from models.files.limits import excess

KIND_BYTES = 16  # first bytes, which identify a file's kind
SPLIT_REMEDY = "split it into shots of one strike each"
COLUMNS_REMEDY = "keep only the columns that are needed"


def csv_rows(
    path: Path | str, file: str, faults: Faults, remedy: str, *, separators: str = ",", remarks: bool = False
) -> Iterator[tuple[int, list[str]]]:
    """Yield the non-empty rows of a CSV file, each with the number of its first line.

    Args:
        path: the file.
        file: its name in messages.
        faults: receives its faults.
        remedy: remedy if it cannot be read.
        separators: of columns; the one most frequent in the first row is used.
        remarks: whether lines before the first row that begin with # are skipped.

    Raises:
        BadInput: there is a fault, which is in `faults`.
    """
    problem, row = file_problem(path, remedy, limits.MAX_TABLE_BYTES), None
    if not problem:
        try:
            with Path(path).open("rb") as raw:
                begin = raw.read(KIND_BYTES)
            if kind := kind_of(begin):
                raise _UnfitTable(f"is {kind}: {remedy}", None)
            # Spreadsheets write a byte-order mark, or UTF-16.
            with Path(path).open(encoding=encoding_of(begin), newline="") as text:
                yield from _Reading(text, separators, remarks).rows()
            return
        except _UnfitTable as unfit:
            problem, row = unfit.args
        except UnicodeError as error:
            problem, row = "begins as UTF-16 text, but is not: save the file as UTF-8", None
            if isinstance(error, UnicodeDecodeError) and error.encoding.startswith("utf-8"):
                byte = f"byte {error.object[error.start]:#04x}"
                problem, row = f"{byte} is not UTF-8 text: save the file as UTF-8", _row(path)
        except OSError as error:
            problem = f"cannot be read ({error.strerror}): {remedy}"
    faults.add(file, problem, row)
    faults.settle(None)


def _row(path: Path | str) -> int | None:
    """The number of the first line that is not UTF-8."""
    with Path(path).open("rb") as raw:
        for number, line in enumerate(iter(lambda: raw.readline(limits.MAX_LINE_CHARS), b""), 1):
            try:
                line.decode()
            except UnicodeDecodeError:
                return number
    return None


class _UnfitTable(ValueError):
    """A fault of a file, with its line."""


class _Reading:
    """A reader of one file."""

    def __init__(self, text: TextIO, separators: str, remarks: bool) -> None:
        self._text, self._separators, self._remarks = text, separators, remarks
        self._line = self._start = 0  # numbers of the last line read, and of the one before the row

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        """Yield all non-empty rows; _UnfitTable if there are none, or too many."""
        first = self._first()
        separator = max(self._separators, key=first.count)
        count = cells = 0
        try:
            for row in csv.reader(self._lines(first), delimiter=separator, strict=True):
                start, self._start = self._start + 1, self._line
                if not row:
                    continue
                count, cells = count + 1, cells + len(row)
                if len(row) > limits.MAX_COLUMNS:
                    raise _UnfitTable(excess(len(row), limits.MAX_COLUMNS, "columns", COLUMNS_REMEDY), start)
                if count > limits.MAX_ROWS + 1 or cells > limits.MAX_CELLS:
                    most, what = (limits.MAX_ROWS, "rows") if count > limits.MAX_ROWS else (limits.MAX_CELLS, "cells")
                    raise _UnfitTable(f"has more than {most} {what}: {SPLIT_REMEDY}", start)
                yield start, row
        except csv.Error as error:
            raise _UnfitTable(f"is not CSV ({error}): correct the quotes", max(self._line, 1)) from error

    def _next(self) -> str:
        line = self._text.readline(limits.MAX_LINE_CHARS + 1)
        self._line += bool(line)
        if len(line) > limits.MAX_LINE_CHARS:
            what = f"characters in one line, {line.count(',')} commas among them"
            raise _UnfitTable(f"has more than {limits.MAX_LINE_CHARS} {what}: write a line for each row", self._line)
        return line

    def _first(self) -> str:
        """The first line of a row."""
        while line := self._next():
            if not line.strip() or (self._remarks and line.startswith("#")):
                self._start = self._line
            else:
                break
        return line

    def _lines(self, line: str) -> Iterator[str]:
        while line:
            if self._line - self._start > limits.MAX_CELL_LINES:  # within quotes
                raise _UnfitTable(
                    f"has a row of more than {limits.MAX_CELL_LINES} lines: correct the quotes", self._line
                )
            yield line
            line = self._next()
