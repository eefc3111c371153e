"""Columns of texts stored compactly: a list of strings needs five times the memory.

In: texts in order. Out: `Texts`, a sequence of them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import overload

import numpy as np
from numpy.typing import NDArray

BLOCK_TEXTS = 8192  # texts packed at a time


class Texts(Sequence[str]):
    """An immutable sequence of texts."""

    def __init__(self, data: bytes, ends: NDArray[np.uint32]) -> None:
        """Create it from UTF-8 bytes and the end of each text in them."""
        self._data, self._ends = data, ends

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> Texts: ...
    def __getitem__(self, index: int | slice) -> str | Texts:
        if isinstance(index, slice):
            return self.picked(np.arange(len(self))[index])
        at = range(len(self))[index]
        start = int(self._ends[at - 1]) if at else 0
        return self._data[start : int(self._ends[at])].decode("utf-8", "surrogatepass")

    def __iter__(self) -> Iterator[str]:
        start, data = 0, self._data
        for first in range(0, len(self), BLOCK_TEXTS):
            for end in self._ends[first : first + BLOCK_TEXTS].tolist():
                yield data[start:end].decode("utf-8", "surrogatepass")
                start = end

    def __eq__(self, other: object) -> bool:
        if isinstance(other, Texts):
            return self._data == other._data and np.array_equal(self._ends, other._ends)
        return isinstance(other, Sequence) and list(self) == list(other)

    __hash__ = None  # type: ignore[assignment]

    def picked(self, rows: NDArray[np.int64]) -> Texts:
        """The texts of some rows."""
        packer = TextPacker()
        for row in rows.tolist():
            packer.add(self[row])
        return packer.texts()


class TextPacker:
    """Packs texts in order."""

    def __init__(self) -> None:
        """Start without texts."""
        self._data, self._lengths, self._waiting = bytearray(), list[NDArray[np.uint32]](), list[str]()
        self._packed = 0

    def __len__(self) -> int:
        return self._packed + len(self._waiting)

    @property
    def size(self) -> int:
        """Number of bytes packed so far."""
        return len(self._data)

    def add(self, text: str) -> None:
        """Add one text."""
        self._waiting.append(text)
        if len(self._waiting) >= BLOCK_TEXTS:
            self._pack()

    def extend(self, texts: Iterable[str]) -> None:
        """Add several texts."""
        self._waiting.extend(texts)
        if len(self._waiting) >= BLOCK_TEXTS:
            self._pack()

    def pad(self, count: int) -> None:
        """Add empty texts up to a total number."""
        missing = count - len(self)
        if missing > 0:
            self._pack()
            self._lengths.append(np.zeros(missing, np.uint32))
            self._packed += missing

    def texts(self) -> Texts:
        """All texts."""
        self._pack()
        lengths = np.concatenate(self._lengths) if self._lengths else np.zeros(0, np.uint32)
        return Texts(bytes(self._data), np.cumsum(lengths, dtype=np.uint32))

    def _pack(self) -> None:
        if not self._waiting:
            return
        joined = "".join(self._waiting)
        raw = joined.encode("utf-8", "surrogatepass")
        one_byte = len(raw) == len(joined)
        lengths = map(len, self._waiting if one_byte else (t.encode("utf-8", "surrogatepass") for t in self._waiting))
        self._data += raw
        self._lengths.append(np.fromiter(lengths, np.uint32, len(self._waiting)))
        self._packed += len(self._waiting)
        self._waiting = []


def picked(cells: Sequence[str], rows: NDArray[np.int64]) -> Sequence[str]:
    """The cells of some rows of a column."""
    return cells.picked(rows) if isinstance(cells, Texts) else tuple(cells[k] for k in rows.tolist())
