"""Files: TOML read, and anything written whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tomllib
from pathlib import Path
from typing import Any

from models.errors import BadInput


def read_toml(path: Path | str, missing: str, wrong: str) -> dict[str, Any]:
    """What a TOML file holds; BadInput with a remedy where it is `missing` or `wrong`, in one line."""
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInput(f"{path}: {error.strerror}; {missing}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: is not TOML ({error}); {wrong}") from None


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
