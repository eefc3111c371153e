"""The `robot` command, a file for each group of verbs."""

import sys
from collections.abc import Sequence

from robot.cli.first_byte import begin_stop

__all__ = ["main"]


def main(words: Sequence[str] | None = None) -> int:
    """Run a verb (robot/cli/verbs.py); for a stop the first byte is written before anything else."""
    begin_stop(sys.argv[1:] if words is None else words)
    from robot.cli.verbs import main as run_verb

    return run_verb(words)
