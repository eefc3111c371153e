"""Files: read within limits, decoded, with faults collected; written completely or not at all.

limits      the budgets of all readers
documents   TOML, JSON and text, read within bounds
writing     files written, and lines added, completely or not at all
made        results that only their own command and input replace; record: the mark of the origin in a file
decode      parsed data decoded into dataclasses, with every fault and its place; place: of a table in a file
tables      CSV, row by row
texts       columns of texts, packed
alone       a lock for one run at a time in a place
faults      faults of an input, one line each, with the remedy
"""

from models.files.alone import alone_in
from models.files.documents import (
    entries_of,
    parse,
    read_document,
    read_json,
    read_text,
    read_toml,
)
from models.files.writing import append_whole, made_folder, result_folder, scratch_folder, write_whole

__all__ = [
    "alone_in",
    "append_whole",
    "entries_of",
    "made_folder",
    "parse",
    "read_document",
    "read_json",
    "read_text",
    "read_toml",
    "result_folder",
    "scratch_folder",
    "write_whole",
]
