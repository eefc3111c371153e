"""The launcher: driver and emulator, what its strokes do, plans played on it, and the loop that learns from them."""
