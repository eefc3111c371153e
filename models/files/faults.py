"""Faults of user input: one line each, with the file, the place, the value and the remedy.

In: texts and values. Out: `Faults`, and the parts of their messages.
"""

from __future__ import annotations

import difflib
import reprlib
from collections.abc import Iterable, Sequence
from typing import Any, TypeVar

from models.errors import BadInput, one_line
from models.files.limits import MAX_FAULTS, MAX_FILE_FAULTS, MAX_NAME_CHARS

Kind = TypeVar("Kind")
MAX_VALUE_CHARS = 60  # longest value in a message
MAX_FAULT_LINES = 20  # most faults listed with an error


class TooManyFaults(BadInput):
    """A file has too many faults for further checks."""


class Faults:
    """Collects faults, so that one reading reports all of them, in the order of rows within a file."""

    def __init__(self) -> None:
        self._found: dict[str, list[tuple[float, str]]] = {}
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def add(self, file: str, text: str, row: int | None = None) -> None:
        """Add one fault; `row` is the line number in the file, from 1.

        Raises:
            TooManyFaults: the file, or all of them, have too many faults.
        """
        if len(self._found.get(file, ())) >= MAX_FILE_FAULTS or self._count >= MAX_FAULTS:
            raise self._refusal(TooManyFaults)
        self._count += 1
        where = "" if row is None else f", {'line' if file.endswith('.toml') else 'row'} {row}"
        # Faults of a whole file come last: they often follow from those of its rows.
        self._found.setdefault(file, []).append((float("inf") if row is None else row, f"{file}{where}: {text}"))

    def lines(self, per_file: int | None = None) -> list[str]:
        """All faults, one line each; with `per_file` at most that many per file, and the number of others."""
        lines = []
        for file, found in self._found.items():
            ordered = sorted(found, key=lambda fault: fault[0])
            lines += [one_line(text) for _, text in ordered[:per_file]]
            if per_file is not None and len(ordered) > per_file:
                least = "at least " if len(ordered) >= MAX_FILE_FAULTS else ""
                more = len(ordered) - per_file
                lines.append(one_line(f"{file}: {least}{more} more faults: correct those above first"))
        return lines

    def settle(self, value: Kind | None) -> Kind:
        """The value if there are no faults; otherwise BadInput with the first one, and the others as notes."""
        if value is not None and not self._count:
            return value
        raise self._refusal(BadInput)

    def _refusal(self, kind: type[BadInput]) -> BadInput:
        lines = self.lines()
        error = kind(lines[0] if lines else "nothing can be read: name another file")
        more = len(lines) - MAX_FAULT_LINES
        for line in lines[1:MAX_FAULT_LINES] + [f"{more} more faults: correct those above first"] * (more > 0):
            error.add_note(line)
        return error


class _Short(reprlib.Repr):
    """Like repr, but limited to the part of a large value that is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.maxlevel = 8
        self.maxlist = self.maxtuple = self.maxdict = MAX_VALUE_CHARS
        self.maxother = self.maxlong = 10 * MAX_VALUE_CHARS

    def repr_str(self, text: str, level: int) -> str:
        return repr(text[: MAX_VALUE_CHARS + 1])

    def repr_dict(self, table: dict[Any, Any], level: int) -> str:
        first = [f"{self.repr1(k, level - 1)}: {self.repr1(table[k], level - 1)}" for k in _first(table)]
        return "{" + ", ".join(first) + "}"


def _first(table: dict[Any, Any]) -> Sequence[Any]:
    return [key for key, _ in zip(table, range(MAX_VALUE_CHARS), strict=False)]


def shown(value: object) -> str:
    """A value for a message: quoted text or a number, shortened."""
    try:
        text = _Short().repr(value)
    except ValueError:  # an integer of thousands of digits
        text = "a number too long to show"
    return text if len(text) <= MAX_VALUE_CHARS else text[: MAX_VALUE_CHARS - 4] + " ..."


def listed(names: Iterable[str]) -> str:
    """The first few names for a message, quoted."""
    names = list(names)
    quoted = ", ".join(shown(name) for name in names[:8])
    return quoted + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def closest(name: str, known: Iterable[str]) -> str | None:
    """The known name of which `name` is probably a misspelling."""
    if len(name) > MAX_NAME_CHARS:
        return None
    by_lower = {k.lower(): k for k in known}
    found = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.75)
    return by_lower[found[0]] if found else None
