"""What workers do in tests: functions of a module, as all work for other processes is."""

from __future__ import annotations

import time
from pathlib import Path

from models.interrupts import Abandoned, go_on
from models.workers.order import report


def square(number: int, seconds: float = 0.0) -> int:
    """After some time."""
    time.sleep(seconds)
    report(f"squared {number}")
    return number * number


def wait(file: str, seconds: float) -> None:
    """Wait, and write what has become of it."""
    Path(file).write_text("begun")
    until = time.monotonic() + seconds
    try:
        while time.monotonic() < until:
            go_on()
            time.sleep(0.05)
    except Abandoned:
        Path(file).write_text("given up")
        raise
    Path(file).write_text("done")
