"""The `planner` command, a file for each group of verbs."""

from planner.cli.verbs import main

__all__ = ["main"]
