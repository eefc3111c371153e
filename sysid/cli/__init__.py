"""The `sysid` command, a file for each group of verbs; imports only downwards."""

from sysid.cli.verbs import main

__all__ = ["main"]
