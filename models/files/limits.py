"""How much a file may hold: the budgets of all readers, checked before the work that they bound is done.

In: counts. Out: "" or what is wrong, with figure, limit and remedy.

A game of 22 balls at 1000 frames a second for a minute, with tens of further columns, is within all of them. What is
within them is read in less than 2 GB; what is not is refused in a line before memory or hours are spent on it.
"""

from __future__ import annotations

MAX_TOML_BYTES = 4 << 20  # of a TOML file: a clip set of ten thousand shots
MAX_JSON_BYTES = 32 << 20  # of a JSON file that a program here wrote
MAX_TEXT_BYTES = 32 << 20  # of a text that is neither
MAX_TRACKS_JSON_BYTES = 256 << 20  # of a JSON file of another program
MAX_CONTAINERS, MAX_VALUES = 3 << 19, 1 << 24  # of a JSON file: objects and lists, and what they hold
MAX_DEPTH = 32  # of tables and lists in each other, and parts of a dotted key

MAX_TABLE_BYTES = 1 << 30  # of one CSV or Parquet file
MAX_CELL_BYTES = MAX_TABLE_BYTES // 2  # of its texts in memory, which are copied as they grow
MAX_ROWS, MAX_COLUMNS = 2_000_000, 256  # of one table
MAX_CELLS = 1 << 26  # of one table
MAX_CELL_CHARS = 10_000
MAX_LINE_CHARS = 1 << 24  # of a line of CSV
MAX_CELL_LINES = 1000  # that one row of CSV may span
MAX_PARQUET_HEAD_BYTES = 16 << 20  # of what a Parquet file says of itself
MAX_SET_BYTES = 4 << 30  # of all clips of a set

MAX_BALLS = 256  # of one shot: of all games, with the names that a tracker gives one ball after another
MAX_NAME_CHARS = 100  # of a ball or a constant

MAX_PICTURE_PIXELS = 1 << 26  # of a picture or a film: twice those of 8K video
MAX_FRAMES = 2_000_000  # of a film: half an hour at 1000 frames/s

MAX_FILE_FAULTS, MAX_FAULTS = 1000, 20_000  # of one file and of all, after which reading stops


def excess(count: float, most: float, what: str, remedy: str, unit: float = 1) -> str:
    """What is wrong with a count above its limit; "" for none.

    Args:
        count: how many there are.
        most: how many there may be.
        what: of what, such as "rows".
        remedy: what to do.
        unit: of both, in messages: 1 << 20 for MB.
    """
    if count <= most:
        return ""
    more, limit = (f"{v / unit:.4g}" if unit > 1 else f"{v:.0f}" for v in (count, most))
    return f"has {more} {what}, the limit is {limit}: {remedy}"
