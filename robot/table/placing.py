"""Positions of balls on a real table in words, for the person who places them.

In: a table and positions. Out: distances from the cushions' noses to the ball's centre.
"""

from __future__ import annotations

from models.shot import Array, Table

PLACING_TOLERANCE_M = 0.03  # distance within which a ball counts as set up: the camera measures its actual position
MAX_PLACING_TRIES = 20  # most requests to put balls in their places


def words_of(table: Table, name: str, xy: Array) -> str:
    """A ball's position (2,) [m] in words, measured from the cushions, to a millimetre."""
    half, ends = (table.length / 2, table.width / 2), (("-x", "+x"), ("-y", "+y"))
    sides = [f"{1e2 * (half[k] - abs(xy[k])):.1f} cm from the {ends[k][int(xy[k] > 0)]} cushion" for k in range(2)]
    return f"{name} {' and '.join(sides)}"
