"""Budgets of readers: what is too much is refused before it is read, and what is real passes."""

from __future__ import annotations

import contextlib
import resource
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from models.files import limits, read_toml
from models.files.faults import Faults, TooManyFaults, shown
from models.files.tables import csv_rows
from models.files.texts import TextPacker, picked
from planner.scene import SceneFile, read_scene
from sysid.clips import read_clip_set
from sysid.foreign.columns import read_clip
from sysid.foreign.records import read_columns

SET = """format = "billiard-clips/1"
[table]
length = 3.569
width = 1.778
[ball]
diameter = 0.0525
mass = 0.14
[camera]
fps = 1000
[[clip]]
file = "1.csv"
struck = "b0"
"""
SCENE = """format = "billiard-scene/1"
table = { length = 3.569, width = 1.778 }
ball = { diameter = 0.0525, mass = 0.14 }
goal = { cue = "b0", object = "b1", pocket = "any" }
[balls]
"""
HEAD = "t,ball,x,y,theta"
MAX_S, MAX_MB = 20.0, 500  # of a refusal: of processor time, and how much more memory there was in use than before


def refused(read: Callable[[], object]) -> str:
    """What is said of an input that is refused at once."""
    began, before = time.process_time(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(BadInput) as found:
        read()
    assert time.process_time() - began < MAX_S
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < MAX_MB << 10
    return str(found.value)


def clip_set(folder: Path, *lines: str) -> Path:
    """A set of one clip."""
    (folder / "clips.toml").write_text(SET)
    (folder / "1.csv").write_text("\n".join([*lines, ""]))
    return folder


def test_ten_thousand_balls_on_one_place(tmp_path: Path) -> None:
    rows = [f"0,b{k},0,0," for k in range(10_000)]
    assert "has 10000 balls, the limit is 256: give a ball" in refused(
        lambda: read_clip_set(clip_set(tmp_path, HEAD, *rows))
    )
    (tmp_path / "scene.toml").write_text(SCENE + "".join(f"b{k} = [0, 0]\n" for k in range(10_000)))
    assert "has 10000 balls, the limit is 22" in refused(lambda: read_scene(tmp_path / "scene.toml"))


def test_a_name_in_every_row_is_not_the_name_of_a_ball(tmp_path: Path) -> None:
    file = tmp_path / "track.csv"
    file.write_text("\n".join(["t,ball,x,y", *(f"{k},b{k},0,0" for k in range(20_000))]))
    said = refused(lambda: read_clip(read_columns(file), {}))
    assert "has 20000 balls, the limit is 256: name the column" in said and "--columns ball=NAME" in said


def test_a_million_columns(tmp_path: Path) -> None:
    head = HEAD + "".join(f",a{k}" for k in range(1_000_000))
    told = "has 1000005 columns, the limit is 256: keep only the columns that are needed"
    assert told in refused(lambda: read_clip_set(clip_set(tmp_path, head)))
    assert told in refused(lambda: read_columns(tmp_path / "1.csv"))


@pytest.mark.parametrize(("text", "told"), [
    ("a" * (limits.MAX_LINE_CHARS + 1), "characters in one line"),
    ("t,ball,x,y\n" + '"' + "\n" * 2000, "has a row of more than 1000 lines: correct the quotes"),
    ('t,ball,x,y\n0,"a', "is not CSV"),
])  # fmt: skip
def test_rows_end(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(text)
    assert told in refused(lambda: list(csv_rows(tmp_path / "a.csv", "a.csv", Faults(), "")))


@pytest.mark.parametrize(("text", "told"), [
    ("x = 1\n" * (1 << 20), "has 6 MB, the limit is 4"),
    ("a" + ".a" * 100_000 + " = 1", "has a key of more than 32 parts in line 1"),
    ("\n".join(f"w{k} = 1" for k in range(200_000)), "unknown key"),
    ("[goal]\navoid = 3\nx = " + "[" * 40 + "]" * 40, "deep"),
])  # fmt: skip
def test_toml_ends(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert told in refused(lambda: read_toml(tmp_path / "a.toml", SceneFile, "", ""))


@pytest.mark.parametrize(("text", "told"), [
    ("[" + "{}," * limits.MAX_CONTAINERS + "{}]", "brackets, the limit is"),
    ("[" + ",".join(f'{{"k{k}": 1}}' for k in range(2000)) + "]", "has 257 columns, the limit is 256"),
    ("{" + ",".join(f'"k{k}": 1' for k in range(2000)) + ', "rows": [' + "{}," * 100_000 + "{}]}", "has 2000 columns"),
])  # fmt: skip
def test_json_ends(text: str, told: str, tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(text)
    assert told in refused(lambda: read_columns(tmp_path / "a.json"))


def test_a_small_parquet_is_not_unpacked_into_much(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    file, rows = tmp_path / "a.parquet", 10_000
    zeros = pa.array(np.zeros(rows))
    text = pa.DictionaryArray.from_arrays(pa.array(np.zeros(rows, np.int32)), pa.array(["x" * 1_000_000]))
    parquet.write_table(pa.table({"t": zeros, "x": zeros, "y": zeros, "note": text}), file, compression="zstd")
    assert file.stat().st_size < 1 << 20  # and 10 GB of texts
    assert "column 'note': has 1000000 characters in a cell, the limit is 10000" in refused(lambda: read_columns(file))
    with parquet.ParquetWriter(file, pa.schema([("t", pa.float64())]), compression="zstd") as writer:
        for _ in range(3):
            writer.write_table(pa.table({"t": np.zeros(1_000_000)}))
    assert "has 3000000 rows, the limit is 2000000: split it" in refused(lambda: read_columns(file))
    sound = file.read_bytes()
    file.write_bytes(sound[:-1])
    said = refused(lambda: read_columns(file))
    assert said.endswith("does not end as a Parquet file does: save it again, or save it as CSV")
    file.write_bytes(sound[:-40] + b"x" * 30 + sound[-10:])
    assert refused(lambda: read_columns(file)).endswith("): save it again, or save it as CSV")
    file.write_bytes(sound[:-8] + b"\xff\xff\xff\x7fPAR1")
    assert "MB of description, the limit is 16" in refused(lambda: read_columns(file))


def test_no_damage_to_what_a_parquet_says_of_itself_ends_the_process(tmp_path: Path) -> None:
    pa = pytest.importorskip("pyarrow")
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "a.parquet"
    table = pa.table({"t": [0.0, 0.1], "x": [1, None], "ball": ["cue", "red"]})
    parquet.write_table(table, path, store_schema=False)
    sound = path.read_bytes()
    first = len(sound) - 8 - int.from_bytes(sound[-8:-4], "little")
    for at in range(first, len(sound) - 8):
        for value in (sound[at] ^ 1, sound[at] ^ 16, 0, 255):
            path.write_bytes(sound[:at] + bytes([value]) + sound[at + 1 :])
            with contextlib.suppress(BadInput):
                read_columns(path)


def test_faults_end_as_well(tmp_path: Path) -> None:
    said = refused(lambda: read_clip_set(clip_set(tmp_path, HEAD, *["0,b0,x,y,z"] * 100_000)))
    assert said.startswith("1.csv, row 2: t = 0") or "is not a number" in said
    faults = Faults()
    with pytest.raises(TooManyFaults, match="f0"):
        for k in range(limits.MAX_FILE_FAULTS + 1):
            faults.add("f", f"f{k}")
    assert faults.lines(1)[1].startswith("f: at least 999 more faults")


def test_a_message_shows_the_beginning_of_a_large_value() -> None:
    began = time.process_time()
    value = [{"a": list(range(1_000_000)), "b": "x" * 10_000_000}] * 3
    assert shown(value).startswith("[{'a': [0, 1, 2") and shown(value).endswith(" ...")
    assert time.process_time() - began < 1.0
    assert shown({"b": 1, "a": "x"}) == "{'b': 1, 'a': 'x'}" and shown((1.5,)) == "(1.5,)"


def test_what_a_fast_camera_sees_in_a_minute_is_within_the_limits() -> None:
    rows, columns = 22 * 1000 * 60, 5 + 40
    assert rows <= limits.MAX_ROWS and columns <= limits.MAX_COLUMNS and rows * columns <= limits.MAX_CELLS
    assert rows * columns * 10 <= limits.MAX_TABLE_BYTES  # at ten characters a cell


def test_packed_texts_are_the_texts() -> None:
    given = ["", "a", "é", "x" * 300, "\ud800", "", "\U0001f3b1"] * 3000
    packer = TextPacker()
    packer.extend(given[:9000])
    for text in given[9000:]:
        packer.add(text)
    packer.pad(len(given) + 2)
    texts = packer.texts()
    assert list(texts) == [*given, "", ""] and len(texts) == len(given) + 2
    assert texts[4] == "\ud800" and texts[-1] == "" and texts == [*given, "", ""]
    rows = np.array([6, 0, 3])
    assert list(picked(texts, rows)) == list(picked(given, rows)) == ["\U0001f3b1", "", "x" * 300]
    assert list(texts[1:4]) == given[1:4]
