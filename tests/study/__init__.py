"""How reliably `sysid discover` finds what is hidden in clips of the independent generator: `python -m tests.study`."""
