"""A stop regardless of who holds the port: first the byte, which depends on nothing, then its confirmation.

In: settings. Out: `Stopped`, and who held the port.

The byte is written immediately, through a port that is opened without the lock, and again every STOP_WAIT_S until the
stop is confirmed. Two readers of one port would take each other's bytes, so if one of our programs holds it, that
program is asked to stop as well, and confirms the launcher's answer. A program that hangs or is suspended reads
nothing; then, or if nothing holds the port, the answer is read here.
"""

from __future__ import annotations

import threading
import time
from pathlib import Path

from models.errors import BadInput
from robot.device.link import STOP_WAIT_S, Link
from robot.device.outcome import Stopped
from robot.device.port import serial_opener
from robot.device.relay import STOP, Asked, Holder, begin, this_program
from robot.device.settings import Settings

HOLDER_CONFIRMS_S = 1.0  # longest time that the port's holder may take to confirm the stop


def stop_past_lock(
    settings: Settings, log: Path | str | None = None, asked: Asked | None = None
) -> tuple[Stopped, Holder | None]:
    """Stop the launcher, whoever holds its port.

    Args:
        settings: with the port.
        log: gets every exchange.
        asked: an earlier question to the holder, if any.

    Raises:
        BadInput: the port cannot be opened, and nothing holds it.
    """
    port, began = settings.port, time.monotonic()
    link = Link(serial_opener(port, past_lock=True), settings.timing, baud=port.baud, log=log, answers=False)
    closed: BadInput | None = None
    try:
        link.open()
    except BadInput as error:  # the cable is out: its holder sends the byte first when it is back
        closed = error
    try:
        sent = int(link.halt())
        found: list[Holder] = []
        asked = asked or begin(port.device, STOP, this_program())
        if asked is not None:
            waiting = threading.Thread(target=lambda: found.append(asked.answered(HOLDER_CONFIRMS_S)), daemon=True)
            waiting.start()
            waiting.join(STOP_WAIT_S)
            while waiting.is_alive():
                sent += link.halt()
                waiting.join(STOP_WAIT_S)
        holder = found[0] if found else None
        if holder is not None and holder.answer is not None and holder.answer.get("confirmed"):
            seconds, state = time.monotonic() - began, str(holder.answer.get("interrupted", ""))
            return Stopped(True, sent + int(holder.answer.get("bytes_sent", 0)), seconds, state), holder
        if closed is not None and holder is None:
            raise closed
        own = link.stop()  # opens the port as soon as its cable is back
        return Stopped(own.confirmed, sent + own.bytes_sent, time.monotonic() - began, own.interrupted), holder
    finally:
        link.close()
