"""The dimensions of snooker: a full-size table, its balls, and their positions at the start of a frame."""

from __future__ import annotations

import numpy as np

from models.shot import Array, Ball, Table

FULL_LENGTH = 3.569  # length of the table in the rules [m]
SNOOKER_TABLE, SNOOKER_BALL = Table(FULL_LENGTH, 1.778), Ball(0.0525, 0.1406)
BAULK_LINE_M, D_RADIUS_M, BLACK_SPOT_M = 0.737, 0.292, 0.324  # the black spot is measured from its cushion
RACK_GAP_M = 0.0005  # gap between racked balls
MAX_SNOOKER_RADIUS_M = 0.027  # between snooker's balls, of 52.5 mm, and pool's, of 57.15 mm


def is_snooker(table: Table, radius: float) -> bool:
    """Whether a table with balls of this radius [m] is one of snooker, with a baulk line and a D."""
    return bool(table.pockets) and radius <= MAX_SNOOKER_RADIUS_M


def spots(table: Table) -> dict[str, Array]:
    """Places of the colours, baulk towards -x: name -> (2,) [m]."""
    k, end = table.length / FULL_LENGTH, table.length / 2
    line = -end + BAULK_LINE_M * k
    places = {"yellow": (line, -D_RADIUS_M * k), "brown": (line, 0), "green": (line, D_RADIUS_M * k)}
    places |= {"blue": (0, 0), "pink": (end / 2, 0), "black": (end - BLACK_SPOT_M * k, 0)}
    return {name: np.array(xy, float) for name, xy in places.items()}


def racked(table: Table, ball: Ball) -> dict[str, Array]:
    """All 22 balls of snooker on their spots, the white in the D: name -> (2,) [m]."""
    places = spots(table)
    step = ball.diameter + RACK_GAP_M
    apex = places["pink"] + [step + RACK_GAP_M, 0.0]
    rows = [(row, k) for row in range(5) for k in range(row + 1)]
    for number, (row, k) in enumerate(rows, start=1):
        places[f"red {number}"] = apex + step * np.array([row * np.sqrt(0.75), k - row / 2])
    places["white"] = places["brown"] + [-0.1 * table.length / 3.569, 0.11 * table.width / 1.778]
    return places
