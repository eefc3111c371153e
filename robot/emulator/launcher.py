"""The emulated launcher at the end of a cable: here on a virtual clock, or on a pseudo-terminal in real time.

Both put the same firmware behind the same line: bytes take 10 / baud seconds each, a reply takes its processing time,
and faults happen to either (`faults.py`). On the virtual clock waiting costs nothing, and a seed gives the same run
again; on the pseudo-terminal the driver's own threads, time-outs and system calls are at work. The launcher's mechanics
may run faster than real time there (`pace`), the line never does. Leaves out flow control, parity and modem lines.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import select
import signal
import sys
import tempfile
import termios
import threading
import time
import tty
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from types import TracebackType

import numpy as np

from models.errors import BadInput
from robot.device.protocol import STOP_BYTE
from robot.emulator.faults import FaultInjection
from robot.emulator.firmware import Deed, Firmware

PROCESSING_TIME_S = 0.001  # of a request by the microcontroller [s]; PIC18F458 at 10 MIPS, C
READ_SLICE_S = 0.02  # that a read waits [s], as robot/device/link.py opens ports


class Line:
    """The cable with the firmware at its end: bytes on their way, due at their times."""

    def __init__(self, firmware: Firmware, *, baud: int, faults: FaultInjection | None = None) -> None:
        """A line at rest."""
        self.firmware, self.faults, self._byte_s = firmware, faults, 10.0 / baud
        self._up: list[tuple[float, bytes]] = []
        self._down: list[tuple[float, bytes]] = []
        self._last_up = self._last_down = 0.0
        self.out_until = -1.0  # the cable is out
        self.pulls = 0  # ports opened before the last one are dead

    def put(self, now: float, data: bytes) -> None:
        """The computer writes."""
        if self.faults is not None:
            spoiled = self.faults.request(now, data)
            data = spoiled.data
            if spoiled.restart is not None:
                self.firmware.restart(spoiled.restart)
            if spoiled.stuck:
                self.firmware.stick()
            if spoiled.out > 0:
                self.pull(now, spoiled.out)
        if data:
            self._last_up = max(now, self._last_up) + len(data) * self._byte_s
            self._up.append((self._last_up, data))

    def flush(self, now: float) -> None:
        """The computer throws away what it has not sent yet."""
        self._up = [(due, data) for due, data in self._up if due - len(data) * self._byte_s <= now]
        self._last_up = self._up[-1][0] if self._up else now

    def pull(self, now: float, seconds: float) -> None:
        """The cable comes out; what is on its way is lost."""
        self.out_until, self.pulls = now + seconds, self.pulls + 1
        self._up.clear()
        self._down.clear()

    def step(self, now: float) -> None:
        """Deliver what is due to the firmware, and send what it answers."""
        while self._up and self._up[0][0] <= now:
            reply = self.firmware.receive(self._up.pop(0)[1])
            delay = 0.0
            if self.faults is not None and reply:
                spoiled = self.faults.reply(reply)
                reply, delay = spoiled.data, spoiled.delay
            if reply:
                ready = now + PROCESSING_TIME_S + delay
                self._last_down = max(ready, self._last_down) + len(reply) * self._byte_s
                self._down.append((self._last_down, reply))
        self.firmware.update()

    def take(self, now: float) -> bytes:
        """What has come to the computer by now."""
        out = b""
        while self._down and self._down[0][0] <= now:
            out += self._down.pop(0)[1]
        return out

    def next_due(self) -> float | None:
        """When something arrives at either end; None while the line is quiet."""
        return min((queue[0][0] for queue in (self._up, self._down) if queue), default=None)


class VirtualClock:
    """A clock that jumps: waiting takes no time, and what is on the line arrives in order."""

    def __init__(self) -> None:
        """Start at 0."""
        self._time = 0.0
        self.line: Line | None = None

    def now(self) -> float:
        """Seconds."""
        return self._time

    def sleep(self, seconds: float) -> None:
        """Jump."""
        self.advance(self._time + seconds)

    def advance(self, until: float) -> None:
        """Jump to that time, stopping where the line has something to deliver to the launcher."""
        while self.line is not None and self.line._up and self.line._up[0][0] <= until:
            self._time = max(self._time, self.line._up[0][0])
            self.line.step(self._time)
        self._time = max(self._time, until)


class WirePort:
    """A port of the virtual line, with serial.Serial's ways and errors."""

    def __init__(self, line: Line, clock: VirtualClock) -> None:
        """Plug in; OSError while the cable is out."""
        if clock.now() < line.out_until:
            raise OSError(2, "no such port")
        self._line, self._clock, self._pulls = line, clock, line.pulls
        self._held = b""

    def _check(self) -> None:
        if self._pulls != self._line.pulls:
            raise termios.error(5, "Input/output error")

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        self._check()
        self._held += self._line.take(self._clock.now())
        return len(self._held)

    def read(self, size: int = 1, /) -> bytes:
        """Up to `size` bytes, waiting for the first."""
        end = self._clock.now() + READ_SLICE_S
        while not self.in_waiting and self._clock.now() < end:
            due = self._line.next_due()
            self._clock.advance(end if due is None else min(due, end))
        out, self._held = self._held[:size], self._held[size:]
        return out

    def write(self, data: bytes, /) -> int:
        """Send."""
        self._check()
        self._line.put(self._clock.now(), data)
        return len(data)

    def cancel_read(self) -> None:
        """Nobody else reads."""

    def reset_output_buffer(self) -> None:
        """Throw away what is not sent yet."""
        self._check()
        self._line.flush(self._clock.now())

    def close(self) -> None:
        """Pull out."""


class Pace:
    """Real time, run faster for the mechanics; the factor may change on the way."""

    def __init__(self, factor: float = 1.0) -> None:
        """Start at 0."""
        self._factor, self._real, self._own = factor, time.monotonic(), 0.0

    def now(self) -> float:
        """Seconds of the mechanics."""
        return self._own + (time.monotonic() - self._real) * self._factor

    def set(self, factor: float) -> None:
        """Another factor from now on."""
        self._own, self._real = self.now(), time.monotonic()
        self._factor = factor


class Emulator:
    """The launcher on a pseudo-terminal, in a thread; `with Emulator(firmware, baud=...) as e: open(e.path)`.

    The path is a link that leads to the terminal, as udev makes one to a serial port: a cable that was pulled comes
    back at the same path. Look at the firmware only while `lock` is held.
    """

    def __init__(
        self, firmware: Firmware, *, baud: int, faults: FaultInjection | None = None, path: Path | str | None = None
    ) -> None:
        """Not running yet; without a path, one in a folder of its own."""
        self._line = Line(firmware, baud=baud, faults=faults)
        self._folder = None if path is not None else tempfile.TemporaryDirectory(prefix="launcher-")
        self.path = str(path) if path is not None else str(Path(self._folder.name) / "port" if self._folder else "")
        self.firmware, self.lock = firmware, threading.Lock()
        self.failed: BaseException | None = None  # what `on_strike` raised
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
        """The cable comes out for so long."""
        with self.lock:
            self._line.pull(time.monotonic(), seconds)
        os.write(self._wake, b"x")

    def _plug(self) -> None:
        master, slave = os.openpty()  # the slave stays open: without a reader the terminal would hang up
        tty.setraw(slave)
        os.set_blocking(master, False)
        self._ends = (master, slave)
        scratch = Path(f"{self.path}.new")
        scratch.unlink(missing_ok=True)
        scratch.symlink_to(os.ttyname(slave))
        if Path(self.path).exists() and not Path(self.path).is_symlink():
            scratch.unlink()
            raise BadInput(f"{self.path}: is in use; name a path that is free")
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
            with contextlib.suppress(OSError):  # nobody has the other end
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
    """What was written in one go: a fault befalls a line, and a stop byte is one of its own."""
    parts = data.replace(STOP_BYTE, b"\0!\0").replace(b"\n", b"\n\0").split(b"\0")
    return [part for part in parts if part]


def serve(
    path: Path | str | None = None,
    *,
    baud: int = 19200,
    pace: float = 1.0,
    fault_rate: float = 0.0,
    seed: int = 0,
    on_strike: Callable[[float, float, float], None] | None = None,
    say: Callable[[str], None] = print,
    until: threading.Event | None = None,
) -> None:
    """Run an emulated launcher until interrupted, or until an event is set.

    Args:
        path: of the port; a new one without. It is told first.
        baud: of the line [bit/s].
        pace: of the mechanics, in real seconds a second.
        fault_rate: faults a line, 0 to 1.
        seed: of all that is drawn.
        on_strike: called with cue speed [m/s], side and height [m] at every hit.
        say: gets the path and every deed, a line each.
        until: ends it when set.
    """
    if not 0 < pace <= 1000:
        raise BadInput(f"pace is {pace}; give a number above 0, up to 1000")
    rng, chance = np.random.default_rng(seed).spawn(2)
    firmware = Firmware(Pace(pace).now, rng, on_strike=on_strike)
    faults = FaultInjection(fault_rate, chance) if fault_rate else None
    ending, told = until or threading.Event(), 0
    with Emulator(firmware, baud=baud, faults=faults, path=path) as emulator, contextlib.suppress(KeyboardInterrupt):
        say(emulator.path)
        while not ending.wait(0.05):
            with emulator.lock:
                deeds = firmware.deeds[told:]
            told += len(deeds)
            for deed in deeds:
                say(f"{deed.time:9.3f} s  {deed.what:9}  {_told(deed)}".rstrip())


def _told(deed: Deed) -> str:
    tip = f"side {1e3 * deed.x:+.2f} mm, height {1e3 * deed.y:+.2f} mm"
    if deed.what == "struck":
        return f"{deed.string:03d}p  cue {deed.speed:.3f} m/s at {tip}"
    return tip if deed.what == "moved" else ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run an emulated launcher on a pseudo-terminal; its path is printed first."""
    parser = argparse.ArgumentParser(
        prog="python -m robot.emulator.launcher", description=main.__doc__, allow_abbrev=False
    )
    parser.add_argument("--path", help="of the port; a new one without")
    parser.add_argument("--baud", type=int, default=19200)
    parser.add_argument("--pace", type=float, default=1.0, help="of the mechanics, in real seconds a second")
    parser.add_argument("--fault-rate", type=float, default=0.0, help="faults a line, 0 to 1")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the port goes away too
    try:
        say = partial(print, flush=True)
        serve(given.path, baud=given.baud, pace=given.pace, fault_rate=given.fault_rate, seed=given.seed, say=say)
    except BadInput as error:
        print(f"robot.emulator.launcher: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
