"""The emulated launcher on a pseudo-terminal, in real time.

In: the firmware (robot/emulator/firmware.py), the baud rate, faults to inject. Out: a path that opens as a serial port.
The driver's own threads, time-outs and system calls are used. The mechanics may run faster than real time (`pace`), but
not the line (robot/emulator/line.py).
"""

from __future__ import annotations

import contextlib
import os
import select
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType

import numpy as np

from models.errors import BadInput
from robot.device.port import READ_SLICE_S
from robot.device.protocol import STOP_BYTE
from robot.emulator.faults import FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.line import Line
from robot.emulator.mechanism import ExecutedAction


class Pace:
    """A clock for the mechanics that runs faster than real time, by a variable factor."""

    def __init__(self, factor: float = 1.0) -> None:
        """Start at 0."""
        self._factor, self._real_s, self._mechanics_s = factor, time.monotonic(), 0.0

    def now(self) -> float:
        """Seconds of the mechanics."""
        return self._mechanics_s + (time.monotonic() - self._real_s) * self._factor

    def factor(self) -> float:
        """Seconds of the mechanics in a real second."""
        return self._factor

    def set(self, factor: float) -> None:
        """Change the factor from now on."""
        self._mechanics_s, self._real_s = self.now(), time.monotonic()
        self._factor = factor


class Emulator:
    """The launcher on a pseudo-terminal, in a thread; `with Emulator(firmware, baud=...) as e: open(e.path)`.

    The path is a symbolic link to the terminal, like udev's links to serial ports: a cable that was pulled reappears at
    the same path. Access the firmware only while `lock` is held.
    """

    def __init__(
        self, firmware: Firmware, *, baud: int, faults: FaultInjection | None = None, path: Path | str | None = None
    ) -> None:
        """Create an emulator that is not running yet; by default its path is in a folder of its own."""
        self._line = Line(firmware, baud=baud, faults=faults)
        self._folder = None if path is not None else tempfile.TemporaryDirectory(prefix="launcher-")
        self.path = str(path) if path is not None else str(Path(self._folder.name) / "port" if self._folder else "")
        self.firmware, self.lock = firmware, threading.Lock()
        self.failed: BaseException | None = None  # exception raised by `on_strike`
        self._ends: tuple[int, int] | None = None
        self._woken, self._wake = os.pipe()
        self._ending = threading.Event()
        self._thread = threading.Thread(target=self._run, name="launcher emulator", daemon=True)

    def __enter__(self) -> Emulator:
        """Plug in and run."""
        self._plug()
        self._thread.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Switch off."""
        self._ending.set()
        os.write(self._wake, b"x")
        self._thread.join()
        self._unplug()
        os.close(self._woken)
        os.close(self._wake)
        if self._folder is not None:
            self._folder.cleanup()

    def pull(self, seconds: float) -> None:
        """Disconnect the cable for a time [s]."""
        with self.lock:
            self._line.pull(time.monotonic(), seconds)
        os.write(self._wake, b"x")

    def _plug(self) -> None:
        master, slave = os.openpty()  # the slave stays open, or the terminal would hang up without a reader
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._ends = (master, slave)
        scratch = Path(f"{self.path}.new")
        scratch.unlink(missing_ok=True)
        scratch.symlink_to(os.ttyname(slave))
        if Path(self.path).exists() and not Path(self.path).is_symlink():
            scratch.unlink()
            raise BadInput(f"{self.path}: is in use; name a free path")
        scratch.replace(self.path)

    def _unplug(self) -> None:
        if self._ends is not None:
            for end in self._ends:
                os.close(end)
            self._ends = None
            Path(self.path).unlink(missing_ok=True)

    def _run(self) -> None:
        pulls = 0
        while not self._ending.is_set():
            now = time.monotonic()
            if self._line.pulls != pulls:
                pulls = self._line.pulls
                self._unplug()
            if self._ends is None and now >= self._line.out_until:
                self._plug()
            due = self._line.next_due()
            wait = READ_SLICE_S / 4 if due is None else min(max(due - now, 0.0), READ_SLICE_S / 4)
            sources = [self._woken] if self._ends is None else [self._woken, self._ends[0]]
            ready, _, _ = select.select(sources, [], [], wait)
            if self._woken in ready:
                os.read(self._woken, 100)
            with self.lock:
                self._serve(bool(self._ends and self._ends[0] in ready))

    def _serve(self, readable: bool) -> None:
        now = time.monotonic()
        if readable and self._ends is not None:
            with contextlib.suppress(OSError):  # the other end is closed
                for line in _lines(os.read(self._ends[0], 4096)):
                    self._line.put(now, line)
        try:
            self._line.step(time.monotonic())
        except Exception as error:  # noqa: BLE001 - the caller's on_strike; kept for whoever started the emulator
            self.failed = error
        out = self._line.take(time.monotonic())
        if out and self._ends is not None:
            with contextlib.suppress(OSError):  # a full buffer loses bytes, as a serial port does
                os.write(self._ends[0], out)


def _lines(data: bytes) -> list[bytes]:
    """Split a write into lines, since faults occur line by line; a stop byte counts as a line."""
    parts = data.replace(STOP_BYTE, b"\0!\0").replace(b"\n", b"\n\0").split(b"\0")
    return [part for part in parts if part]


def serve(
    path: Path | str | None = None,
    kind: type[Firmware] = Firmware,
    *,
    baud: int = 19200,
    pace: float = 1.0,
    fault_rate: float = 0.0,
    seed: int = 0,
    say: Callable[[str], None] = print,
    until: threading.Event | None = None,
) -> None:
    """Run an emulated launcher until interrupted, or until an event is set.

    Args:
        path: of the port; None for a new one. It is reported first.
        kind: of the launcher.
        baud: of the line [bit/s].
        pace: speed of the mechanics over real time.
        fault_rate: probability of a fault in a line, 0 to 1.
        seed: of all random numbers.
        say: called with the path, then with a line for every action.
        until: event that ends the emulation.
    """
    if not 0 < pace <= 1000:
        raise BadInput(f"pace is {pace}; give a number above 0, up to 1000")
    rng, chance = np.random.default_rng(seed).spawn(2)
    clock = Pace(pace)
    firmware = kind(clock.now, rng, pace=clock.factor)
    faults = FaultInjection(fault_rate, chance) if fault_rate else None
    ending, reported = until or threading.Event(), 0
    with Emulator(firmware, baud=baud, faults=faults, path=path) as emulator, contextlib.suppress(KeyboardInterrupt):
        say(emulator.path)
        while not ending.wait(0.05):
            with emulator.lock:
                actions = firmware.actions[reported:]
            reported += len(actions)
            for action in actions:
                say(f"{action.time:9.3f} s  {action.what:9}  {_details(action)}".rstrip())


def _details(action: ExecutedAction) -> str:
    tip = f"side {1e3 * action.x:+.2f} mm, height {1e3 * action.y:+.2f} mm"
    if action.what == "struck":
        return f"{action.string:03d}p  cue {action.speed:.3f} m/s at {tip}"
    if action.what == "begun":
        return f"{action.string:03d}p"
    return tip if action.what == "moved" else ""
