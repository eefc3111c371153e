"""Atomic writing of files, and of additional lines, even if the disk becomes full.

In: paths and their content. Out: files; BadInput in one line if one cannot be written, which is then unchanged.
"""

from __future__ import annotations

import contextlib
import dataclasses
import errno
import json
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from models.errors import BadInput
from models.files.record import Origin, expected, with_record

MADE_FORMAT, MADE_FILE = "billiard-made/1", "made.json"
NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


def unwritable(path: Path | str, error: OSError) -> BadInput:
    """The error for a place that cannot be written, with the remedy."""
    remedy = "make room on its disk, or choose another place" if error.errno in NO_ROOM else "choose another place"
    return BadInput(f"{path}: cannot be written ({error.strerror or error}); {remedy}")


def made_folder(path: Path | str) -> Path:
    """Create a folder for results, with those above it, if necessary; BadInput if that fails."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    return folder


def result_folder(path: Path | str) -> Path:
    """Create a folder; one for a command's results (made.py) gets a record of their origin."""
    folder = made_folder(path)
    if origin := _expected(folder):
        record = {"format": MADE_FORMAT, **dataclasses.asdict(origin)}
        write_whole(folder / MADE_FILE, f"{json.dumps(record, indent=1)}\n".encode())
    return folder


def write_whole(path: Path | str, content: bytes, *, parents: bool = False) -> None:
    """Write a file via a scratch file next to it, which is always removed.

    The result of a command (made.py) gets the record of its origin.

    Args:
        path: the file; an existing one is replaced.
        content: the complete content.
        parents: whether to create missing folders.

    Raises:
        BadInput: it cannot be written.
    """
    path = Path(path)
    scratch = path.with_name(f".{path.name}.{os.getpid()}") if path.name else path
    try:
        if path.is_dir():
            raise BadInput(f"{path}: is a folder; name a file")
        if path.exists() and not path.is_file():  # a file must not replace a device
            raise BadInput(f"{path}: is not a regular file; name another")
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        origin = _expected(path)
        scratch.write_bytes(content if origin is None else with_record(content, origin))
        scratch.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # it was never created, or has already replaced the file
            scratch.unlink()


def _expected(path: Path) -> Origin | None:
    """The origin of a file, if it is a result of the running command."""
    known = expected.get()
    return known.get(Path(os.path.realpath(path))) if known else None


def append_whole(path: Path | str, content: bytes) -> None:
    """Append to a file, which is created if necessary; the data are on the disk when this returns.

    Raises:
        BadInput: there is no room, or it cannot be written; nothing was added.
    """
    try:
        file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
    except OSError as error:
        raise unwritable(path, error) from error
    try:
        append_to(file, content)
        os.fsync(file)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        os.close(file)


def append_to(file: int, content: bytes) -> None:
    """Append to an open file by its descriptor, all or nothing; OSError if there is no room."""
    size, left = os.fstat(file).st_size, content
    try:
        while left:
            left = left[os.write(file, left) :]
    except BaseException:
        with contextlib.suppress(OSError):  # not a regular file
            os.ftruncate(file, size)
        raise


@contextlib.contextmanager
def scratch_folder() -> Iterator[Path]:
    """A temporary folder; BadInput if there is no room for temporary files."""
    try:
        made = tempfile.TemporaryDirectory(prefix="cuelab-", ignore_cleanup_errors=True)
    except OSError as error:
        place = os.environ.get("TMPDIR", "the usual folders")
        text = f"{place}: no room for temporary files; make room there, or set TMPDIR to another folder"
        raise BadInput(text) from error
    with made as folder:
        yield Path(folder)
