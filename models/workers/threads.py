"""Work over the threads of one process: rows in parts, one thread a core, or all of it on the thread that asks.

In: a function of a range of rows, which releases the GIL, and how many rows there are. Out: nothing; the function
writes what it finds. The result does not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextvars import ContextVar
from functools import cache

from models.interrupts import go_on

MIN_CHUNK = 8  # smallest number of shots that a thread takes at a time
CHUNKS_PER_THREAD = 8  # largest number of chunks for each thread


@cache
def _pool() -> ThreadPoolExecutor:
    return ThreadPoolExecutor(_cores(), thread_name_prefix="shots")


@cache
def _cores() -> int:
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


_max_threads: ContextVar[int] = ContextVar("max_threads", default=0)  # 0: one a core


@contextlib.contextmanager
def on_one_thread() -> Iterator[None]:
    """Shots inside are played by the thread that asks for them: the other cores have other work."""
    token = _max_threads.set(1)
    try:
        yield
    finally:
        _max_threads.reset(token)


def over_threads(work: Callable[[int, int], object], count: int, threads: int = 0) -> None:
    """Do work(first, last) for parts of `count` rows on threads (0: one a core); what it writes must not overlap."""
    go_on()
    threads = min(threads or _cores(), _max_threads.get() or _cores())
    size = max(MIN_CHUNK, -(-count // (CHUNKS_PER_THREAD * threads)))
    parts = [(k, min(k + size, count)) for k in range(0, count, size)]
    if threads == 1 or len(parts) == 1:
        for part in parts:
            work(*part)
        return
    waiting = iter(parts)

    def some(_: int) -> None:
        for part in waiting:  # the GIL makes taking the next one safe
            work(*part)

    for done in [_pool().submit(some, k) for k in range(min(threads, len(parts)))]:
        done.result()
