"""Clip sets: what is written is read back, and a write that fails leaves nothing behind."""

from __future__ import annotations

import math
import os
import re
import tempfile
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from models.shot import Ball, Table
from models.table.pocket_shape import POCKET_SETS
from models.table.presets import TABLE_SETS
from sysid.clips import Clip, ClipSet, CueCommand, Observation, check_clip_set, read_clip_set, write_clip_set
from tests.support.clip_samples import ROWS, contents, edit, make, refusal


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make(tmp_path / "set")


def assert_same(one: ClipSet, two: ClipSet) -> None:
    """Equal but for the folder and rounding to 6 decimals."""
    assert (one.table, one.ball, one.fps, one.sigma) == (two.table, two.ball, two.fps, two.sigma)
    assert one.extra == two.extra
    assert len(one.clips) == len(two.clips)
    for a, b in zip(one.clips, two.clips, strict=True):
        assert (a.file, a.struck, a.note, a.cue, a.extra) == (b.file, b.struck, b.note, b.cue, b.extra)
        assert a.balls.keys() == b.balls.keys()
        for name, seen in a.balls.items():
            other = b.balls[name]
            np.testing.assert_allclose(a.origin + seen.time, b.origin + other.time, rtol=0, atol=1e-6)
            np.testing.assert_allclose(seen.xy, other.xy, rtol=0, atol=1e-6)
            np.testing.assert_allclose(seen.theta, other.theta, rtol=0, atol=1e-6)
            assert seen.extra == b.balls[name].extra


# Round trips


def test_a_table_by_name_stands_for_its_pockets_and_balls(folder: Path) -> None:
    file = folder / "clips.toml"
    sizes = read_clip_set(folder)
    text = re.sub(r"(?s)\[table\].*?(?=\[camera\])", "", file.read_text())
    file.write_text('table = "snooker"\n' + text)
    found = read_clip_set(folder)
    assert (found.table, found.ball) == (sizes.table, sizes.ball)


def test_reads_what_the_format_says(folder: Path) -> None:
    clips = read_clip_set(folder)
    assert clips.table == Table(3.569, 1.778, pockets=True)
    assert clips.ball == Ball(0.0525, 0.1406)
    assert (clips.fps, clips.sigma, clips.folder) == (120.0, 0.0005, folder)
    first, second = clips.clips
    assert (first.file, first.struck, first.note) == ("clips/1.csv", "cue", "draw")
    assert first.cue == CueCommand(speed=1.9, azimuth=0.5, side=0.004)
    assert second.cue is None
    cue, red = first.balls["cue"], first.balls["red"]
    np.testing.assert_array_equal(cue.time, [0, 0.01, 0.02, 0.03])
    np.testing.assert_array_equal(cue.xy, [[0.1, 0.2], [0.11, 0.2], [0.12, 0.2], [0.13, 0.2]])
    np.testing.assert_array_equal(cue.theta, [0, 0.1, np.nan, 0.3])
    assert np.isnan(red.theta).all()


def test_unknown_columns_and_keys_are_kept(folder: Path, tmp_path: Path) -> None:
    rows = ROWS.replace("\n", ',"a ""b"", c"\n').replace(',"a ""b"", c"', ",seen by", 1)
    (folder / "clips/1.csv").write_text(rows)
    edit(folder / "clips.toml", "[table]", 'venue = "hall"\n[table]\nmaker = { name = "R", years = [1, 2] }')
    edit(folder / "clips.toml", 'note = "draw"', 'note = "draw"\nplayer = "Ann"')
    write_clip_set(read_clip_set(folder), tmp_path / "copy")
    copy = read_clip_set(tmp_path / "copy")
    assert_same(read_clip_set(folder), copy)
    assert copy.extra == {"venue": "hall", "table": {"maker": {"name": "R", "years": [1, 2]}}}
    assert copy.clips[0].extra == {"player": "Ann"}
    assert copy.clips[0].balls["red"].extra == {"seen by": ('a "b", c',) * 2}


def test_lenient_where_the_meaning_is_plain(folder: Path) -> None:
    plain = read_clip_set(folder)
    mixed = "\n".join(",".join([t, y, b, x, a]) for t, b, x, y, a in (row.split(",") for row in ROWS.split()))
    (folder / "clips/1.csv").write_bytes(b"\xef\xbb\xbf" + mixed.replace("\n", "\r\n").encode() + b"\r\n\r\n")
    assert_same(read_clip_set(folder), plain)


def test_links_within_the_folder_are_followed(folder: Path, tmp_path: Path) -> None:
    (folder / "clips/2.csv").rename(folder / "clips/real.csv")
    (folder / "clips/2.csv").symlink_to("real.csv")
    (tmp_path / "link").symlink_to(folder)
    assert_same(read_clip_set(tmp_path / "link"), read_clip_set(folder))
    (folder / "clips/1.csv").unlink()
    (folder / "clips/1.csv").symlink_to("1.csv")
    assert "'clips/1.csv' cannot be opened" in refusal(lambda: read_clip_set(folder))


FIVE = ("t", "ball", "x", "y", "theta")
names = st.text(st.characters(categories=("L", "N", "P", "S")), min_size=1, max_size=6)
words = st.text(st.characters(exclude_categories=["Cs"]), max_size=6)
plain_keys = st.sampled_from(["venue", "player 1", "üñ.x", "", "frame-rates"])
extras = st.dictionaries(plain_keys, words | st.booleans() | st.integers() | st.lists(words, max_size=2), max_size=2)
cues = st.builds(
    CueCommand,
    speed=st.floats(0, 10),
    azimuth=st.floats(-math.pi, math.pi),
    side=st.floats(-0.012, 0.012),
    height=st.floats(-0.012, 0.012),
    elevation=st.floats(0, 1),
)


@st.composite
def clip_sets(draw: st.DrawFn) -> ClipSet:
    """Valid clip sets: balls drawn anywhere on the table, each starting in a place of its own."""
    length, width = draw(st.floats(1.0, 4.0)), draw(st.floats(0.5, 1.0))
    diameter, sigma = draw(st.floats(0.04, 0.07)), draw(st.none() | st.floats(1e-5, 1e-3))
    size = draw(st.integers(1, 3))
    half = np.array([length, width]) / 2 - diameter / 2
    clips = []
    for number in range(size):
        balls: dict[str, Observation] = {}
        columns = draw(st.lists(words.map(str.strip).filter(lambda key: key not in FIVE), unique=True, max_size=2))
        for place, name in enumerate(draw(st.lists(names, min_size=1, max_size=4, unique=True))):
            count = draw(st.integers(1 if balls else 3, 6))
            rng = np.random.default_rng(draw(st.integers(0, 2**32)))
            xy = rng.uniform(-half, half, (count, 2))
            xy[0] = (-0.3 + 0.2 * place, rng.uniform(-0.2, 0.2))
            theta = np.where(rng.random(count) < 0.5, np.nan, rng.normal(0, 100, count))
            cells = {key: tuple(draw(st.lists(words, min_size=count, max_size=count))) for key in columns}
            balls[name] = Observation(np.cumsum(rng.uniform(1e-4, 1, count)), xy, theta, cells)
        struck = next(iter(balls))
        clips.append(Clip(f"{number} ü.csv", struck, balls, draw(st.none() | cues), draw(words), draw(extras)))
    table = Table(length, width, draw(st.booleans()))
    return ClipSet(table, Ball(diameter, 0.2), draw(st.floats(5, 500)), tuple(clips), sigma, extra=draw(extras))


@settings(max_examples=30)
@given(clip_sets())
def test_what_is_written_is_read_back(clip_set: ClipSet) -> None:
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "set")
        write_clip_set(clip_set, folder)
        assert check_clip_set(folder) == []
        assert_same(read_clip_set(folder), clip_set)
        before = contents(folder)
        write_clip_set(read_clip_set(folder), folder)
        after = contents(folder)
        assert os.listdir(place) == ["set"]
        assert len(before) == len(after) == len(clip_set.clips) + 1


# Writing


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"file": "../1.csv"}, ["'../1.csv'", "move the clip"]),
        ({"file": "clips/./2.csv"}, ["'clips/2.csv'", "two clips"]),
        ({"file": "clips/2.csv/3.csv"}, ["cannot be written"]),
        ({"struck": "black"}, ["struck = 'black' is not in clips/1.csv"]),
        ({"cue": CueCommand(math.nan, 0.0)}, ["cue.speed = nan", "no clip was written"]),
        ({"extra": {"when": object()}}, ["cannot be written as TOML"]),
        ({"note": "\ud800"}, ["cannot be written"]),
    ],
)
def test_a_bad_clip_leaves_nothing_behind(
    folder: Path, tmp_path: Path, change: dict[str, Any], words: list[str]
) -> None:
    good = read_clip_set(folder)
    bad = replace(good, clips=(replace(good.clips[0], **change), good.clips[1]))
    assert_refused(bad, folder, tmp_path, words)


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("cue", {"xy": np.full((4, 2), np.nan)}, ["clips/1.csv, row 2", "x = 'nan'"]),
        ("cue", {"time": np.array([0, 0.1, 0.1 + 1e-8, 0.2])}, ["clips/1.csv, row", "of ball 'cue'"]),
        ("cue", {"theta": np.zeros(3)}, ["clips/1.csv", "theta of ball 'cue'", "(3,)"]),
        ("cue", {"extra": {"qw": ("1",)}}, ["clips/1.csv", "one value for each time"]),
        ("cue", {"extra": {"x": ("1",) * 4}}, ["clips/1.csv", "'x' cannot name"]),
        ("a ", {}, ["clips/1.csv", "'a '", "blank"]),
        ("a", {"time": np.zeros(0), "xy": np.zeros((0, 2)), "theta": np.zeros(0)}, ["'a' has no samples"]),
    ],
)
def test_a_bad_ball_leaves_nothing_behind(
    folder: Path, tmp_path: Path, name: str, change: dict[str, Any], words: list[str]
) -> None:
    good = read_clip_set(folder)
    balls = {**good.clips[0].balls, name: replace(good.clips[0].balls["cue"], **change)}
    bad = replace(good, clips=(replace(good.clips[0], balls=balls), good.clips[1]))
    assert_refused(bad, folder, tmp_path, words)


def assert_refused(bad: ClipSet, folder: Path, tmp_path: Path, words: list[str]) -> None:
    before = contents(tmp_path)
    for target in (tmp_path / "new/deep/set", folder):
        message = refusal(lambda target=target: write_clip_set(bad, target))  # type: ignore[misc]
        assert [word for word in words if word not in message] == []
        assert contents(tmp_path) == before
        assert os.listdir(tmp_path) == ["set"]


def test_only_clip_sets_are_replaced(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clips = read_clip_set(folder)
    smaller = replace(clips, clips=clips.clips[1:])
    (tmp_path / "empty").mkdir()
    (tmp_path / "other").mkdir()
    (tmp_path / "other/thesis.txt").write_text("years of work")
    write_clip_set(clips, tmp_path / "empty")
    assert "'thesis.txt' and is not a clip set" in refusal(lambda: write_clip_set(clips, tmp_path / "other"))
    assert "is a file" in refusal(lambda: write_clip_set(clips, tmp_path / "other/thesis.txt"))
    assert "unprintable" in refusal(lambda: write_clip_set(clips, f"{tmp_path}/\0"))
    write_clip_set(smaller, folder)
    assert sorted(contents(folder)) == ["clips.toml", "clips/2.csv"]
    (folder / "notes.md").write_text("mine")
    assert "'notes.md' and is not part of it" in refusal(lambda: write_clip_set(clips, folder))

    def fail(old: Path, new: Path) -> None:
        if old.name == "new":
            raise OSError(28, "No space left on device")
        os.replace(old, new)

    before = contents(tmp_path)
    monkeypatch.setattr("sysid.clips.write._swapped", lambda one, other: False)  # where a system has no such call
    monkeypatch.setattr(Path, "rename", fail)
    assert "No space left" in refusal(lambda: write_clip_set(smaller, tmp_path / "empty"))
    assert contents(tmp_path) == before
    assert sorted(os.listdir(tmp_path)) == ["empty", "other", "set"]


# Data


@pytest.mark.slow
def test_shared_data_has_no_faults(data_folder: Path) -> None:
    folders = [data_folder / "carom-match", *sorted((data_folder / "hidden").glob("set-*/"))]
    if not all((folder / "clips.toml").is_file() for folder in folders):
        pytest.skip(f"{data_folder} has no carom-match or hidden sets")
    assert {str(folder): check_clip_set(folder) for folder in folders} == {str(folder): [] for folder in folders}
    carom = read_clip_set(folders[0])
    assert len(carom.clips) == 123
    assert sum(len(seen.time) for clip in carom.clips for seen in clip.balls.values()) == 50984 - 123
    assert asdict(carom.table) == {"length": 2.84, "width": 1.42, "pockets": False}


# Pockets


@pytest.mark.parametrize("name", ["snooker", "pool 9 ft", "pool 8 ft", "pool 7 ft"])
def test_pockets_by_name_and_by_measure(folder: Path, tmp_path: Path, name: str) -> None:
    edit(folder / "clips.toml", "width = 1.778", f'width = 1.778\npockets = "{name}"')
    named = read_clip_set(folder)
    assert named.table.shapes == POCKET_SETS[name]
    write_clip_set(named, tmp_path / "again")
    assert read_clip_set(tmp_path / "again").table == named.table
    mouth = POCKET_SETS[name].corner.mouth
    wide = replace(POCKET_SETS[name], corner=replace(POCKET_SETS[name].corner, mouth=mouth + 0.002))
    write_clip_set(replace(named, table=replace(named.table, pockets=wide)), tmp_path / "wide")
    assert read_clip_set(tmp_path / "wide").table.shapes.corner.mouth == pytest.approx(mouth + 0.002)


@pytest.mark.parametrize("name", ["pool 9 ft", "pool 8 ft", "pool 7 ft", "carom", "snooker"])
def test_a_table_by_name_is_written_with_pockets_that_a_person_can_read(
    folder: Path, tmp_path: Path, name: str
) -> None:
    """Not with twelve numbers such as 0.11588749999999999."""
    known = TABLE_SETS[name].table
    write_clip_set(replace(read_clip_set(folder), table=known), tmp_path / "again")
    wanted = {"carom": "false", "snooker": "true"}.get(name, f'"{name}"')
    assert f"pockets = {wanted}\n" in (tmp_path / "again/clips.toml").read_text()
    assert read_clip_set(tmp_path / "again").table == known


# Clock


@pytest.mark.parametrize("origin", [-10.0, -0.01, 100.0, 1000.0])
def test_a_clock_may_begin_anywhere(folder: Path, tmp_path: Path, origin: float) -> None:
    plain = read_clip_set(folder)
    late = replace(plain, clips=tuple(replace(c, origin=origin) for c in plain.clips))
    write_clip_set(late, tmp_path / "late")
    assert f"{origin:.6f},cue" in (tmp_path / "late/clips/1.csv").read_text()
    for a, b in zip(plain.clips, read_clip_set(tmp_path / "late").clips, strict=True):
        assert b.origin == origin
        for name, seen in a.balls.items():
            np.testing.assert_array_equal(seen.time, b.balls[name].time)
