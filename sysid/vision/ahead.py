"""Reading ahead: what an iterator gives is made in a thread beside the work on it, in the same order."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Iterable
from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")
MAX_WAITING = 4  # that are made and not taken yet; pictures are large
WAIT_S = 0.05  # for room, between two looks whether anybody still takes them


@dataclass(frozen=True)
class _Made(Generic[T]):
    """One that was made, or the end, or what failed."""

    items: tuple[T, ...]
    failed: BaseException | None = None


def ahead(source: Iterable[T]) -> Generator[T, None, None]:
    """All of a source, made in a thread of its own; what is raised there is raised here, in its turn.

    The thread ends with the iterator: with its last item, or once it is closed.
    """
    made: queue.Queue[_Made[T]] = queue.Queue(MAX_WAITING)
    left = threading.Event()

    def put(one: _Made[T]) -> None:
        while not left.is_set():
            try:
                return made.put(one, timeout=WAIT_S)
            except queue.Full:
                continue

    def work() -> None:
        failed = None
        try:
            for item in source:
                put(_Made((item,)))
                if left.is_set():
                    break
        except BaseException as error:  # noqa: BLE001 - raised by who takes them
            failed = error
        put(_Made((), failed))

    thread = threading.Thread(target=work, name="reading ahead", daemon=True)
    thread.start()
    try:
        while True:
            one = made.get()
            if one.failed is not None:
                raise one.failed
            if not one.items:
                return
            yield one.items[0]
    finally:
        left.set()
        thread.join()
