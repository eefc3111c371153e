"""Serial ports to the launcher, as the link reads and writes them.

Unplugging raises termios.error, which is not an OSError. Left out: ports that are not POSIX terminals.
"""

from __future__ import annotations

import termios
from collections.abc import Callable
from typing import Protocol

from robot.device.relay import WHO, ask, this_program
from robot.device.settings import PortSettings

PORT_ERRORS = (OSError, termios.error)  # serial.SerialException is an OSError
HOLDER_S = 0.5  # longest wait for the name of a port's holder
READ_SLICE_S = 0.02  # longest wait in a read: the delay of a stop that does not wake the reader


class PortHeld(OSError):
    """Another program holds the port."""


class Port(Protocol):
    """The part of serial.Serial that is used here."""

    @property
    def name(self) -> str | None: ...  # of the device; None for an emulated line
    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...  # fewer bytes after READ_SLICE_S or a cancelled read
    def write(self, data: bytes, /) -> int | None: ...
    def cancel_read(self) -> None: ...
    def reset_output_buffer(self) -> None: ...
    def close(self) -> None: ...


def serial_opener(port: PortSettings, *, past_lock: bool = False) -> Callable[[], Port]:
    """Opens a serial port exclusively; with `past_lock` even if another program holds it."""

    def opened() -> Port:
        import serial

        try:
            lock = None if past_lock else True
            return serial.Serial(port.device, port.baud, timeout=READ_SLICE_S, write_timeout=0.2, exclusive=lock)
        except serial.SerialException as error:
            if "lock" not in str(error):
                raise
            who = ask(port.device, WHO, this_program(), HOLDER_S) or "another program"
            raise PortHeld(f"{who} holds it; wait until it ends, or stop the launcher with: robot stop") from None

    return opened
