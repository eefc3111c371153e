"""Serial ports to the launcher, as the link reads and writes them.

Unplugging raises termios.error, which is no OSError. Leaves out ports that are not POSIX terminals.
"""

from __future__ import annotations

import termios
from collections.abc import Callable
from typing import Protocol

from robot.device.relay import WHO, ask, this_program
from robot.device.settings import PortSettings

PORT_ERRORS = (OSError, termios.error)  # serial.SerialException is an OSError
HOLDER_S = 0.5  # of waiting for the holder of a port to say who it is
READ_SLICE_S = 0.02  # of waiting in a read [s]: how late a stop is seen if it does not wake the reader


class PortHeld(OSError):
    """Another program has the port."""


class Port(Protocol):
    """What is used of serial.Serial."""

    @property
    def name(self) -> str | None: ...  # of the device; none of an emulated line
    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...  # fewer bytes when READ_SLICE_S is over or the read is cancelled
    def write(self, data: bytes, /) -> int | None: ...
    def cancel_read(self) -> None: ...
    def reset_output_buffer(self) -> None: ...
    def close(self) -> None: ...


def serial_opener(port: PortSettings, *, past_lock: bool = False) -> Callable[[], Port]:
    """Opens that serial port, for this program alone; `past_lock` also where another program has it."""

    def opened() -> Port:
        import serial

        try:
            lock = None if past_lock else True
            return serial.Serial(port.device, port.baud, timeout=READ_SLICE_S, write_timeout=0.2, exclusive=lock)
        except serial.SerialException as error:
            if "lock" not in str(error):
                raise
            who = ask(port.device, WHO, this_program(), HOLDER_S) or "another program"
            raise PortHeld(f"{who} holds it; wait for its end, or stop the launcher with: robot stop") from None

    return opened
