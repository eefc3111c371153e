"""Files of our own: an entry that is missing or of another kind is told in a line."""

from __future__ import annotations

import math
import os
from collections.abc import Callable
from pathlib import Path

import pytest

from models.errors import BadInput
from models.files import entries_of, read_document, write_whole
from models.files.faults import Faults
from models.files.tables import csv_rows
from sysid.vision.camera.projection import read_camera

ENTRIES = {"value": 3}
DAMAGES: dict[str, Callable[[], object]] = {
    "gone": lambda: ENTRIES["sd"],
    "no table": lambda: ENTRIES["value"]["x"],  # type: ignore[index]
    "no number": lambda: float([]),  # type: ignore[arg-type]
    "text": lambda: float("x"),
    "too large": lambda: math.exp(1e9),
}


@pytest.mark.parametrize("read", DAMAGES.values(), ids=DAMAGES.keys())
def test_a_damaged_entry_is_told_in_a_line(read: Callable[[], object]) -> None:
    with pytest.raises(BadInput, match=r"^a\.json: .*; make it again$"), entries_of("a.json", "make it again"):
        read()


def test_a_refusal_of_its_own_stays() -> None:
    with pytest.raises(BadInput, match="as it was"), entries_of("a.json", "make it again"):
        raise BadInput("as it was")


def test_what_is_no_file_is_not_replaced_by_one(tmp_path: Path) -> None:
    """Not a device either: a program that may do anything would take it from everyone."""
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(BadInput, match="is not a regular file; name another"):
        write_whole(pipe, b"text")
    assert pipe.is_fifo() and list(tmp_path.iterdir()) == [pipe]


@pytest.mark.parametrize(
    ("begin", "kind"), [(b"\x89PNG\r\n\x1a\n\x00", "a PNG picture"), (b"PK\x03\x04\x14", "a ZIP archive")]
)
def test_what_is_no_text_is_named(tmp_path: Path, begin: bytes, kind: str) -> None:
    path, faults = tmp_path / "file", Faults()
    path.write_bytes(begin + bytes(range(256)))
    with pytest.raises(BadInput, match=rf"is {kind}.*: make a camera file with: sysid calibrate"):
        read_camera(path)
    with pytest.raises(BadInput, match=rf"is {kind}.*: save it as CSV"):
        list(csv_rows(path, "t.csv", faults, "save it as CSV"))


def test_tables_and_documents_in_utf_16_are_read(tmp_path: Path) -> None:
    (tmp_path / "t.csv").write_text("t,ball\n0.5,weiß\n", encoding="utf-16")
    assert [row for _, row in csv_rows(tmp_path / "t.csv", "t.csv", Faults(), "")] == [["t", "ball"], ["0.5", "weiß"]]
    (tmp_path / "d.toml").write_text('name = "weiß"\n', encoding="utf-16")
    assert read_document(tmp_path / "d.toml", "d.toml", Faults(), "") == {"name": "weiß"}
    (tmp_path / "t.csv").write_bytes(b"\xff\xfea")
    with pytest.raises(BadInput, match="begins as UTF-16 text, but is not"):
        list(csv_rows(tmp_path / "t.csv", "t.csv", Faults(), ""))
