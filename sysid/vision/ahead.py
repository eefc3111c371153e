"""Reading ahead: what an iterator gives is made in a thread beside the work on it, in the same order."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

T = TypeVar("T")
MAX_WAITING = 4  # that are made and not taken yet; pictures are large


def ahead(source: Iterable[T]) -> Generator[T, None, None]:
    """All of a source, made in a thread of its own; what is raised there is raised here, in its turn.

    The thread ends with the iterator: with its last item, or once it is closed.
    """
    items, end = iter(source), object()
    reader = ThreadPoolExecutor(1, thread_name_prefix="reading ahead")
    try:
        waiting = deque[Any](reader.submit(next, items, end) for _ in range(MAX_WAITING))
        while (item := waiting.popleft().result()) is not end:
            waiting.append(reader.submit(next, items, end))
            yield item
    finally:
        reader.shutdown(cancel_futures=True)
