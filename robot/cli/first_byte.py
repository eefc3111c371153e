"""The first byte of `robot stop`, written before all other imports, which take longer than everything else it does.

In: the words of the command line. Out: a stop byte at the port that `--port` names, where it is a terminal; and the
question to its holder, who would otherwise have ended before it is asked. The byte acts on a launcher whose port
another program holds, and so has set its speed; what follows (robot/device/past_lock.py) sets it, repeats the byte,
and has it confirmed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot.device.relay import Asked

OPTION, STOP_BYTE = "--port", b"!"  # as robot/device/protocol.py has it, which is not imported for one byte
asked: dict[str, Asked] = {}  # holders, by the port that was named


def begin_stop(words: Sequence[str]) -> None:
    """Where the words are those of a stop; nothing that fails here matters."""
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
