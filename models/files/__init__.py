"""Files of users and of our own: read within bounds, decoded, their faults collected; written whole or not at all.

limits      the budgets of all readers
documents   TOML, JSON and text, read within bounds
writing     files written, and lines added, whole or not at all
made        results replaced by the command and input that made them, or not at all; record: what says so in a file
decode      parsed data into dataclasses, with every fault by its place
tables      CSV, row by row
texts       columns of texts, packed
alone       one run at a time in a place
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
