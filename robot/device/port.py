"""Serial ports to the launcher, as the link reads and writes them.

Unplugging raises termios.error, which is no OSError. Leaves out ports that are not POSIX terminals.
"""

from __future__ import annotations

import termios
from collections.abc import Callable
from typing import Protocol

from robot.device.settings import PortSettings

PORT_ERRORS = (OSError, termios.error)  # serial.SerialException is an OSError
READ_SLICE_S = 0.02  # of waiting in a read [s]: how late a stop is seen if it does not wake the reader


class Port(Protocol):
    """What is used of serial.Serial."""

    @property
    def in_waiting(self) -> int: ...
    def read(self, size: int = 1, /) -> bytes: ...  # fewer bytes when READ_SLICE_S is over or the read is cancelled
    def write(self, data: bytes, /) -> int | None: ...
    def cancel_read(self) -> None: ...
    def reset_output_buffer(self) -> None: ...
    def close(self) -> None: ...


def serial_opener(port: PortSettings) -> Callable[[], Port]:
    """Opens that serial port, for this program alone."""

    def opened() -> Port:
        import serial

        return serial.Serial(port.device, port.baud, timeout=READ_SLICE_S, write_timeout=0.2, exclusive=True)

    return opened
