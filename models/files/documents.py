"""Files of TOML, JSON and text, read within bounds and decoded."""

from __future__ import annotations

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
from models.files.decode import Place, decode, of_format
from models.files.faults import Faults, one_line, shown

Kind = TypeVar("Kind")
MAX_FILE_BYTES = 32 << 20  # of TOML and JSON
MAX_PICTURE_PIXELS = 1 << 26  # of a picture or a film: twice those of 8K video
MAX_DEPTH = 32  # of tables and lists in each other


def read_toml(path: Path | str, kind: type[Kind], form: str, remedy: str, *, more: bool = False) -> Kind:
    """The value of a TOML file.

    Args:
        path: the file.
        kind: the dataclass whose fields are its keys (models/files/decode.py).
        form: its format; "" for files that name none.
        remedy: what to do where there is no such file.
        more: unknown keys are left alone, unless they are slips.

    Raises:
        BadInput: its first fault, in one line; the others are notes of the exception.
    """
    faults = Faults()
    place = Place(str(path), faults)
    data = read_document(path, str(path), faults, remedy)
    body = data if data is None or not form else of_format(data, form, kind, place)
    return faults.settle(None if body is None else decode(kind, body, place, {} if more else None))


def read_json(path: Path | str, form: str, remedy: str) -> dict[str, Any]:
    """The object of a JSON file that a program here wrote; BadInput with the remedy where it is not of that format."""
    faults = Faults()
    data = read_document(path, str(path), faults, remedy, json.loads)
    if data is not None and not (isinstance(data, dict) and data.get("format") == form):
        found = data.get("format") if isinstance(data, dict) else type(data).__name__
        faults.add(str(path), f"format is {shown(found)}, this version reads {form}; {remedy}")
    return dict(faults.settle(data))


@contextlib.contextmanager
def entries_of(path: Path | str, remedy: str) -> Iterator[None]:
    """BadInput where an entry of a file that a program here wrote is missing, or of another kind."""
    try:
        yield
    except BadInput:
        raise
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        kind = "lacks" if isinstance(error, KeyError) else "has a wrong entry:"
        raise BadInput(one_line(f"{path}: {kind} {error}; {remedy}")) from error


def read_document(
    path: Path | str, file: str, faults: Faults, remedy: str, loads: Callable[[str], Any] = tomllib.loads
) -> Any:
    """What a TOML or JSON file holds; None, with the fault noted under `file`, where it cannot be read."""
    text = read_text(path, file, faults, remedy)
    return None if text is None else parse(text, file, faults, loads)


def parse(text: str, file: str, faults: Faults, loads: Callable[[str], Any] = tomllib.loads) -> Any:
    """What a TOML or JSON text holds; None, with the fault noted, for a faulty or an absurd one."""
    language = "TOML" if loads is tomllib.loads else "JSON"
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
    if _depth(data) > MAX_DEPTH:
        faults.add(file, f"has tables or brackets more than {MAX_DEPTH} deep: correct the {language}")
        return None
    return data


def _depth(data: Any) -> int:
    """How deep tables and lists lie in each other."""
    depth, level = 0, [data]
    while level := [v for v in level if isinstance(v, dict | list)]:
        depth += 1
        level = [inner for v in level for inner in (v.values() if isinstance(v, dict) else v)]
    return depth


def read_text(path: Path | str, file: str, faults: Faults, remedy: str, most: int = MAX_FILE_BYTES) -> str | None:
    """The text of a file of `most` bytes at most; None, with the fault noted under `file`, where it has none."""
    try:
        status = os.stat(path)
        if not stat.S_ISREG(status.st_mode) or status.st_size > most:
            problem = f"has more than {most >> 20} MB" if stat.S_ISREG(status.st_mode) else "is not a file"
            faults.add(file, f"cannot be read ({problem}): {remedy}")
            return None
        data = Path(path).read_bytes()
    except (OSError, ValueError) as error:
        faults.add(file, f"cannot be read ({getattr(error, 'strerror', None) or 'not a file name'}): {remedy}")
        return None
    try:
        return data.decode("utf-8-sig")  # spreadsheets write a byte-order mark
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        faults.add(file, f"byte {data[error.start]:#04x} is not UTF-8 text: save the file as UTF-8", row)
        return None
