"""Files written whole or not at all, and lines added to one whole or not at all, at whatever byte a disk is full.

In: paths and their content. Out: files; BadInput in one line where one cannot be written, which then is as it was.
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
    """What is said of a place that cannot be written, with the remedy."""
    remedy = "make room on its disk, or choose another place" if error.errno in NO_ROOM else "choose another place"
    return BadInput(f"{path}: cannot be written ({error.strerror or error}); {remedy}")


def made_folder(path: Path | str) -> Path:
    """A folder for results, made with those above it where it is not there; BadInput where it cannot be."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from error
    return folder


def result_folder(path: Path | str) -> Path:
    """The same; that of a command's results (made.py) gets the record of their origin."""
    folder = made_folder(path)
    if origin := _expected(folder):
        record = {"format": MADE_FORMAT, **dataclasses.asdict(origin)}
        write_whole(folder / MADE_FILE, f"{json.dumps(record, indent=1)}\n".encode())
    return folder


def write_whole(path: Path | str, content: bytes, *, parents: bool = False) -> None:
    """Write a file by way of a scratch file beside it, which never stays behind.

    The result of a command (made.py) gets the record of its origin.

    Args:
        path: the file; one that is there is replaced.
        content: all of it.
        parents: make missing folders.

    Raises:
        BadInput: it cannot be written there, in one line.
    """
    path = Path(path)
    scratch = path.with_name(f".{path.name}.{os.getpid()}") if path.name else path
    try:
        if path.is_dir():
            raise BadInput(f"{path}: is a folder; name a file")
        if path.exists() and not path.is_file():  # a device would be replaced by a file
            raise BadInput(f"{path}: is no regular file; name another")
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        origin = _expected(path)
        scratch.write_bytes(content if origin is None else with_record(content, origin))
        scratch.replace(path)
    except OSError as error:
        raise unwritable(path, error) from error
    finally:
        with contextlib.suppress(OSError):  # where it was never made, or has taken its place
            scratch.unlink()


def _expected(path: Path) -> Origin | None:
    """The origin of what is written there, where it is a result of the command that runs."""
    known = expected.get()
    return known.get(Path(os.path.realpath(path))) if known else None


def append_whole(path: Path | str, content: bytes) -> None:
    """Add to the end of a file, which is made where it is not there; on the disk when this returns.

    Raises:
        BadInput: there is no room for all of it, or it cannot be written there; nothing was added.
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
    """Add to the end of an open file (its descriptor), all or nothing; OSError where there is no room."""
    size, left = os.fstat(file).st_size, content
    try:
        while left:
            left = left[os.write(file, left) :]
    except BaseException:
        with contextlib.suppress(OSError):  # of what is no regular file
            os.ftruncate(file, size)
        raise


@contextlib.contextmanager
def scratch_folder(prefix: str = "cuelab-") -> Iterator[Path]:
    """A folder for what is needed for a while only; BadInput where there is no room for temporary files."""
    try:
        made = tempfile.TemporaryDirectory(prefix=prefix, ignore_cleanup_errors=True)
    except OSError as error:
        place = os.environ.get("TMPDIR", "the usual folders")
        text = f"{place}: no room for temporary files; make some there, or set TMPDIR to another folder"
        raise BadInput(text) from error
    with made as folder:
        yield Path(folder)
