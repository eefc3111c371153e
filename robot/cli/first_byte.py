"""The first byte of `robot stop`, written before anything else is imported: that takes longer than all the rest.

In: the words of the command line. Out: a stop byte at the port that `--port` names, where it is a terminal. It acts on
a launcher whose port another program holds, and so has set its speed; what follows (robot/device/past_lock.py) sets
it, repeats the byte, and has it confirmed.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence

OPTION, STOP_BYTE = "--port", b"!"  # as robot/device/protocol.py has it, which is not imported for one byte


def write_first_byte(words: Sequence[str]) -> None:
    """Where the words are those of a stop; nothing that fails here matters."""
    if not words or words[0] != "stop":
        return
    for word, next_word in zip(words, [*words[1:], ""], strict=True):
        option, _, value = word.partition("=")
        if option != OPTION:
            continue
        port = value or next_word
        with contextlib.suppress(OSError, ValueError):
            end = os.open(port, os.O_WRONLY | os.O_NOCTTY | os.O_NONBLOCK)
            try:
                if os.isatty(end):
                    os.write(end, STOP_BYTE)
            finally:
                os.close(end)
