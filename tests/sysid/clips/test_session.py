"""When and under what a clip was filmed: read, kept, refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.shot import Session
from sysid.clips import check_clip_set, read_clip_set, write_clip_set
from tests.support.clip_samples import edit, make

TOLD = "session = { hour = 14.5, temperature = 22.5, cloth_age = 80.0, table = 2, player = 1 }\n"


@pytest.fixture
def told(tmp_path: Path) -> Path:
    """A clip set of which both clips say when they were filmed."""
    folder = make(tmp_path / "set")
    edit(folder / "clips.toml", 'note = "draw"\n', 'note = "draw"\n' + TOLD)
    with (folder / "clips.toml").open("a") as file:
        file.write(TOLD.replace("22.5", "19"))
    return folder


def test_sessions_are_read_and_written_again(told: Path, tmp_path: Path) -> None:
    first = read_clip_set(told)
    assert [clip.session for clip in first.clips] == [
        Session(0.0, 14.5, 2.5, 80.0, 2.0, 1.0), Session(1.0, 14.5, -1.0, 80.0, 2.0, 1.0),
    ]  # fmt: skip
    write_clip_set(first, tmp_path / "copy")
    assert [clip.session for clip in read_clip_set(tmp_path / "copy").clips] == [c.session for c in first.clips]
    assert "temperature = 19.0" in (tmp_path / "copy" / "clips.toml").read_text()
    assert check_clip_set(told) == []


def test_without_a_session_none_is_written(tmp_path: Path) -> None:
    write_clip_set(read_clip_set(make(tmp_path / "set")), tmp_path / "copy")
    assert "session" not in (tmp_path / "copy" / "clips.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("hour = 14.5", "hour = 25.0", ("hour = 25", "0 to 24")),
        ("temperature = 22.5", "temperature = 295.0", ("temperature = 295", "degrees Celsius")),
        ("table = 2", 'table = "B"', ("session.table = 'B'", "1 to 8")),
        ("player = 1", "player = 9", ("player = 9", "1 to 8")),
        ("cloth_age = 80.0, ", "", ("session.cloth_age is missing", "every clip, or for none")),
    ],
)
def test_a_wrong_session_is_one_clear_line(told: Path, old: str, new: str, said: tuple[str, ...]) -> None:
    edit(told / "clips.toml", old, new)
    (fault,) = check_clip_set(told)
    assert all(word in fault for word in said), fault
