"""Ends from outside: signals and a lost terminal act as Ctrl-C does, and workers end with the process they work for.

In: SIGTERM, SIGHUP, SIGQUIT (Ctrl-\\), the end of a parent process, work that nobody waits for any more. Out:
`Terminated`, which is a KeyboardInterrupt, so that whatever keeps finished work after Ctrl-C keeps it then too;
`Abandoned`, in a worker. SIGKILL and a full memory leave no time for anything: what must survive them is written as
soon as it is known, and a worker sees the pipe from its parent close.
"""

from __future__ import annotations

import contextlib
import functools
import multiprocessing
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextvars import ContextVar
from types import FrameType, TracebackType

ENDING_SIGNALS = (signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
SIGNAL_STATUS = 128  # and the number of a signal: the exit status that shells give
AGAIN_AFTER_S = 0.01  # an interrupt that was dropped
Dropped = list[tuple[KeyboardInterrupt, threading.Timer]]  # interrupts, and what sends them again


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
    """Signals that end a process raise `Terminated` inside; those that are ignored, as by nohup, stay ignored.

    An interrupt in the midst of an import is raised in place of what Python and compiled modules wrap it in. One that
    they print and drop is not lost: where the module then fails, it is raised; elsewhere it comes once more.
    """
    before = {}
    usual_hooks = sys.unraisablehook, sys.excepthook
    dropped: Dropped = []
    if threading.current_thread() is threading.main_thread():
        sys.unraisablehook = functools.partial(_unraisable, dropped)
        sys.excepthook = functools.partial(_printed, dropped)
        for number in ENDING_SIGNALS:
            if signal.getsignal(number) == signal.SIG_DFL:
                before[number] = signal.signal(number, terminate)
    try:
        yield
    except (ImportError, SystemError, RuntimeError) as error:
        stop = _interrupt_behind(error) or (dropped[-1][0] if dropped else None)
        own = isinstance(error, RuntimeError) and type(error) is not RuntimeError  # as of a launcher that did not stop
        if stop is None or own:
            raise
        for _, again in dropped:
            again.cancel()
        raise stop from None
    finally:
        sys.unraisablehook, sys.excepthook = usual_hooks
        for number, handler in before.items():
            signal.signal(number, handler)


def _interrupt_behind(error: BaseException) -> KeyboardInterrupt | None:
    """The interrupt that an exception was raised from."""
    before: BaseException | None = error
    while before is not None and not isinstance(before, KeyboardInterrupt):
        before = before.__cause__ or before.__context__
    return before


def _unraisable(dropped: Dropped, unraisable: sys.UnraisableHookArgs) -> None:
    """What falls into a finaliser or a callback of C; an interrupt comes again."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _come_again(dropped, unraisable.exc_value)
    else:
        sys.__unraisablehook__(unraisable)


def _printed(dropped: Dropped, kind: type[BaseException], error: BaseException, at: TracebackType | None) -> None:
    """What a compiled module prints and drops; an interrupt comes again."""
    if isinstance(error, KeyboardInterrupt):
        _come_again(dropped, error)
    else:
        sys.__excepthook__(kind, error, at)


def _come_again(dropped: Dropped, stop: KeyboardInterrupt) -> None:
    number = stop.number if isinstance(stop, Terminated) else signal.SIGINT
    again = threading.Timer(AGAIN_AFTER_S, os.kill, (os.getpid(), number))
    again.daemon = True
    dropped.append((stop, again))
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
    """Make this process a worker: Ctrl-C and Ctrl-\\ are left to its parent, and it ends as soon as that is gone."""
    for number in (signal.SIGINT, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()  # a pipe that closes when the parent ends, however it ends
    os._exit(SIGNAL_STATUS + signal.SIGTERM)
