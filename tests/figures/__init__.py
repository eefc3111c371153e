"""Measured figures of the pages: they stand once, in docs/figures.toml, and the pages are filled from there."""
