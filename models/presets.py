"""Tables and balls by name: playing surface, pockets, ball.

Sources. Snooker: Official Rules of the Games of Snooker and English Billiards (WPBSA), section 1. Pool: WPA, Tournament
Table and Equipment Specifications, sections 4 and 16: 100 by 50 in and 92 by 46 in, balls of 2.25 in and 5.5 to 6 oz.
The WPA knows no table of 7 ft: 78 by 39 in as pooltool has it (models/pocket_shape.py).
Carom: UMB, World Rules, chapter 1: 2.84 by 1.42 m, balls of 61 to 61.5 mm and 205 to 220 g.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.pocket_shape import INCH_M, POCKET_SETS
from models.shot import Ball, Table

POOL_BALL = Ball(2.25 * INCH_M, 0.163)  # 5.75 oz

CAROM_BALL = Ball(0.0615, 0.2125)


@dataclass(frozen=True)
class TableSet:
    """A table and the balls that are played on it."""

    table: Table
    ball: Ball


def _pool(feet: int, length_in: float) -> TableSet:
    length = length_in * INCH_M
    return TableSet(Table(length, length / 2, POCKET_SETS[f"pool {feet} ft"]), POOL_BALL)


TABLE_SETS: Mapping[str, TableSet] = {
    "snooker": TableSet(SNOOKER_TABLE, SNOOKER_BALL),
    "pool 9 ft": _pool(9, 100.0),
    "pool 8 ft": _pool(8, 92.0),
    "pool 7 ft": _pool(7, 78.0),
    "carom": TableSet(Table(2.84, 1.42, pockets=False), CAROM_BALL),
}
