"""What commands say: status, streams, and the one line of a refusal."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "sysid" / "example"


@dataclass(frozen=True)
class Said:
    """What a command left on the terminal."""

    status: int
    out: str
    err: str


def said_by(
    command: Callable[[Sequence[str]], int], words: Sequence[object], capsys: pytest.CaptureFixture[str]
) -> Said:  # fmt: skip
    """What a command says to words of a command line."""
    capsys.readouterr()
    status = command([str(w) for w in words])
    out, err = capsys.readouterr()
    return Said(status, out, err)


def one_line(said: Said) -> str:
    """The error of a refused command: one line, the verb first, no traceback; after progress on a busy machine."""
    assert said.status == 2
    [line] = [line for line in said.err.splitlines() if not re.match(r" *\d+ s  ", line)]
    assert line.startswith("sysid ") and line.isprintable() and "Traceback" not in said.out
    return line
