"""TOML, JSON and text files, read within limits and decoded."""

from __future__ import annotations

import codecs
import contextlib
import json
import os
import re
import stat
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from models.errors import BadInput
from models.files import limits
from models.files.decode import decode, of_format
from models.files.faults import Faults, shown
from models.files.limits import excess
from models.files.place import Place

Kind = TypeVar("Kind")
FILE_KINDS = (  # where, the bytes there, and what such a file is
    (0, b"\x89PNG", "a PNG picture"), (0, b"\xff\xd8\xff", "a JPEG picture"), (0, b"GIF8", "a GIF picture"),
    (0, b"%PDF", "a PDF document"), (0, b"PK\x03\x04", "a ZIP archive, as spreadsheets (.xlsx, .ods) are"),
    (0, b"\x1f\x8b", "a gzip archive"), (0, b"PAR1", "a Parquet file"), (0, b"RIFF", "an AVI film or WebP picture"),
    (4, b"ftyp", "an MP4 film or HEIC picture"), (0, b"\x1aE\xdf\xa3", "a Matroska film"),
)  # fmt: skip
# A dotted key with more parts than the nesting limit of tables: TOML parsers take quadratic time.
LONG_KEY = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++[ \t]*+\.[ \t]*+){N}""".replace("N", str(limits.MAX_DEPTH)))


def read_toml(path: Path | str, kind: type[Kind], form: str, remedy: str, *, more: bool = False) -> Kind:
    """The value of a TOML file.

    Args:
        path: the file.
        kind: the dataclass whose fields are its keys (models/files/decode.py).
        form: its format; "" for files without one.
        remedy: remedy if there is no such file.
        more: whether unknown keys are allowed, unless they are misspelt known ones.

    Raises:
        BadInput: its first fault, in one line; the others are notes of the exception.
    """
    faults = Faults()
    place = Place(str(path), faults)
    data = read_document(path, str(path), faults, remedy)
    body = data if data is None or not form else of_format(data, form, kind, place)
    return faults.settle(None if body is None else decode(kind, body, place, {} if more else None))


def read_json(path: Path | str, form: str, remedy: str) -> dict[str, Any]:
    """The object in a JSON file written by this project; BadInput with the remedy if its format differs."""
    faults = Faults()
    data = read_document(path, str(path), faults, remedy, json.loads)
    if data is not None and not (isinstance(data, dict) and data.get("format") == form):
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        faults.add(str(path), f"format is {shown(found)}, this version reads {form}; {remedy}")
    return dict(faults.settle(data))


@contextlib.contextmanager
def entries_of(path: Path | str, remedy: str) -> Iterator[None]:
    """Within this context missing or wrong entries of a file written by this project raise BadInput."""
    try:
        yield
    except BadInput:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        kind = "lacks" if isinstance(error, KeyError) else "has a wrong entry:"
        raise BadInput(f"{path}: {kind} {error}; {remedy}") from error


def encoding_of(data: bytes) -> str:
    """The encoding of a text by its beginning: UTF-16 if it has that byte-order mark, else UTF-8."""
    return "utf-16" if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)) else "utf-8-sig"


def kind_of(data: bytes) -> str:
    """The kind of a non-text file, by its first bytes; "" if unknown."""
    return next((kind for at, mark, kind in FILE_KINDS if data[at : at + len(mark)] == mark), "")


def read_document(
    path: Path | str, file: str, faults: Faults, remedy: str, loads: Callable[[str], Any] = tomllib.loads
) -> Any:
    """The content of a TOML or JSON file; None, with the fault noted under `file`, if it cannot be read."""
    most = limits.MAX_TOML_BYTES if loads is tomllib.loads else limits.MAX_JSON_BYTES
    text = read_text(path, file, faults, remedy, most)
    return None if text is None else parse(text, file, faults, loads)


def parse(text: str, file: str, faults: Faults, loads: Callable[[str], Any] = tomllib.loads) -> Any:
    """The content of a TOML or JSON text; None, with the fault noted, if it is faulty or too large."""
    language = "TOML" if loads is tomllib.loads else "JSON"
    if problem := _too_much(text, language):
        faults.add(file, problem)
        return None
    try:
        data = loads(text)
    except (tomllib.TOMLDecodeError, json.JSONDecodeError) as error:
        found = re.search(r" \(at line (\d+), (column \d+)\)$|: line (\d+) (column \d+) \(char \d+\)$", str(error))
        line, column = (found[1] or found[3], found[2] or found[4]) if found else (None, "the end")
        problem = str(error)[: found.start() if found else None].removesuffix(" (at end of document)")
        row = None if line is None else int(line)
        faults.add(file, f"is not {language} ({problem} at {column}): correct that line", row)
        return None
    except (ValueError, RecursionError):  # dates that do not exist, endless digits, a thousand brackets
        faults.add(file, f"holds a value that cannot be read: correct the {language}")
        return None
    if _depth(data) > limits.MAX_DEPTH:
        faults.add(file, f"has tables or brackets more than {limits.MAX_DEPTH} deep: correct the {language}")
        return None
    return data


def _too_much(text: str, language: str) -> str:
    """The limit that a text exceeds, as a fault; "" for none."""
    if language == "TOML" and (found := LONG_KEY.search(text)):
        line = text.count("\n", 0, found.start()) + 1
        return f"has a key of more than {limits.MAX_DEPTH} parts in line {line}: correct the TOML"
    remedy = "write fewer, or tables of numbers as CSV"
    containers, values = text.count("{") + text.count("["), text.count(",") + text.count("=") * (language == "TOML")
    problem = excess(containers, limits.MAX_CONTAINERS, "brackets", remedy)
    return problem or excess(values, limits.MAX_VALUES, "values", remedy)


def _depth(data: Any) -> int:
    """The nesting depth of tables and lists."""
    depth, level = 0, [data]
    while level := [v for v in level if isinstance(v, dict | list)]:
        depth += 1
        level = [inner for v in level for inner in (v.values() if isinstance(v, dict) else v)]
    return depth


def file_problem(path: Path | str, remedy: str, most: int) -> str:
    """The reason why a file of at most `most` bytes cannot be read; "" if it can."""
    try:
        status = os.stat(path)
    except (OSError, ValueError) as error:
        return f"cannot be read ({getattr(error, 'strerror', None) or 'not a file name'}): {remedy}"
    if not stat.S_ISREG(status.st_mode):
        return f"cannot be read (is not a file): {remedy}"
    return excess(status.st_size, most, "MB", f"such a file is smaller; {remedy}", 1 << 20)


def read_text(
    path: Path | str, file: str, faults: Faults, remedy: str, most: int = limits.MAX_TEXT_BYTES
) -> str | None:
    """The text of a file of at most `most` bytes; None, with the fault noted under `file`, if it is not text."""
    if problem := file_problem(path, remedy, most):
        faults.add(file, problem)
        return None
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        faults.add(file, f"cannot be read ({error.strerror}): {remedy}")
        return None
    if kind := kind_of(data):
        faults.add(file, f"is {kind}: {remedy}")
        return None
    encoding = encoding_of(data)
    try:
        return data.decode(encoding)
    except UnicodeDecodeError as error:
        if encoding == "utf-16":
            faults.add(file, "begins as UTF-16 text, but is not: save the file as UTF-8")
            return None
        row = data[: error.start].count(b"\n") + 1
        faults.add(file, f"byte {data[error.start]:#04x} is not UTF-8 text: save the file as UTF-8", row)
        return None
