"""Output of all commands: exit statuses, progress, tables, and JSON files that are complete or absent."""

from __future__ import annotations

import json
import logging
import math
import os
import shutil
import sys
import textwrap
import time
from collections.abc import Sequence
from enum import IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, TextIO

import click

from models.files import write_whole

if TYPE_CHECKING:
    from models.model_file import Model

STANDARD_OUTPUT = "-"  # name of standard output as a file to write
OUTPUT_KEY = "models.standard_output"  # key of the click context for the real standard output
CONTINUED_INDENT = "  "  # indent of a row whose first cell is on the line above
MAX_NAMED = 4  # most names in a message
PIPED_INTERVAL_S = 5.0  # interval of progress lines without a terminal


class Status(IntEnum):
    """Exit statuses; those of signals are 128 plus the signal's number, as in shells."""

    DONE = 0
    FINDING = 1  # a finding that requires action by the user
    BAD_INPUT = 2
    INTERRUPTED = 130
    BROKEN_PIPE = 141


class Progress(logging.Handler):
    """Progress on stderr: on a terminal one line that is overwritten, elsewhere an occasional line.

    Called with a line, or given to a logger as its handler.
    """

    def __init__(self) -> None:
        """Start the clock."""
        super().__init__(logging.INFO)
        self.started = self.shown = time.monotonic()
        self.terminal = sys.stderr.isatty()
        self.quiet = False  # whether nothing is shown

    def __call__(self, line: str) -> None:
        """Show the current step."""
        now = time.monotonic()
        if self.quiet:
            return
        if self.terminal:
            print(f"\r\x1b[K{now - self.started:5.0f} s  {line}", end="", file=sys.stderr, flush=True)
        elif now - self.shown > PIPED_INTERVAL_S:
            print(f"{now - self.started:5.0f} s  {line}", file=sys.stderr, flush=True)
            self.shown = now

    def emit(self, record: logging.LogRecord) -> None:
        """Show a logged line."""
        self(record.getMessage())

    def close(self) -> None:
        """Clear the line on the terminal."""
        if self.terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def show_progress() -> Progress:
    """Show the log of the packages as progress, replacing an earlier handler."""
    shown = Progress()
    for name in ("models", "sysid", "planner", "robot"):
        log = logging.getLogger(name)
        for old in [h for h in log.handlers if isinstance(h, Progress)]:
            log.removeHandler(old)
        log.addHandler(shown)
        log.setLevel(logging.INFO)
    return shown


def plain(value: Any) -> Any:
    """A value for JSON: NaN and infinity become null, numbers of arrays become Python's."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return value.item() if hasattr(value, "item") else value


def write_json(path: Path | str, data: Any) -> None:
    """Write a JSON file completely or not at all, or to standard output for "-"; NaN becomes null."""
    text = json.dumps(plain(data), indent=1) + "\n"
    if str(path) == STANDARD_OUTPUT:
        output: TextIO = click.get_current_context().meta[OUTPUT_KEY]
        output.write(text)
        output.flush()
        return
    write_whole(path, text.encode())


def as_called(command: str) -> str:
    """A command line that can be pasted: the program has its folder if the shell would not find it."""
    program, _, words = command.partition(" ")
    if shutil.which(program) is None:
        for beside in (Path(sys.argv[0]).with_name(program), Path(sys.executable).with_name(program)):
            if beside.is_file():
                near = os.path.relpath(beside)
                return f"{beside if near.startswith('..') else near} {words}"
    return command


def named(names: Sequence[str]) -> str:
    """A list of names in words, shortened if there are many."""
    rest = len(names) - MAX_NAMED
    return ", ".join(names[:MAX_NAMED]) + (f" and {rest} more" if rest > 0 else "")


def table(rows: Sequence[Sequence[str]], right: int = 1) -> str:
    """Text in columns: the first `right` columns aligned left, the others right.

    On a narrower terminal the first column is on separate lines, with the others below.
    """
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    whole = _in_columns(rows, right)
    if max(map(len, whole), default=0) <= width or len(rows[0]) < 3:
        return "\n".join(whole)
    below = _in_columns([row[1:] for row in rows], right - 1)
    lines = []
    for row, rest in zip(rows, below, strict=True):
        lines += [*textwrap.wrap(row[0], width), f"{CONTINUED_INDENT}{rest}"]
    return "\n".join(lines)


def _in_columns(rows: Sequence[Sequence[str]], right: int) -> list[str]:
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [c.ljust(w) if k < right else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return lines


def print_constants(model: Model) -> None:
    """Print constants with their uncertainty, unit and source."""
    rows = [("constant", "value", "sd", "unit", "from")]
    for name, value in model.parameters().items():
        known = model.estimates.get(name)
        sd = known.sd if known else math.nan
        source = known.source if known and known.source else "not fitted"
        digits = 6 if not math.isfinite(sd) or sd <= 0 else max(0, 1 - math.floor(math.log10(sd)))
        shown = f"{sd:.{digits}f}" if math.isfinite(sd) else "-"
        rows.append((name, f"{value:.{digits}f}", shown, model.meta(name)["unit"], source))
    print(table(rows))
