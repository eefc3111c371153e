"""The cue before a strike: its axis, its tip, its motion."""
