"""The log of exchanges with the launcher: one line of JSON each, appended to a file.

In: events with their start times. Out: lines {"utc", "event", "began", "seconds", ...}, written immediately and
unbuffered, so that the log is complete up to a crash. A full disk is noted and never stops an exchange.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from models.files.writing import append_to, unwritable
from robot.device.settings import Clock


class ExchangeLog:
    """A log file; without a path it does nothing."""

    def __init__(self, path: Path | str | None, clock: Clock, note: Callable[[str, str], None]) -> None:
        """Create a log that is not open yet; `note` is called with kind and detail of a failed write."""
        self._path, self._clock, self._note = path, clock, note
        self._file = -1  # descriptor

    def open(self) -> None:
        """Open the file once; BadInput if it cannot be written."""
        if self._path is None or self._file >= 0:
            return
        try:
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        except OSError as error:
            raise unwritable(self._path, error) from None

    def write(self, event: str, began: float, **facts: Any) -> None:
        """Append an event that began at a time of the clock [s]."""
        if self._file < 0:
            return
        now = self._clock.now()
        record = {"utc": time.time(), "event": event, "began": began, "seconds": now - began} | facts
        try:
            append_to(self._file, (json.dumps(record) + "\n").encode())
        except OSError as error:  # a full disk must not prevent the return of a stroke's result
            self._note("log", f"not written: {error.strerror}")

    def close(self) -> None:
        """Close the file."""
        if self._file >= 0:
            os.close(self._file)
            self._file = -1
