"""A disk with so much room: a file system of its own in memory, or a limit on the size of files.

In: a folder and the room [bytes]. A file system fills up as a real disk does, by pages, with ENOSPC, but only who may
mount has one. A limit on files stops a writer at any byte of a file, with EFBIG, and needs no right.
"""

from __future__ import annotations

import contextlib
import os
import resource
import subprocess
from collections.abc import Iterator
from pathlib import Path

PAGE_BYTES = os.sysconf("SC_PAGE_SIZE")
ROOMY_BYTES = 1 << 30


def can_mount() -> bool:
    """Whether this process may mount a file system."""
    import tempfile

    with tempfile.TemporaryDirectory(prefix="cuelab-disk-") as place:
        folder = Path(place, "disk")
        folder.mkdir()
        if not _mount(folder, f"size={ROOMY_BYTES}"):
            return False
        _unmount(folder)
    return True


@contextlib.contextmanager
def disk(folder: Path, *, mounted: bool) -> Iterator[None]:
    """An empty disk at a folder, which is made; an ordinary folder where it is not `mounted`."""
    folder.mkdir(parents=True)
    if mounted and not _mount(folder, f"size={ROOMY_BYTES}"):
        raise OSError(f"{folder}: cannot be mounted")
    try:
        yield
    finally:
        if mounted:
            _unmount(folder)


def used(folder: Path) -> int:
    """Bytes taken on the disk of a folder."""
    found = os.statvfs(folder)
    return (found.f_blocks - found.f_bfree) * found.f_frsize


def leave_room(folder: Path, room: int | None) -> None:
    """Let a mounted disk have so many more bytes, in whole pages; None: plenty."""
    size = ROOMY_BYTES if room is None else used(folder) + max(room // PAGE_BYTES, 0) * PAGE_BYTES
    if not _mount(folder, f"remount,size={max(size, PAGE_BYTES)}"):
        raise OSError(f"{folder}: cannot be mounted again with {size} bytes")


def limit_files(most: int) -> None:
    """Let no file of this process grow beyond so many bytes; Python leaves the signal alone."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


def _mount(folder: Path, options: str) -> bool:
    words = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(folder)]
    try:
        return subprocess.run(words, capture_output=True, check=False).returncode == 0
    except OSError:  # no such program
        return False


def _unmount(folder: Path) -> None:
    subprocess.run(["umount", "--lazy", str(folder)], capture_output=True, check=True)
