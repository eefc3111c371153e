"""Verbs that make a clip set: markers, calibrate, track, import, init; and how a table's size is given."""
