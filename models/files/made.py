"""Results are not lost: one that is there is replaced by the command and the input that made it, or not at all.

In: where a command is to write, and its `Origin`. Out: a refusal in one line, before the work; else what is written
there tells its origin: a file by a record within it (record.py), a folder by its made.json. What has no such record may
be somebody's work. Verbs that continue or refuse by their own rules (`track`, `study`, `learn`) need none.
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

REMEDY = "name another, or replace it with --overwrite"
CHUNK_BYTES = 1 << 20


def digest(values: Iterable[object]) -> str:
    """A digest of values; files and folders count by what they hold, wherever they are."""
    seen = hashlib.sha256()
    for value in values:
        try:
            _add(seen, value)
        except (OSError, ValueError):  # no file name: the command itself will tell
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
        with contextlib.suppress(OSError), value.open("rb") as content:  # the command itself will tell
            while part := content.read(CHUNK_BYTES):
                seen.update(part)
    else:
        seen.update(f"{value!r}\0".encode())


@contextlib.contextmanager
def marked(origin: Origin, paths: Sequence[Path]) -> Iterator[None]:
    """Files and folders of these paths that are written inside tell their origin."""
    token = expected.set({**(expected.get() or {}), **{Path(os.path.realpath(path)): origin for path in paths}})
    try:
        yield
    finally:
        expected.reset(token)


@contextlib.contextmanager
def without_lone_record(folders: Sequence[Path]) -> Iterator[None]:
    """Folders in which a command that fails inside has written nothing keep no record of its origin either."""
    try:
        yield
    except BaseException:
        for folder in folders:
            with contextlib.suppress(OSError):
                if [file.name for file in folder.iterdir() if not file.name.startswith(".")] == [MADE_FILE]:
                    (folder / MADE_FILE).unlink()
        raise


def check_file(path: Path, origin: Origin) -> None:
    """BadInput where a file is there that another command, or other input, has made, or that was changed since."""
    if not path.is_file():
        return
    with contextlib.suppress(OSError):
        if origin_of(path.read_bytes()) == origin:
            return
    raise BadInput(f"{path}: already exists and was not made by this command from the same input; {REMEDY}")


def check_folder(folder: Path, writes: Sequence[str], origin: Origin) -> None:
    """The same of a folder that holds any of the files, by patterns, that would be written."""
    there = next((file for pattern in writes for file in sorted(folder.glob(pattern))), None)
    if there is None:
        return
    with contextlib.suppress(BadInput):
        found = read_json(folder / MADE_FILE, MADE_FORMAT, "")
        if (found.get("command"), found.get("inputs")) == (origin.command, origin.inputs):
            return
    text = f"{folder}: holds {there.name}, not made by this command from the same input; {REMEDY}"
    raise BadInput(text)
