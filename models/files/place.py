"""The place of a table in a file, for messages: its faults are added with the file, the line and the table's name.

In: the text of a file, or none, and a table's name. Out: faults in the list of the file's reader.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from dataclasses import dataclass
from functools import lru_cache

from models.files.faults import Faults

ASSIGNMENT_START = re.compile(r"""\s*(?:([\w.-]+)|["']([^"']*)["'])\s*=""")
TABLE_HEADING = re.compile(r"\s*\[\[?\s*([^\[\]]*?)\s*\]\]?\s*(#.*)?$")


@dataclass(frozen=True)
class Place:
    """A table of a file (top level, `[name]`, or `[[name]]` number `index` from 0), with its list of faults."""

    file: str
    faults: Faults
    text: str = ""  # text of the file, for line numbers in messages; without it they name the table
    name: str = ""
    index: int | None = None
    within: str = ""  # key of the inline table within this table, and a dot

    def fault(self, text: str, key: str = "") -> None:
        """Add a fault of a key, or of the table."""
        named = f" [{self.name}]" if self.index is None else f" [[{self.name}]] {self.index + 1}"
        if self.text or not self.name:
            self.faults.add(self.file, text, self.line(self.within.removesuffix(".") or key) if self.text else None)
        else:
            self.faults.add(self.file + named, text)

    def below(self, key: str, index: int | None = None) -> Place:
        """The place of the table under a key."""
        if self.name and self.text:
            return dataclasses.replace(self, within=f"{key}.")
        return dataclasses.replace(self, name=f"{self.name}.{key}" if self.name else key, index=index)

    def line(self, key: str = "") -> int | None:
        """Line number of a key, else of the table; None if neither is found."""
        tables = _lines_of(self.text)
        table, keys = tables.get((self.name, self.index or 0), (None, {}))
        if key in keys:
            return keys[key]
        if table is None and self.name and (self.name, 0) not in tables:
            table = tables[("", 0)][1].get(self.name)  # written as name = { ... }
        return table or (self.below(key).line() if key and not self.name else None)


@lru_cache(maxsize=4)
def _lines_of(text: str) -> dict[tuple[str, int], tuple[int | None, dict[str, int]]]:
    """Lines of tables and of their keys, by a table's name and its number among those of that name."""
    keys: dict[str, int] = {}
    found: dict[tuple[str, int], tuple[int | None, dict[str, int]]] = {("", 0): (None, keys)}
    seen: Counter[str] = Counter()
    for number, line in enumerate(text.split("\n"), 1):
        if heading := TABLE_HEADING.match(line):
            name, keys = heading[1], {}
            found[name, seen[name]] = (number, keys)
            seen[name] += 1
        elif assigned := ASSIGNMENT_START.match(line):
            keys.setdefault(assigned[1] or assigned[2], number)
    return found
