"""Ends from outside: SIGTERM and a lost terminal act as Ctrl-C does, and workers end with the process they work for.

In: signals, the end of a parent process, work that nobody waits for any more. Out: `Terminated`, which is a
KeyboardInterrupt, so that whatever keeps finished work after Ctrl-C keeps it then too; `Abandoned`, in a worker.
SIGKILL and a full memory leave no time for anything: what must survive them is written as soon as it is known, and a
worker sees the pipe from its parent close.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import FrameType

ENDING_SIGNALS = (signal.SIGTERM, signal.SIGHUP)
SIGNAL_STATUS = 128  # and the number of a signal: the exit status that shells give
AGAIN_AFTER_S = 0.01  # an interrupt that a finaliser has swallowed


class Terminated(KeyboardInterrupt):
    """A signal that asks the process to end."""

    def __init__(self, number: int) -> None:
        """Note the signal."""
        super().__init__()
        self.number = number


def terminate(number: int, at: FrameType | None = None) -> None:
    """Signal handler that raises `Terminated`."""
    raise Terminated(number)


@contextlib.contextmanager
def as_interrupts() -> Iterator[None]:
    """Signals that end a process raise `Terminated` inside; those that are ignored, as by nohup, stay ignored."""
    before = {}
    usual_hook = sys.unraisablehook
    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = _interrupt_again
        for number in ENDING_SIGNALS:
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, terminate)
    try:
        yield
    finally:
        sys.unraisablehook = usual_hook
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt_again(unraisable: sys.UnraisableHookArgs) -> None:
    """An interrupt that falls into a finaliser or a callback of C is printed and lost by Python: it comes once more."""
    if not isinstance(unraisable.exc_value, KeyboardInterrupt):
        sys.__unraisablehook__(unraisable)
        return
    number = unraisable.exc_value.number if isinstance(unraisable.exc_value, Terminated) else signal.SIGINT
    again = threading.Timer(AGAIN_AFTER_S, os.kill, (os.getpid(), number))
    again.daemon = True
    again.start()


class Abandoned(BaseException):
    """Nobody waits any more for what this thread computes."""


_is_abandoned: ContextVar[Callable[[], bool] | None] = ContextVar("is_abandoned", default=None)


@contextlib.contextmanager
def given_up_when(is_abandoned: Callable[[], bool]) -> Iterator[None]:
    """Work inside ends at the next `go_on` once nobody waits for it any more, or for what it is a part of."""
    outer = _is_abandoned.get() or (lambda: False)
    token = _is_abandoned.set(lambda: is_abandoned() or outer())
    try:
        yield
    except Abandoned:
        pass
    finally:
        _is_abandoned.reset(token)


def go_on() -> None:
    """Raise `Abandoned` where nobody waits for this work any more; long work calls it now and then."""
    is_abandoned = _is_abandoned.get()
    if is_abandoned is not None and is_abandoned():
        raise Abandoned


def work_for_parent() -> None:
    """Make this process a worker: Ctrl-C is left to its parent, and it ends as soon as that is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()  # a pipe that closes when the parent ends, however it ends
    os._exit(SIGNAL_STATUS + signal.SIGTERM)
