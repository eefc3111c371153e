"""External interrupts: signals and a lost terminal act like Ctrl-C, and workers end with their parent process.

In: SIGTERM, SIGHUP, SIGQUIT (Ctrl-\\), the end of a parent process, work whose result is no longer needed. Out:
`Terminated`, a KeyboardInterrupt, so that code which keeps finished work after Ctrl-C also keeps it then; `Abandoned`,
in a worker. SIGKILL and a lack of memory cannot be handled: data that must survive them are written immediately, and
a worker notices that the pipe from its parent closes.
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
SIGNAL_STATUS = 128  # plus the number of a signal: the exit status in shells
AGAIN_AFTER_S = 0.01  # time after which a dropped interrupt is sent again
Dropped = list[tuple[KeyboardInterrupt, threading.Timer]]  # interrupts, and the timers that send them again


class Terminated(KeyboardInterrupt):
    """A signal that requests the end of the process."""

    def __init__(self, number: int) -> None:
        """Note the signal."""
        super().__init__()
        self.number = number


def terminate(number: int, at: FrameType | None = None) -> None:
    """Signal handler that raises `Terminated`."""
    raise Terminated(number)


@contextlib.contextmanager
def as_interrupts() -> Iterator[None]:
    """Within this context signals that end a process raise `Terminated`; ignored ones, as by nohup, stay ignored.

    An interrupt during an import is raised instead of the exceptions in which Python and compiled modules wrap it. One
    that they print and drop is not lost: if the module then fails, it is raised; otherwise it is sent again.
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
    """Hook for exceptions in finalisers or C callbacks; an interrupt is sent again."""
    if isinstance(unraisable.exc_value, KeyboardInterrupt):
        _come_again(dropped, unraisable.exc_value)
    else:
        sys.__unraisablehook__(unraisable)


def _printed(dropped: Dropped, kind: type[BaseException], error: BaseException, at: TracebackType | None) -> None:
    """Hook for exceptions that a compiled module prints and drops; an interrupt is sent again."""
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
    """The result of this thread is no longer needed."""


_is_abandoned: ContextVar[Callable[[], bool] | None] = ContextVar("is_abandoned", default=None)


@contextlib.contextmanager
def given_up_when(is_abandoned: Callable[[], bool]) -> Iterator[None]:
    """Within this context work ends at the next `go_on` once it, or the work of which it is a part, is abandoned."""
    outer = _is_abandoned.get() or (lambda: False)
    token = _is_abandoned.set(lambda: is_abandoned() or outer())
    try:
        yield
    except Abandoned:
        pass
    finally:
        _is_abandoned.reset(token)


def go_on() -> None:
    """Raise `Abandoned` if this work is no longer needed; long work calls it from time to time."""
    is_abandoned = _is_abandoned.get()
    if is_abandoned is not None and is_abandoned():
        raise Abandoned


def work_for_parent() -> None:
    """Make this process a worker, which ignores Ctrl-C and Ctrl-\\ and ends with its parent."""
    for number in (signal.SIGINT, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()  # a pipe that closes when the parent ends for any reason
    os._exit(SIGNAL_STATUS + signal.SIGTERM)
