"""The `robot` command, a file for each group of verbs."""

from robot.cli.verbs import main

__all__ = ["main"]
