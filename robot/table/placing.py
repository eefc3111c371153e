"""Where balls go on a real table, in words for whoever puts them there.

In: a table and places. Out: distances from the cushions' noses to the ball's centre.
"""

from __future__ import annotations

from models.shot import Array, Table

PLACING_TOLERANCE_M = 0.03  # of a ball, within which it counts as set up: the camera sees where it really lies
MAX_PLACING_TRIES = 20  # times that a person is asked to put balls in their places


def words_of(table: Table, name: str, xy: Array) -> str:
    """The place (2,) [m] of a ball, measured from the cushions, to a millimetre."""
    half, ends = (table.length / 2, table.width / 2), (("-x", "+x"), ("-y", "+y"))
    sides = [f"{1e2 * (half[k] - abs(xy[k])):.1f} cm from the {ends[k][int(xy[k] > 0)]} cushion" for k in range(2)]
    return f"{name} {' and '.join(sides)}"
