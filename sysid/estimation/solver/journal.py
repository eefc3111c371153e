"""Journal of finished fits, so that an interrupted run can continue: answers in the order of the questions.

In: a file of JSON lines, from a run with the same fingerprint. Out: its answers, as long as the questions are the same;
every further answer is appended to the file as soon as it is known.

The same clips, model and sources need the same fits in the same order, to the last digit. So an interrupted run
repeats itself, its first fits take no time, and it ends with the same figures. A line holds numbers only, whose count
and bounds are checked; from the first invalid line on the file is discarded.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.files import append_whole, read_text, write_whole
from models.files.faults import Faults
from models.files.limits import MAX_JSON_BYTES

Array = NDArray[np.float64]
JOURNAL_FORMAT = "billiard-unfinished/1"
MAX_JOURNAL_BYTES = 1 << 30


class Journal:
    """The answers of a run, those of an earlier one first."""

    def __init__(self, path: Path, fingerprint: str) -> None:
        """Read the journal of an earlier run, if its fingerprint is the same."""
        self.path, self._began = path, time.monotonic()
        self._head = json.dumps({"format": JOURNAL_FORMAT, "of": fingerprint})
        text = (read_text(path, str(path), Faults(), "", MAX_JOURNAL_BYTES) if path.exists() else None) or ""
        whole = text[: text.rfind("\n") + 1].splitlines()  # an incomplete last line does not count
        self._old = whole[1:] if whole[:1] == [self._head] else []
        self._used, self._spent = 0, 0.0
        self._kept = bool(self._old) and text.endswith("\n")  # whether the file ends where it was read to

    @property
    def found(self) -> int:
        """Answers of an earlier run that are not yet used."""
        return len(self._old) - self._used

    @property
    def elapsed(self) -> float:
        """Time spent on all answers, by this run and those before [s]."""
        return self._spent + time.monotonic() - self._began

    def answer(self, asked: str, shapes: Sequence[tuple[int, ...]]) -> tuple[Array, ...] | None:
        """The next answer of the earlier run, if its question and shapes are the same."""
        if self._used == len(self._old):
            return None
        try:
            entry = json.loads(self._old[self._used][:MAX_JSON_BYTES])
        except (ValueError, RecursionError):  # not a line of a journal
            entry = None
        found = _numbers(entry, shapes) if isinstance(entry, dict) and entry.get("asked") == asked else None
        if found is None:
            self.drop()
            return None
        self._used += 1
        spent = entry.get("elapsed_s")
        if isinstance(spent, float) and math.isfinite(spent):
            self._spent, self._began = max(spent, 0.0), time.monotonic()
        return found

    def drop(self, last: bool = False) -> None:
        """Discard the earlier run's answers from here on; with `last` also the previous one."""
        self._used -= last
        self._old, self._kept = self._old[: self._used], False

    def add(self, asked: str, found: Sequence[Array]) -> None:
        """Append a new answer to the file."""
        numbers = [np.asarray(values, float).ravel().tolist() for values in found]
        line = json.dumps({"asked": asked, "elapsed_s": self.elapsed, "numbers": numbers})
        if not self._kept:
            write_whole(self.path, ("\n".join([self._head, *self._old]) + "\n").encode())
            self._kept = True
        append_whole(self.path, f"{line}\n".encode())


def _numbers(entry: dict[str, Any], shapes: Sequence[tuple[int, ...]]) -> tuple[Array, ...] | None:
    """Arrays of these shapes from an entry; None if it holds anything else."""
    lists = entry.get("numbers")
    if not isinstance(lists, list) or len(lists) != len(shapes):
        return None
    for values, shape in zip(lists, shapes, strict=True):
        if not isinstance(values, list) or len(values) != math.prod(shape):
            return None
        if not all(isinstance(v, float) for v in values):
            return None
    return tuple(np.array(values, float).reshape(shape) for values, shape in zip(lists, shapes, strict=True))


_journal: ContextVar[Journal | None] = ContextVar("journal", default=None)


@contextlib.contextmanager
def recorded_in(journal: Journal | None) -> Iterator[None]:
    """Within this context fits are taken from a journal, or appended to it; None disables it."""
    token = _journal.set(journal)
    try:
        yield
    finally:
        _journal.reset(token)


def recorded(
    work: Callable[[], tuple[Array, ...]],
    question: Sequence[Array],
    shapes: Sequence[tuple[int, ...]],
    fits: Callable[[tuple[Array, ...]], bool],
) -> tuple[Array, ...]:
    """The result of `work`, from the journal if one is in use and has it.

    Args:
        work: the computation; nested calls are not recorded.
        question: text that identifies the computation.
        shapes: of its results.
        fits: whether an answer from the journal is within its bounds.
    """
    journal = _journal.get()
    if journal is None:
        return work()
    digest = hashlib.sha256()
    for values in question:
        digest.update(repr(np.shape(values)).encode() + np.ascontiguousarray(values, float).tobytes())
    asked = digest.hexdigest()[:16]
    known = journal.answer(asked, shapes)
    if known is not None and fits(known):
        return known
    if known is not None:
        journal.drop(last=True)
    with recorded_in(None):
        found = work()
    journal.add(asked, found)
    return found
