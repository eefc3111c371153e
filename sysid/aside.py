"""Work done beside other work, in a process of its own: two looks that do not need each other, on two cores.

The process is a copy of this one, so the work may be any closure; its result is pickled. What it finds is the same as
if it were done here.
"""

from __future__ import annotations

import gc
import multiprocessing
import os
import signal
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Generic, TypeVar

T = TypeVar("T")


class Aside(Generic[T]):
    """A task that runs beside this process; where there is one core, or no fork, when its result is asked for.

    A context: what has not been asked for when it ends is given up.
    """

    def __init__(self, task: Callable[[], T]) -> None:
        self._task = task
        self._process: multiprocessing.process.BaseProcess | None = None
        alone = sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2
        if alone or multiprocessing.current_process().daemon:  # one that works aside itself has no core left
            return
        context = multiprocessing.get_context("fork")
        self._from, to = context.Pipe(duplex=False)
        self._process = context.Process(target=_work, args=(task, to), daemon=True)
        with warnings.catch_warnings():
            # Threads of numpy's linear algebra sleep; it has handlers for forks of its own.
            warnings.filterwarnings("ignore", "This process .* is multi-threaded", DeprecationWarning)
            self._process.start()
        to.close()

    def result(self) -> T:
        """What the task returns, once it is done."""
        if self._process is not None:
            with suppress(EOFError):
                found: T = self._from.recv()
                return found
        return self._task()  # nobody does it, or whoever did has failed: here it says why

    def __enter__(self) -> Aside[T]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, value: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._process is not None:
            self._process.kill()  # a handler inherited for other signals may still be in its place
            self._process.join()
            self._from.close()


def _work(task: Callable[[], object], to: Connection) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the process that waits for it ends it
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    gc.freeze()  # threads are not copied: what would wait for its own when it is collected, is left alone
    with suppress(Exception):
        to.send(task())


def shared(work: Callable[[int], T], count: int) -> list[T]:
    """work(0), work(1) ... in order, every other one done aside."""
    if count < 2:
        return [work(k) for k in range(count)]
    with Aside(lambda: [work(k) for k in range(1, count, 2)]) as aside:
        here = [work(k) for k in range(0, count, 2)]
        found = [*here, *aside.result()]
    return [found[k // 2 + (k % 2) * len(here)] for k in range(count)]
