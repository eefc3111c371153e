"""What all commands have in common: verbs, exit codes, progress, tables, JSON files that are whole or absent."""

from __future__ import annotations

import argparse
import json
import logging
import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.errors import BadInput
from models.files import write_whole

if TYPE_CHECKING:
    from models.model_file import Model


DONE, FOUND, BAD, INTERRUPTED = 0, 1, 2, 130  # exit codes: done, a finding to act on, bad input, interrupted


class Progress(logging.Handler):
    """One line on a terminal that is written over; on a pipe a line now and then.

    Called with a line, or given to a logger as its handler.
    """

    def __init__(self) -> None:
        """Start the clock."""
        super().__init__(logging.INFO)
        self.began = self.shown = time.monotonic()
        self.terminal = sys.stderr.isatty()

    def __call__(self, line: str) -> None:
        """Show what is being done."""
        now = time.monotonic()
        if self.terminal:
            print(f"\r\x1b[K{now - self.began:5.0f} s  {line}", end="", file=sys.stderr, flush=True)
        elif now - self.shown > 5:
            print(f"{now - self.began:5.0f} s  {line}", file=sys.stderr, flush=True)
            self.shown = now

    def emit(self, record: logging.LogRecord) -> None:
        """Show a logged line."""
        self(record.getMessage())

    def close(self) -> None:
        """Leave the terminal clean."""
        if self.terminal:
            print("\r\x1b[K", end="", file=sys.stderr, flush=True)


def progress_of(logger: str = "sysid") -> Progress:
    """Progress that shows what a logger is told, in place of any other."""
    log, shown = logging.getLogger(logger), Progress()
    for old in [h for h in log.handlers if isinstance(h, Progress)]:
        log.removeHandler(old)
    log.addHandler(shown)
    log.setLevel(logging.INFO)
    return shown


Run = Callable[[argparse.Namespace, Progress], int]
Verb = Callable[[str, Run, str], argparse.ArgumentParser]  # makes a verb of its name, what runs it, and what it is


def run_verb(
    program: str, args: argparse.Namespace, interrupted: str, faults: tuple[type[Exception], ...] = ()
) -> int:  # fmt: skip
    """Run the verb of a command line, its faults one line each; `faults` are those that a user must act on."""
    # Matrices are small here: threads of linear algebra wait for each other longer than they work. NumPy comes later.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    progress = progress_of()
    told: tuple[type[Exception], ...] = (BadInput, *faults)
    try:
        args.own = own_effects(getattr(args, "effects", ()))
        return int(args.run(args, progress))
    except told as error:
        progress.close()
        print(f"{program} {args.verb}: {error}", file=sys.stderr)
        return BAD if isinstance(error, BadInput) else FOUND
    except KeyboardInterrupt:
        progress.close()
        print(f"{program} {args.verb}: interrupted{interrupted}", file=sys.stderr)
        return INTERRUPTED


def own_effects(folders: Sequence[str]) -> list[str]:
    """Let a user's folders of effects join the catalogue; returns their names."""
    if not folders:
        return []
    from models.model_file import add_folder

    return [name for folder in folders for name in add_folder(folder)]


def check_outputs(*paths: str | None) -> None:
    """Refuse before the work what could not be written after it."""
    for path in paths:
        if path and not Path(path).resolve().parent.is_dir():
            raise BadInput(f"{path}: its folder does not exist; make it or choose another place")
        if path and Path(path).is_dir():
            raise BadInput(f"{path}: is a folder; name a file")


def write_json(path: str, data: Any) -> None:
    """Write a JSON file whole or not at all; NaN becomes null."""

    def plain(value: Any) -> Any:
        if isinstance(value, float):
            return value if math.isfinite(value) else None
        if isinstance(value, dict):
            return {str(k): plain(v) for k, v in value.items()}
        if isinstance(value, list | tuple):
            return [plain(v) for v in value]
        return value.item() if hasattr(value, "item") else value

    write_whole(path, (json.dumps(plain(data), indent=1) + "\n").encode())


def table(rows: Sequence[Sequence[str]], right: int = 1) -> str:
    """Text columns; the first ones left, the others right."""
    widths = [max(len(r[k]) for r in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [c.ljust(w) if k < right else c.rjust(w) for k, (c, w) in enumerate(zip(row, widths, strict=True))]
        lines.append("  ".join(cells).rstrip())
    return "\n".join(lines)


def print_constants(model: Model) -> None:
    """Constants with their uncertainty, unit and where they come from."""
    rows = [("constant", "value", "sd", "unit", "from")]
    for name, value in model.parameters().items():
        known = model.estimates.get(name)
        sd = known.sd if known else math.nan
        source = known.source if known and known.source else "not fitted"
        digits = 6 if not math.isfinite(sd) or sd <= 0 else max(0, 1 - math.floor(math.log10(sd)))
        shown = f"{sd:.{digits}f}" if math.isfinite(sd) else "-"
        rows.append((name, f"{value:.{digits}f}", shown, model.meta(name)["unit"], source))
    print(table(rows))
