"""Reading ahead: order, errors in their turn, and no thread left."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from models.errors import BadInput
from sysid.vision.ahead import MAX_WAITING, ahead


def test_all_come_in_order() -> None:
    assert list(ahead(range(100))) == list(range(100))
    assert list(ahead([])) == []


def test_an_error_comes_after_what_was_made_before_it() -> None:
    def three() -> Iterator[int]:
        yield from range(3)
        raise BadInput("broken")

    got = []
    with pytest.raises(BadInput, match="broken"):
        for k in ahead(three()):
            got.append(k)
    assert got == [0, 1, 2]


def test_little_is_made_in_advance_and_nothing_after_it_is_closed() -> None:
    made = []

    def many() -> Iterator[int]:
        for k in range(10**6):
            made.append(k)
            yield k

    before, reader = threading.active_count(), ahead(many())
    assert next(reader) == 0
    time.sleep(0.3)
    assert len(made) <= MAX_WAITING + 3
    reader.close()
    assert threading.active_count() == before


def test_the_next_is_made_while_the_one_before_is_worked_on() -> None:
    made = [threading.Event() for _ in range(10)]

    def marking() -> Iterator[int]:
        for k, event in enumerate(made):
            event.set()
            yield k

    for k in ahead(marking()):
        assert all(event.wait(5.0) for event in made[: k + 2])
