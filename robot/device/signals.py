"""Signals that end a program stop the launcher first.

In: what stops it at once. Out: KeyboardInterrupt or `Terminated`, after the stop. SIGKILL leaves no time; then the
launcher stops by itself, as it hears nothing any more (robot/device/protocol.py).
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable
from types import FrameType
from typing import Any

from models.interrupts import ENDING_SIGNALS, Terminated


class StopOnSignals:
    """Handlers of these signals, while a line is open; those that nohup or a shell ignores stay ignored."""

    def __init__(self, halt: Callable[[], object]) -> None:
        """Nothing is handled yet; `halt` is called in the handler and must not wait."""
        self._halt = halt
        self._before: dict[signal.Signals, Any] = {}

    def install(self) -> None:
        """Handle them, in the main thread; elsewhere Python allows none."""
        if threading.current_thread() is threading.main_thread():
            for number in (signal.SIGINT, *ENDING_SIGNALS):
                if signal.getsignal(number) != signal.SIG_IGN or number == signal.SIGINT:
                    self._before[number] = signal.signal(number, self._on_signal)

    def remove(self) -> None:
        """What was before."""
        for number, handler in self._before.items():
            signal.signal(number, handler)
        self._before.clear()

    def _on_signal(self, number: int, at: FrameType | None) -> None:
        self._halt()
        if number == signal.SIGINT:
            raise KeyboardInterrupt
        raise Terminated(number)
