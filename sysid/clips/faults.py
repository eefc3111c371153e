"""Faults of a clip set: one line per fault, naming the file, the row, the value and the remedy.

In: texts and values. Out: `Faults`, and the parts of their messages.
"""

from __future__ import annotations

import difflib
import os
import stat
from collections.abc import Iterable
from pathlib import Path

CLIPS_TOML = "clips.toml"
MAX_LINE_CHARS = 400  # of a message: a damaged file must not flood the screen
MAX_VALUE_CHARS = 60  # of a value in a message


class Faults:
    """Collects faults, so that one reading can name them all; those of one file come in the order of its rows."""

    def __init__(self) -> None:
        self._found: dict[str, list[tuple[float, str]]] = {}

    def __len__(self) -> int:
        return sum(len(found) for found in self._found.values())

    def add(self, file: str, text: str, row: int | None = None) -> None:
        """Add one fault; `row` is the line number in the file, from 1."""
        where = "" if row is None else f", {'line' if file == CLIPS_TOML else 'row'} {row}"
        # Faults of a whole file come last: they often follow from those of its rows.
        self._found.setdefault(file, []).append((float("inf") if row is None else row, f"{file}{where}: {text}"))

    def lines(self, per_file: int | None = None) -> list[str]:
        """All faults, one line each; with `per_file`, at most so many of a file and how many more there are."""
        lines = []
        for file, found in self._found.items():
            ordered = sorted(found, key=lambda fault: fault[0])
            lines += [one_line(text) for _, text in ordered[:per_file]]
            if per_file is not None and len(ordered) > per_file:
                lines.append(one_line(f"{file}: {len(ordered) - per_file} more faults: correct those above first"))
        return lines


def one_line(text: str) -> str:
    """The text without line breaks or other unprintable characters, not too long."""
    line = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    return line if len(line) <= MAX_LINE_CHARS else line[: MAX_LINE_CHARS - 4] + " ..."


def shown(value: object) -> str:
    """A value as a message shows it: quoted text, numbers as they are, shortened."""
    try:
        text = repr(value)
    except ValueError:  # an integer of thousands of digits
        text = "a number too long to show"
    return text if len(text) <= MAX_VALUE_CHARS else text[: MAX_VALUE_CHARS - 4] + " ..."


def listed(names: Iterable[str]) -> str:
    """Names for a message, quoted, the first few."""
    quoted = [shown(name) for name in names]
    return ", ".join(quoted[:8]) + (f" and {len(quoted) - 8} more" if len(quoted) > 8 else "")


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name that `name` is probably a slip of."""
    by_lower = {k.lower(): k for k in known}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.75)
    return by_lower[found[0]] if found else None


def name_fault(name: str) -> str | None:
    """Why a ball may not have this name."""
    if not name:
        return "is empty: name the ball"
    if name != name.strip():
        return "starts or ends with a blank: remove it"
    if not name.isprintable():
        return "holds unprintable characters: name the ball with letters and digits"
    return None


def path_fault(file: str) -> str | None:
    """Why this may not name a clip of a set, whatever is on the disk."""
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


def read_text(path: Path, file: str, faults: Faults) -> str | None:
    """The text of a file that is there; None, with the fault noted, where it has none."""
    try:
        data = path.read_bytes()
    except OSError as error:
        faults.add(file, f"cannot be read ({error.strerror}): make it a readable file")
        return None
    try:
        text = data.decode("utf-8-sig")  # spreadsheets write a byte-order mark
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        faults.add(file, f"byte {data[error.start]:#04x} is not UTF-8 text: save the file as UTF-8", row)
        return None
    if not text.strip():
        faults.add(file, "is empty: record it again or take it from a backup")
        return None
    return text
