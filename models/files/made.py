"""Protection of results: only the command and input that made a result may replace it.

In: a command's output path, and its `Origin`. Out: an error in one line, before the work; otherwise the written files
store their origin: a file in a record within it (record.py), a folder in its made.json. Files without such a record may
be somebody's work. Verbs with their own rules for existing files (`track`, `study`, `learn`) need none.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from models.errors import BadInput
from models.files.documents import read_json
from models.files.record import DIGEST_CHARS, Origin, expected, origin_of
from models.files.writing import MADE_FILE, MADE_FORMAT

OVERWRITE_REMEDY = "name another, or replace it with --overwrite"
CHUNK_BYTES = 1 << 20


def digest(values: Iterable[object]) -> str:
    """A digest of values; files and folders count by their content, not by their place."""
    seen = hashlib.sha256()
    for value in values:
        try:
            _add(seen, value)
        except (OSError, ValueError):  # an invalid file name, which the command itself reports
            seen.update(f"{value!r}\0".encode())
    return seen.hexdigest()[:DIGEST_CHARS]


def _add(seen: hashlib._Hash, value: object) -> None:
    if isinstance(value, list | tuple):
        for item in value:
            _add(seen, item)
    elif isinstance(value, Path) and value.is_dir():
        for file in sorted(value.rglob("*")):
            if file.is_file():
                seen.update(repr(file.relative_to(value)).encode())
                _add(seen, file)
    elif isinstance(value, Path) and value.is_file():
        with contextlib.suppress(OSError), value.open("rb") as content:  # the command itself reports errors
            while part := content.read(CHUNK_BYTES):
                seen.update(part)
    else:
        seen.update(f"{value!r}\0".encode())


@contextlib.contextmanager
def marked(origin: Origin, paths: Sequence[Path]) -> Iterator[None]:
    """Within this context files and folders written at these paths store their origin."""
    token = expected.set({**(expected.get() or {}), **{Path(os.path.realpath(path)): origin for path in paths}})
    try:
        yield
    finally:
        expected.reset(token)


@contextlib.contextmanager
def without_lone_record(folders: Sequence[Path]) -> Iterator[None]:
    """Within this context a failing command leaves no record in folders where it wrote nothing."""
    try:
        yield
    except BaseException:
        for folder in folders:
            with contextlib.suppress(OSError):
                if [file.name for file in folder.iterdir() if not file.name.startswith(".")] == [MADE_FILE]:
                    (folder / MADE_FILE).unlink()
        raise


def check_file(path: Path, origin: Origin) -> None:
    """Raise BadInput if a file exists that another command or input made, or that was changed since."""
    if not path.is_file():
        return
    with contextlib.suppress(OSError):
        if origin_of(path.read_bytes()) == origin:
            return
    raise BadInput(f"{path}: already exists and was not made by this command from the same input; {OVERWRITE_REMEDY}")


def check_folder(folder: Path, writes: Sequence[str], origin: Origin) -> None:
    """The same check for a folder that contains any of the files, by patterns, to be written."""
    there = next((file for pattern in writes for file in sorted(folder.glob(pattern))), None)
    if there is None:
        return
    with contextlib.suppress(BadInput):
        found = read_json(folder / MADE_FILE, MADE_FORMAT, "")
        if (found.get("command"), found.get("inputs")) == (origin.command, origin.inputs):
            return
    text = f"{folder}: holds {there.name}, which was not made by this command from the same input; {OVERWRITE_REMEDY}"
    raise BadInput(text)
