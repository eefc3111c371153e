"""Files that are written whole or not at all."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from models.errors import BadInput


def write_whole(path: Path | str, content: bytes, *, parents: bool = False) -> None:
    """Write a file by way of a scratch file beside it, which never stays behind.

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
            raise BadInput(" ".join(f"{path}: is a folder; name a file".split()))
        if parents:
            path.parent.mkdir(parents=True, exist_ok=True)
        scratch.write_bytes(content)
        scratch.replace(path)
    except OSError as error:
        text = f"{path}: cannot be written ({error.strerror}); choose another place"
        raise BadInput(" ".join(text.split())) from error
    finally:
        with contextlib.suppress(OSError):  # where it was never made, or has taken its place
            scratch.unlink()
