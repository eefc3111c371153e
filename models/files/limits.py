"""Limits on the content of files, checked before the work that they bound.

In: counts. Out: "" or a fault, with figure, limit and remedy.

A game of 22 balls at 1000 frames a second for a minute, with tens of further columns, is within all of them. Files
within the limits are read in less than 2 GB; others are refused in a line before they cost memory or hours.
"""

from __future__ import annotations

MAX_TOML_BYTES = 4 << 20  # size of a TOML file: a clip set of ten thousand shots
MAX_JSON_BYTES = 32 << 20  # size of a JSON file written by this project
MAX_TEXT_BYTES = 32 << 20  # size of any other text
MAX_TRACKS_JSON_BYTES = 256 << 20  # size of a JSON file of another program
MAX_CONTAINERS, MAX_VALUES = 3 << 19, 1 << 24  # number of objects and lists in a JSON file, and of their elements
MAX_DEPTH = 32  # nesting depth of tables and lists, and parts of a dotted key

MAX_TABLE_BYTES = 1 << 30  # size of a CSV or Parquet file
MAX_CELL_BYTES = MAX_TABLE_BYTES // 2  # size of its texts in memory, which are copied as they grow
MAX_ROWS, MAX_COLUMNS = 2_000_000, 256  # size of a table
MAX_CELLS = 1 << 26  # number of cells of a table
MAX_CELL_CHARS = 10_000
MAX_LINE_CHARS = 1 << 24  # length of a line of CSV
MAX_CELL_LINES = 1000  # lines spanned by a row of CSV
MAX_PARQUET_HEAD_BYTES = 16 << 20  # size of a Parquet file's metadata
MAX_SET_BYTES = 4 << 30  # size of all clips of a set

MAX_BALLS = 256  # names of balls in a shot, including several that a tracker gives one ball
MAX_NAME_CHARS = 100  # length of the name of a ball or a constant

MAX_PICTURE_PIXELS = 1 << 26  # size of a picture or a film: twice 8K video
MAX_FRAMES = 2_000_000  # length of a film: half an hour at 1000 frames/s

MAX_FILE_FAULTS, MAX_FAULTS = 1000, 20_000  # faults of one file, and of all, after which reading stops


def excess(count: float, most: float, what: str, remedy: str, unit: float = 1) -> str:
    """The fault of a count above its limit; "" if it is within.

    Args:
        count: the count.
        most: its limit.
        what: the counted things, such as "rows".
        remedy: the remedy.
        unit: unit of both in messages, such as 1 << 20 for MB.
    """
    if count <= most:
        return ""
    more, limit = (f"{v / unit:.4g}" if unit > 1 else f"{v:.0f}" for v in (count, most))
    return f"has {more} {what}, the limit is {limit}: {remedy}"
