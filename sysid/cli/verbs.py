"""The `sysid` command: every verb reads a clip set, prints a table, and writes the same figures where asked."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from models.console import Run, run_verb
from sysid.cli import calibrate, compare, discovery, effects, match, measure, track


def parser() -> argparse.ArgumentParser:
    """Every verb with its options."""
    top = argparse.ArgumentParser(prog="sysid", description="From tracked shots to a fitted MuJoCo table.")
    verbs = top.add_subparsers(dest="verb", required=True, metavar="VERB")

    def verb(name: str, run: Run, text: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=text, description=text)
        one.set_defaults(run=run)
        return one

    for group in (compare, effects, discovery, calibrate, track, measure, match):
        group.register(verb)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 a finding to act on, 2 bad input."""
    kept = "; files already named above are complete, no other was written"
    return run_verb("sysid", parser().parse_args(argv), kept)


if __name__ == "__main__":
    sys.exit(main())
