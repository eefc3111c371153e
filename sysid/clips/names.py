"""Names in a clip set: of its balls, its clips and their files.

In: texts. Out: what is wrong with them, with the remedy.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from models.files.limits import MAX_NAME_CHARS

CLIPS_TOML = "clips.toml"


def name_fault(name: str) -> str | None:
    """The reason why a name is not valid for a ball, with its remedy; "" if it is valid."""
    if not name:
        return "is empty: name the ball"
    if name != name.strip():
        return "starts or ends with a blank: remove it"
    if len(name) > MAX_NAME_CHARS:
        return f"has {len(name)} characters, the limit is {MAX_NAME_CHARS}: shorten it"
    if not name.isprintable():
        return "holds unprintable characters: name the ball with letters and digits"
    return None


def path_fault(file: str) -> str | None:
    """The reason why a text is not valid as a clip's file name, regardless of the disk; "" if it is valid."""
    if not file or not file.isprintable() or file != file.strip():
        return "is not a file name: name the clip's CSV, such as 'clips/0001.csv'"
    if "\\" in file:
        return "holds a backslash: separate folders by '/'"
    if file.startswith("/") or (len(file) > 1 and file[1] == ":"):
        return "is an absolute path: name it relative to the clip set's folder"
    if ".." in file.split("/"):
        return "leaves the clip set's folder: move the clip into the folder"
    if os.path.normpath(file) == CLIPS_TOML:
        return f"names {CLIPS_TOML} itself: name the clip's CSV"
    return None


def find_file(root: Path, file: str) -> Path | str:
    """The real path of a file inside `root` (itself a real path), or what is wrong with it."""
    try:
        real = Path(os.path.realpath(root / file, strict=True))
        if not real.is_relative_to(root):
            return "is a symbolic link that leaves the clip set's folder: put a copy into the folder"
        return real if stat.S_ISREG(real.stat().st_mode) else "is not a file: name the file itself"
    except FileNotFoundError:
        return "does not exist: put the file there"
    except OSError as error:
        return f"cannot be opened ({error.strerror}): make it a readable file"
    except ValueError:
        return "is not a file name: use letters and digits"
