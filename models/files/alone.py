"""A lock that allows one run at a time in a place, and ends with its process in any case."""

from __future__ import annotations

import contextlib
import fcntl
import os
from collections.abc import Iterator
from pathlib import Path

from models.errors import BadInput
from models.files.writing import unwritable


@contextlib.contextmanager
def alone_in(path: Path | str) -> Iterator[None]:
    """Lock a folder, or file, against other runs; it need not exist yet.

    The lock is an empty hidden file next to it, which is removed at the end. Runs on other computers that share a disk
    may not see it.

    Raises:
        BadInput: another run holds it, or it is the root.
    """
    target = Path(os.path.realpath(path))
    if not target.name:
        raise BadInput(f"{path}: is the root folder; name a folder in it")
    lock = target.with_name(f".{target.name}.lock")
    made = [parent for parent in lock.parents if not parent.exists()]
    try:
        lock.parent.mkdir(parents=True, exist_ok=True)
        held = _open(lock, target)
    except OSError as error:
        raise unwritable(path, error) from error
    if held is None:
        raise BadInput(f"{path}: another run is writing there; wait until it ends, or choose another place")
    try:
        yield
    finally:
        with contextlib.suppress(OSError):
            lock.unlink()
        os.close(held)
        with contextlib.suppress(OSError):  # where something was written
            for parent in made:
                parent.rmdir()


def _open(lock: Path, target: Path) -> int | None:
    """The lock's descriptor; None if another process holds it."""
    while True:
        try:
            held = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o644)
        except PermissionError:
            held = os.open(target, os.O_RDONLY)  # no file can be created next to it, but a folder itself can be locked
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(held)
            return None
        except BaseException:
            os.close(held)
            raise
        if os.fstat(held).st_nlink:
            return held
        os.close(held)  # removed by a run that has just ended
