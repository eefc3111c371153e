"""Figures of speed and accuracy, measured side by side in one run: `python -m tests.bench`."""
