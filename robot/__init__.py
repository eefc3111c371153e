"""The launcher: driver and emulator, cueing map, play of plans, and the loop that learns from shots."""
