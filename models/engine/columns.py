"""Columns of a ball in the event engine, by number; compiled code reads them through the module: `b[col.VX]`.

First its state at CLOCK: place, velocity, spin, angle turned about the vertical, angle rolled. Then its acceleration,
when its motion ends, and what it meets of the table by then. For a curve (models/engine/curve.py): when that began, how
long it spans, what the ball does on it, how its end is reached, the largest acceleration on it, and what share of its
motion the next step may take by its error.
"""

from __future__ import annotations

COLUMN_COUNT = 20
(
    X, Y, VX, VY, WX, WY, WZ, TURN, ROLLED, CLOCK, AX, AY, END, MEET, BEGIN, SPAN, MODE, LAST, BOUND, TRY,
) = range(COLUMN_COUNT)  # fmt: skip
STATE_SIZE = 9  # columns of the state, from X to ROLLED
ROW_SIZE = 8  # columns of a ball at one time, as samples have them: place, velocity, spin, angle turned
TERM_COUNT = 6  # terms of the polynomial in time of each column on a curve
