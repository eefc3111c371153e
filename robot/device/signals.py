"""Signals that end a program stop the launcher first.

In: a function that stops it immediately. Out: KeyboardInterrupt or `Terminated`, after the stop. After SIGKILL the
launcher stops on its own, as it receives no more frames (robot/device/protocol.py).
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

from models.interrupts import ENDING_SIGNALS, Terminated


class StopOnSignals:
    """Handlers of these signals while a link is open; signals ignored by nohup or a shell stay ignored."""

    def __init__(self, halt: Callable[[], object]) -> None:
        """Create the handlers; `halt` is called in them and must not wait."""
        self._halt = halt
        self._before: dict[signal.Signals, Any] = {}

    def install(self) -> None:
        """Install the handlers, in the main thread only, as Python requires."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, *ENDING_SIGNALS):
                if signal.getsignal(number) != signal.SIG_IGN or number == signal.SIGINT:
                    self._before[number] = signal.signal(number, self._on_signal)

    def remove(self) -> None:
        """Restore the previous handlers."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def _on_signal(self, number: int, at: FrameType | None) -> None:
        self._halt()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise Terminated(number)
