"""The first byte of `robot stop`, written before all other imports, which take longer than the stop itself.

In: the words of the command line. Out: a stop byte at the port that `--port` names, if that is a terminal; and the
question to its holder, which might otherwise have ended before it is asked. The byte works if another program holds
the port and has set its speed; what follows (robot/device/past_lock.py) sets the speed, repeats the byte, and waits for
the confirmation.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot.device.relay import Asked

OPTION, STOP_BYTE = "--port", b"!"  # as in robot/device/protocol.py, which is not imported for one byte
asked: dict[str, Asked] = {}  # questions to holders, by the port as named


def begin_stop(words: Sequence[str]) -> None:
    """Send the byte if the words are those of a stop; failures here are harmless."""
    if not words or words[0] != "stop":
        return
    for word, following in zip(words, [*words[1:], ""], strict=True):
        option, _, value = word.partition("=")
        if option == OPTION and _wrote_byte(port := value or following):
            from robot.device.relay import STOP, begin, this_program

            if (holder := begin(port, STOP, this_program())) is not None:
                asked[port] = holder


def _wrote_byte(port: str) -> bool:
    with contextlib.suppress(OSError, ValueError):
        end = os.open(port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
        try:
            return os.isatty(end) and os.write(end, STOP_BYTE) > 0
        finally:
            os.close(end)
    return False
