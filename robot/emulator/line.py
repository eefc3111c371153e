"""The emulated cable between computer and launcher, and a virtual clock on which waiting takes no time.

In: the firmware, the baud rate, faults to inject. Out: a port as the link uses it (robot/device/port.py). A byte takes
10 / baud seconds (start, eight bits, stop), a reply its processing time. On the virtual clock the same seed gives the
same run. Left out: flow control, parity and modem lines.
"""

from __future__ import annotations

import termios

from robot.device.port import READ_SLICE_S
from robot.emulator.faults import FaultInjection
from robot.emulator.firmware import Firmware

PROCESSING_TIME_S = 0.001  # time of the microcontroller for a request; PIC18F458 at 10 MIPS, C


class Line:
    """The cable with the firmware at its end: bytes in transit, with their arrival times."""

    def __init__(self, firmware: Firmware, *, baud: int, faults: FaultInjection | None = None) -> None:
        """Create an idle line."""
        self.firmware, self.faults, self._byte_s = firmware, faults, 10.0 / baud
        self._up: list[tuple[float, bytes]] = []
        self._down: list[tuple[float, bytes]] = []
        self._last_up = self._last_down = 0.0
        self.out_until = -1.0  # time until which the cable is out
        self.pulls = 0  # number of disconnections; ports opened before the last one are dead

    def put(self, now: float, data: bytes) -> None:
        """Accept bytes written by the computer."""
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
        """Discard bytes that the computer has not sent yet."""
        self._up = [(due, data) for due, data in self._up if due - len(data) * self._byte_s <= now]
        self._last_up = self._up[-1][0] if self._up else now

    def pull(self, now: float, seconds: float) -> None:
        """Disconnect the cable; bytes in transit are lost."""
        self.out_until, self.pulls = now + seconds, self.pulls + 1
        self._up.clear()
        self._down.clear()

    def step(self, now: float) -> None:
        """Deliver the due bytes to the firmware, and send its answers."""
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
        """The bytes that have reached the computer by now."""
        out = b""
        while self._down and self._down[0][0] <= now:
            out += self._down.pop(0)[1]
        return out

    def next_due(self) -> float | None:
        """Time of the next arrival at either end; None if the line is idle."""
        return min((queue[0][0] for queue in (self._up, self._down) if queue), default=None)


class VirtualClock:
    """A virtual clock: waiting takes no time, and bytes on the line arrive in order."""

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
        """Jump to a time, via all deliveries of the line to the launcher."""
        while self.line is not None and self.line._up and self.line._up[0][0] <= until:
            self._time = max(self._time, self.line._up[0][0])
            self.line.step(self._time)
        self._time = max(self._time, until)


class WirePort:
    """A port of the virtual line, with the behaviour and errors of serial.Serial."""

    name = None

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
        """Number of bytes that can be read immediately."""
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
        """Do nothing: no other thread reads."""

    def reset_output_buffer(self) -> None:
        """Discard bytes that are not sent yet."""
        self._check()
        self._line.flush(self._clock.now())

    def close(self) -> None:
        """Pull out."""
