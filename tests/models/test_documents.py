"""Files of our own: an entry that is missing or of another kind is told in a line."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from models.errors import BadInput
from models.files import entries_of, write_whole

ENTRIES = {"value": 3}
DAMAGES: dict[str, Callable[[], object]] = {
    "gone": lambda: ENTRIES["sd"],
    "no table": lambda: ENTRIES["value"]["x"],  # type: ignore[index]
    "no number": lambda: float([]),  # type: ignore[arg-type]
    "text": lambda: float("x"),
    "too large": lambda: math.exp(1e9),
}


@pytest.mark.parametrize("read", DAMAGES.values(), ids=DAMAGES.keys())
def test_a_damaged_entry_is_told_in_a_line(read: Callable[[], object]) -> None:
    with pytest.raises(BadInput, match=r"^a\.json: .*; make it again$"), entries_of("a.json", "make it again"):
        read()


def test_a_refusal_of_its_own_stays() -> None:
    with pytest.raises(BadInput, match="as it was"), entries_of("a.json", "make it again"):
        raise BadInput("as it was")


def test_what_is_no_file_is_not_replaced_by_one(tmp_path: Path) -> None:
    """Not a device either: a program that may do anything would take it from everyone."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(BadInput, match="is no regular file; name another"):
        write_whole(pipe, b"text")
    assert pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]
