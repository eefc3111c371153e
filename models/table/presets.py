"""Tables and balls by name: playing surface, pockets, ball.

Sources. Snooker: Official Rules of the Games of Snooker and English Billiards (WPBSA), section 1. Pool: WPA, Tournament
Table and Equipment Specifications, sections 4 and 16: 100 by 50 in and 92 by 46 in, balls of 2.25 in and 5.5 to 6 oz.
The WPA knows no table of 7 ft: 78 by 39 in as pooltool has it (pocket_shape.py). Nor has it the 8 ft table of 88
by 44 in that makers sell besides, for homes and leagues: twice as long as wide, as the BCA asks (Equipment
Specifications), which names no inches for 8 ft. Its pockets are taken to be the WPA's.
Carom: UMB, World Rules, chapter 1: 2.84 by 1.42 m, balls of 61 to 61.5 mm and 205 to 220 g.
Left out: smaller snooker tables. The rules define only the full size, and makers differ by inches: 10 ft is 3.05 by
1.52 m in guides, and 2.97 by 1.48 m in proportion to the full-size table's 12 ft.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from difflib import get_close_matches
from typing import Any

from models.errors import BadInput
from models.files.faults import shown
from models.files.limits import MAX_NAME_CHARS
from models.files.place import Place
from models.shot import Ball, Table
from models.table.pocket_shape import INCH_M, POCKET_SETS
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

POOL_BALL = Ball(2.25 * INCH_M, 0.163)  # 5.75 oz

CAROM_BALL = Ball(0.0615, 0.2125)
BALL_GAMES: Mapping[str, Ball] = {"snooker": SNOOKER_BALL, "pool": POOL_BALL, "carom": CAROM_BALL}


@dataclass(frozen=True)
class TableSet:
    """A table and its balls."""

    table: Table
    ball: Ball


def _pool(pockets: str, length_in: float) -> TableSet:
    length = length_in * INCH_M
    return TableSet(Table(length, length / 2, POCKET_SETS[pockets]), POOL_BALL)


TABLE_SETS: Mapping[str, TableSet] = {
    "snooker": TableSet(SNOOKER_TABLE, SNOOKER_BALL),
    "pool 9 ft": _pool("pool 9 ft", 100.0),
    "pool 8 ft": _pool("pool 8 ft", 92.0),
    "pool 8 ft home": _pool("pool 8 ft", 88.0),
    "pool 7 ft": _pool("pool 7 ft", 78.0),
    "carom": TableSet(Table(2.84, 1.42, pockets=False), CAROM_BALL),
}
OTHER_NAMES: Mapping[str, str] = {
    "snooker 12 ft": "snooker",
    "carom 10 ft": "carom",
    "12 ft": "snooker",
    "88x44 in": "pool 8 ft home",
}
MIN_LENGTH_M, MAX_LENGTH_M, MIN_WIDTH_M, MAX_WIDTH_M = 0.3, 6.0, 0.2, 3.0


def find_table(text: str) -> TableSet | Table:
    """A table and its balls by name, or a table by its size, such as 1.881x0.943; BadInput names similar ones.

    Names may be written in capitals, without spaces, and those of pool without "pool": 8ft is "pool 8 ft".
    """
    by_plain = {_plain(name): name for name in (*TABLE_SETS, *OTHER_NAMES)}
    by_plain |= {_plain(name).removeprefix("pool"): name for name in TABLE_SETS if name.startswith("pool")}
    name = by_plain.get(_plain(text))
    if name is not None:
        return TABLE_SETS[OTHER_NAMES.get(name, name)]
    if re.match(r"[\d.]", text) and "x" in text.lower():
        return _sized(text)
    near = get_close_matches(_plain(text), by_plain, 1, cutoff=0.75)
    feet = re.search(r"\d+", text)
    if near and (feet is None or feet[0] in near[0]):
        raise BadInput(f'{text}: is not a known table; did you mean "{by_plain[near[0]]}"?')
    if "snooker" in text.lower() and feet is not None:
        raise BadInput(
            f"{text}: the rules of snooker define only the full size of 12 ft, and makers differ; measure yours from "
            "nose to nose and give that in metres: 10 ft is about 2.97x1.48, with balls of 0.0525"
        )
    if "tournament" in text.lower():
        raise BadInput(
            f'{text}: of 8 ft, the tables of WPA tournaments have 92 by 46 in between the noses, "pool 8 ft", and '
            'others that are sold as such 88 by 44 in, "pool 8 ft home": measure yours, and give one of these'
        )
    raise BadInput(
        f"{text}: is not a known table; give one of {', '.join(TABLE_SETS)}, or length and width from nose to nose "
        "in metres, such as 1.881x0.943"
    )


def named_table(entries: Mapping[str, Any], place: Place) -> Mapping[str, Any]:
    """A file's entries, in which a name as `table` is replaced by [table], and by missing entries of [ball].

    Args:
        entries: of the file's top level.
        place: receives the fault of an unknown name.
    """
    name = entries.get("table")
    if not isinstance(name, str):
        return entries
    found: TableSet | Table = TABLE_SETS["snooker"]
    try:
        found = find_table(name[:MAX_NAME_CHARS])
    except BadInput as problem:
        why = str(problem).removeprefix(f"{name[:MAX_NAME_CHARS]}: ")
        place.fault(f"table = {shown(name)}: {why}, or write [table]", "table")
    if isinstance(found, Table):
        return {**entries, "table": asdict(found)}
    ball = entries.get("ball", {})
    ball = {**asdict(found.ball), **ball} if isinstance(ball, Mapping) else ball
    return {**entries, "table": asdict(found.table), "ball": ball}


def usual_mass(diameter: float) -> tuple[float, str]:
    """Mass of a ball [kg] with the density of the game's ball nearest in size, and that game."""
    name = min(BALL_GAMES, key=lambda game: abs(BALL_GAMES[game].diameter - diameter))
    ball = BALL_GAMES[name]
    return ball.mass * (diameter / ball.diameter) ** 3, name


def _plain(name: str) -> str:
    """A name in lowercase, without signs and units of feet."""
    return re.sub(r"foot|feet|'", "ft", re.sub(r"[\s_.-]", "", name.lower()))


def _sized(text: str) -> Table:
    """A table of a size in metres, with the pockets of snooker."""
    try:
        length, width = (float(part) for part in text.lower().split("x"))
    except ValueError:
        length = width = 0.0
    if not (MIN_LENGTH_M <= length <= MAX_LENGTH_M and MIN_WIDTH_M <= width <= min(MAX_WIDTH_M, length)):
        raise BadInput(f"{text}: give length and width in metres, the longer first, such as 1.881x0.943")
    return Table(length, width)
