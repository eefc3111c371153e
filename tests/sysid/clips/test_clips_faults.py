"""Bad clip sets: each fault is one line that names the file, the row, the value and the remedy."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sysid.clips import check_clip_set, read_clip_set
from tests.support.clip_samples import FILES, ROWS, SETTINGS, edit, make, refusal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make(tmp_path / "set")


# Damage

LINES = st.sampled_from([0, 1, 2, 3, 4, 5, 8, 11, 15, 16, 18, 21])
BAD_CELLS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "",
    "abc",
    "1_0",
    "99",
    '"',
    "0;1",
    "-0.01",
    "cue",
    "red",
    "٣",
    "{",
    "[[x]]",
]


def damage(data: st.DataObject, raw: bytes) -> bytes:
    """A file as accidents leave it."""
    kind = data.draw(st.sampled_from(["flip", "cut", "insert", "cells", "columns", "shuffle", "noise", "empty"]))
    lines = raw.split(b"\n")
    at = data.draw(st.integers(0, len(raw) - 1))
    if kind == "flip":
        return raw[:at] + bytes([data.draw(st.integers(0, 255))]) + raw[at + 1 :]
    if kind == "cut":
        return raw[:at]
    if kind == "insert":
        return raw[:at] + data.draw(st.sampled_from(BAD_CELLS)).encode() + raw[at:]
    if kind == "cells":
        line = data.draw(LINES) % len(lines)
        separator = b"," if b"," in lines[line] else b"= "
        cells = lines[line].split(separator)
        cells[data.draw(st.integers(0, len(cells) - 1))] = data.draw(st.sampled_from(BAD_CELLS)).encode()
        lines[line] = separator.join(cells)
    elif kind == "columns":
        gone = data.draw(st.integers(0, 4))
        lines = [b",".join(c for i, c in enumerate(line.split(b",")) if i != gone) for line in lines]
    elif kind == "shuffle":
        lines = data.draw(st.permutations(lines))
    elif kind == "noise":
        return data.draw(st.binary(max_size=60))
    else:
        return b""
    return b"\n".join(lines)


@settings(max_examples=150)
@given(st.data())
def test_damage_is_read_or_refused_in_one_line(data: st.DataObject) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = make(Path(place))
        for file in data.draw(st.lists(st.sampled_from(FILES), min_size=1, max_size=2)):
            (folder / file).write_bytes(damage(data, (folder / file).read_bytes() or b"\n"))
        faults = check_clip_set(folder)
        for fault in faults:
            assert fault.isprintable()
            assert fault.startswith(FILES)
        if faults:
            assert refusal(lambda: read_clip_set(folder)).startswith(faults[0])
        else:
            for clip in read_clip_set(folder).clips:
                assert all(np.isfinite(seen.xy).all() for seen in clip.balls.values())
                assert len(clip.balls[clip.struck].time) >= 3


# Named faults: file, old text, new text, where the message says it is, and what else it says

TOML_FAULTS = [
    ('"billiard-clips/1"', '"billiard-clips/2"', 1, "billiard-clips/2", 'reads format = "billiard-clips/1"'),
    ('format = "billiard-clips/1"', "", None, "format is missing", "billiard-clips/1"),
    ("format =", "fromat =", 1, "'fromat'", "did you mean 'format'"),
    ("[table]", "[table", 3, "not TOML", "correct that line"),
    ("[table]", "x = 2001-13-45\n[table]", 3, "not TOML", "correct that line"),
    ("length = 3.569", "", 3, "length is missing", "add a number in m"),
    ("length = 3.569", 'length = "3.569"', 4, "length = '3.569'", "in quotes"),
    ("length = 3.569", "length = 3569", 4, "length = 3569", "mm", "3.569"),
    ("length = 3.569", "lenght = 3.569", 4, "lenght", "did you mean 'length'"),
    ("width = 1.778", "width = nan", 5, "width = nan", "not finite"),
    ("width = 1.778", "width = 1e999", 5, "width = inf", "not finite"),
    ("width = 1.778", "width = 4", 5, "width = 4", "exchange"),
    ("width = 1.778", "width = true", 5, "width = True", "not a number"),
    ("width = 1.778", "width = 1.7\npockets = 6", 6, "pockets = 6", "true or false"),
    ("[ball]\ndiameter = 0.0525\nmass = 0.1406", "", None, "[ball] is missing", "diameter"),
    ("[ball]", "[bal]", 7, "'bal'", "did you mean 'ball'"),
    ("diameter = 0.0525", "diameter = 52.5", 8, "diameter = 52.5", "mm", "0.0525"),
    ("diameter = 0.0525", "diameter = 0.525", 8, "diameter = 0.525", "outside 0.02 to 0.1"),
    ("width = 1.778", "width = 0.24", 8, "diameter = 0.0525", "does not fit a table 0.24 m wide"),
    ("mass = 0.1406", "mass = 140.6", 9, "mass = 140.6", "looks like g", "0.1406"),
    ("mass = 0.1406", "mass = 1.406", 9, "mass = 1.406", "does not fit a ball"),
    ("mass = 0.1406", "mass = -1", 9, "mass = -1", "not positive"),
    ("fps = 120.0", "fps = 0", 12, "fps = 0", "not positive"),
    ("sigma = 0.0005", "sigma = 0", 13, "sigma = 0", "leave it out"),
    ("sigma = 0.0005", "sigma = 0.5", 13, "sigma = 0.5", "mm", "0.0005"),
    ('"clips/1.csv"', '"clips/9.csv"', 16, "'clips/9.csv'", "does not exist"),
    ('"clips/1.csv"', '"../1.csv"', 16, "'../1.csv'", "move the clip into the folder"),
    ('"clips/1.csv"', '"/etc/passwd"', 16, "'/etc/passwd'", "absolute", "relative"),
    ('"clips/1.csv"', '"clips"', 16, "'clips'", "is not a file"),
    ('"clips/1.csv"', '"clips/\\u0000"', 16, "name the clip's CSV"),
    ('"clips/1.csv"', '"clips.toml"', 16, "'clips.toml'", "name the clip's CSV"),
    ('file = "clips/1.csv"', "file = 1", 16, "file = 1 is not text"),
    ('"clips/2.csv"', '"./clips//1.csv"', 22, "'./clips//1.csv'", "clip 1", "once"),
    ('struck = "cue"', 'struck = "Cue"', 17, "'Cue'", "clips/1.csv", "did you mean 'cue'"),
    ('struck = "cue"', 'struck = "blue"', 17, "'blue'", "'cue', 'red'"),
    ('struck = "cue"', 'sturck = "cue"', 17, "'sturck'", "did you mean 'struck'"),
    ('struck = "cue"', "", 15, "struck is missing", "add"),
    ("speed = 1.9", "speed = 1900", 19, "cue.speed = 1900", "mm/s"),
    ("azimuth = 0.5", "azimuth = 161", 19, "cue.azimuth = 161", "degrees", "2.8"),
    ("azimuth = 0.5", "azimut = 0.5", 19, "'azimut'", "did you mean 'azimuth'"),
    ("speed = 1.9, ", "", 19, "cue.speed is missing"),
    ("side = 0.004", "side = 0.04", 19, "0.04 m off centre"),
    ("side = 0.004 }", "side = 0.004 }\n[[clips]]", 20, "'clips'", "did you mean 'clip'"),
]
ROW_FAULTS = [
    ("t,ball,x,y,theta", "t,ball,x,y,angle", 1, "'theta' is missing", "header"),
    ("t,ball,x,y,theta", "t,ball,X,y,theta", 1, "'x' is missing", "not 'X'"),
    ("t,ball,x,y,theta", "t,ball,x,x,y,theta", 1, "'x' appear more than once", "keep one"),
    ("t,ball,x,y,theta", "t;ball;x;y;theta", 1, "commas, not ';'"),
    ("0.010,cue,0.11", "0.010,cue,abc", 4, "x = 'abc' is not a number", "metres"),
    ("0.010,cue,0.11", '0.010,cue,"0,11"', 4, "x = '0,11'", "decimal point"),
    ("0.010,cue,0.11", "0.010,cue,", 4, "x is empty", "remove the row"),
    ("0.010,cue,0.11", "0.010,cue,NaN", 4, "x = 'NaN' is not finite", "metres"),
    ("0.010,cue,0.11,0.2", "0.010,cue,0.11,-inf", 4, "y = '-inf' is not finite", "metres"),
    ("0.010,cue", "nan,cue", 4, "t = 'nan' is not finite", "seconds"),
    ("0.11,0.2,0.1", "0.11,0.2,nan", 4, "theta = 'nan'", "leave it empty"),
    ("0.11,0.2,0.1", "0.11,0.2", 4, "4 cells", "5 columns"),
    ("0.020,cue", "0.002,cue", 6, "t = 0.002", "row 5", "sort the rows"),
    ("0.030,cue", "0.020,cue", 7, "t = 0.02 of ball 'cue'", "row 6", "one row"),
    ("0.030,cue", "30000,cue", 7, "t = 30000", "not milliseconds"),
    ("0.010,cue,0.11", "0.010,cue,1.81", 4, "x = 1.81 of ball 'cue' lies outside the table", "nose at 1.7845"),
    ("0.010,cue,0.11,0.2", "0.010,cue,0.6,-200", 4, "y = -200", "metres from the table's centre"),
    ("0.000,red,0.5", "0.000,red,0.14", 3, "'cue' and 'red' overlap", "0.04 m apart"),
    ("0.010,cue", "0.010, cue", 4, "' cue'", "blank"),
    ("0.010,red", "0.010,", 5, "ball = ''", "name the ball"),
    ("0.010,cue", '0.010,"c"ue', 4, "not CSV", "quotes"),
    ("0.020,cue,0.12,0.2,\n0.030,cue,0.13,0.2,0.3\n", "", None, "2 samples", "at least 3", "record the shot again"),
    (ROWS[16:], "\n", None, "no samples", "at least 3"),
    (ROWS, " \n", None, "is empty", "backup"),
]


@pytest.mark.parametrize(
    ("file", "old", "new", "row", "words"),
    [("clips.toml", a, b, row, words) for a, b, row, *words in TOML_FAULTS]
    + [("clips/1.csv", a, b, row, words) for a, b, row, *words in ROW_FAULTS],
)
def test_a_fault_is_named(folder: Path, file: str, old: str, new: str, row: int | None, words: list[str]) -> None:
    edit(folder / file, old, new)
    message = refusal(lambda: read_clip_set(folder))
    where = "line" if file == "clips.toml" else "row"
    assert message.startswith(f"{file}: " if row is None else f"{file}, {where} {row}: ")
    assert [word for word in words if word not in message] == []
    assert message.startswith(check_clip_set(folder)[0])


def test_text_that_is_not_utf8_is_named(folder: Path) -> None:
    (folder / "clips/2.csv").write_bytes(ROWS.encode().replace(b"0.010,red", b"0.010,r\xe9d"))
    assert refusal(lambda: read_clip_set(folder)).startswith("clips/2.csv, row 5: byte 0xe9 is not UTF-8")
    (folder / "clips.toml").write_bytes(b'format = "\xff"')
    assert refusal(lambda: read_clip_set(folder)).startswith("clips.toml, line 1: byte 0xff")


def test_missing_folders_and_clips_are_named(folder: Path, tmp_path: Path) -> None:
    assert f"{tmp_path}/none: no such folder" in refusal(lambda: read_clip_set(tmp_path / "none"))
    assert "is not a folder" in refusal(lambda: read_clip_set(folder / "clips.toml"))
    assert refusal(lambda: read_clip_set(tmp_path)).startswith("clips.toml: does not exist")
    (folder / "clips.toml").write_text(SETTINGS[: SETTINGS.index("[[clip]]")])
    assert "add [[clip]]" in refusal(lambda: read_clip_set(folder))


@pytest.mark.parametrize("file", FILES)
def test_links_may_not_leave_the_folder(folder: Path, tmp_path: Path, file: str) -> None:
    (folder / file).rename(tmp_path / "outside")
    (folder / file).symlink_to(tmp_path / "outside")
    message = refusal(lambda: read_clip_set(folder))
    assert message.startswith("clips.toml")
    assert file in message
    assert "symbolic link that leaves the clip set's folder: put a copy" in message


def test_a_check_names_every_fault(folder: Path) -> None:
    edit(folder / "clips.toml", "fps = 120.0", "fps = -1")
    edit(folder / "clips/1.csv", "0.11", "abc")
    edit(folder / "clips/1.csv", "0.12", "5")
    (folder / "clips/2.csv").write_text(ROWS.replace(",0.2,", ",nan,") + "".join(f"1,b{i},9,0,\n" for i in range(20)))
    faults = check_clip_set(folder)
    assert [fault.split(": ")[0] for fault in faults[:4]] == [
        "clips.toml, line 12",
        "clips/1.csv, row 4",
        "clips/1.csv, row 6",
        "clips/2.csv, row 2",
    ]
    assert faults[-1].startswith("clips/2.csv: 16 more faults")
    line = refusal(lambda: read_clip_set(folder))
    assert "(28 more: " in line and f"sysid check {folder})" in line


@pytest.mark.parametrize(
    ("x", "y", "pockets", "good"),
    [
        (1.79, 0.895, True, True),  # image scale moves a ball at the nose
        (1.79, 0.4, False, True),
        (1.83, 0.93, True, True),  # dropping into a corner pocket
        (0.01, -0.95, True, True),  # dropping into a middle pocket
        (1.83, 0.93, False, False),
        (0.01, -0.95, False, False),
        (0.5, -0.95, True, False),
        (2.0, 1.0, True, False),
    ],
)
def test_balls_leave_the_table_only_in_pockets(folder: Path, x: float, y: float, pockets: bool, good: bool) -> None:
    edit(folder / "clips.toml", "width = 1.778", f"width = 1.778\npockets = {str(pockets).lower()}")
    edit(folder / "clips/1.csv", "0.13,0.2", f"{x},{y}")
    assert (check_clip_set(folder) == []) == good


def test_balls_may_touch_and_meet_after_a_missing_frame(folder: Path) -> None:
    edit(folder / "clips/1.csv", "0.000,red,0.5,0.2,\n", "0.000,red,0.1515,0.2,\n")
    edit(folder / "clips/2.csv", "0.000,cue,0.1,0.2,0.0\n", "")
    edit(folder / "clips/2.csv", "0.000,red,0.5", "0.000,red,0.145")
    assert check_clip_set(folder) == []
