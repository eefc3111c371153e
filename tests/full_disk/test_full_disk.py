"""A disk that is full at any byte: writers end with one line, and leave nothing by halves."""

from __future__ import annotations

import errno
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import pytest

from models.errors import BadInput
from models.files import append_whole, scratch_folder, write_whole
from tests.full_disk.whole import broken
from tests.full_disk.works import ROOT, WORKS

QUICK = ["sysid compare", "sysid add", "sysid init", "sysid review", "robot calibrate"]
LONG = ["sysid demo", "sysid doctor", "sysid track", "planner study", "robot learn"]


def filled(points: int, verbs: list[str]) -> str:
    """What `python -m tests.full_disk` finds wrong; in a process of its own, which may fork."""
    words = [sys.executable, "-m", "tests.full_disk", "--points", str(points), "--verbs", *verbs]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    return "" if done.returncode == 0 else done.stdout + done.stderr[-2000:]


@pytest.mark.slow
def test_verbs_on_a_full_disk() -> None:
    assert filled(2, QUICK) == ""


@pytest.mark.slow
@pytest.mark.thorough
@pytest.mark.parametrize("verb", [verb for verb in WORKS if verb not in QUICK])
def test_every_verb_that_writes_on_a_full_disk(verb: str) -> None:
    assert filled(2 if verb in LONG else 6, [verb]) == ""


@pytest.fixture
def small_files(tmp_path: Path) -> Iterator[Path]:
    """A folder, while files may grow to 100 bytes."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, before[1]))
    try:
        yield tmp_path
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_a_file_is_whole_or_as_it_was(small_files: Path) -> None:
    path = small_files / "a.txt"
    write_whole(path, b"before")
    with pytest.raises(BadInput, match=r"a\.txt: cannot be written \(File too large\); make room on its disk"):
        write_whole(path, b"x" * 101)
    assert path.read_bytes() == b"before" and os.listdir(small_files) == ["a.txt"]


def test_lines_are_added_whole_or_not_at_all(small_files: Path) -> None:
    path = small_files / "a.jsonl"
    for _ in range(3):
        append_whole(path, b"x" * 30 + b"\n")
    with pytest.raises(BadInput, match="make room on its disk"):
        append_whole(path, b"y" * 30 + b"\n")
    assert path.read_bytes() == 3 * (b"x" * 30 + b"\n")


def test_a_film_that_has_no_room_is_none(small_files: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import numpy as np

    from models.recording import viewer

    class Drawn:
        """A viewer that shows noise."""

        def set_time(self, *_: object, **__: object) -> None:
            """Nothing moves."""

        def take_screenshot(self) -> bytes:
            """A picture."""
            return bytes(cv2.imencode(".png", np.zeros((9, 16, 3), np.uint8))[1])

    monkeypatch.setattr(viewer, "_moments", lambda client: ("t", [{"sequence": k} for k in range(3)], 10.0))
    with pytest.raises(BadInput, match=r"film\.mp4: cannot be written \(no room in "):
        viewer._write_film(small_files / "film.mp4", Drawn(), lambda line: None)
    assert not os.listdir(small_files)


def test_no_room_for_temporary_files(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> str:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("tempfile.mkdtemp", full)
    with pytest.raises(BadInput, match="no room for temporary files; make room there, or set TMPDIR"), scratch_folder():
        pass


@pytest.mark.parametrize(
    ("name", "content"),
    [("a.json", b"{"), ("a.jsonl", b'{}\n{"a'), ("a.toml", b"a ="), ("a.csv", b"a,b\n1,2\n3"), ("a.png", b"\x89PNG"),
     ("a.html", b"<html>"), ("a.rrd", b"RRF2"), ("a.pdf", b"%PDF"), ("a.md", b"half"), (".a.json.77", b"")],
)  # fmt: skip
def test_half_a_file_is_noticed(name: str, content: bytes, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(content)
    assert broken(tmp_path / name)
