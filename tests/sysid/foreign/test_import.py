"""Files of other trackers become the clips that they were made from; what cannot be told is asked for."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from sysid.cli import main
from sysid.clips import ClipSet, read_clip_set, write_clip_set
from sysid.clips.consistency.readings import Reading
from sysid.foreign.columns import read_clip, shots_of
from sysid.foreign.records import read_columns
from sysid.vision.camera.projection import Camera, write_camera
from tests.support.foreign_files import (
    LENGTH,
    WIDTH,
    Row,
    arrays_json,
    long_mm,
    nested_json,
    rows_of,
    wide_inches,
    write_foreign,
)
from tests.support.running_clips import cut_in_motion
from tests.support.table_views import over_table
from tests.truth.__main__ import main as generate

TABLE = ("--table", "3.569x1.778", "--ball-diameter", "0.0525")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Shots with rebounds and impacts of two balls."""
    folder = tmp_path_factory.mktemp("foreign") / "set"
    assert generate([str(folder), "--seed", "5", "--clips", "8", "--kind", "cushion,cut", "--missing", "0"]) == 0
    return folder


def imported(files: Sequence[Path], out: Path, *words: str) -> ClipSet:
    """What `sysid import` makes of files."""
    assert main(["import", *map(str, files), *TABLE, *words, "--out", str(out)]) == 0
    assert out.with_name(out.name + ".png").stat().st_size > 10_000
    return read_clip_set(out)


def furthest(found: ClipSet, meant: ClipSet) -> float:
    """The largest distance of a place from where it was, in the same frame [m]."""
    far = 0.0
    for one, other in zip(found.clips, meant.clips, strict=True):
        for name, seen in one.balls.items():
            whole = other.balls[name]
            lag = one.origin - other.origin
            there = np.column_stack([np.interp(seen.time + lag, whole.time, whole.xy[:, k]) for k in (0, 1)])
            far = max(far, float(np.hypot(*(seen.xy - there).T).max()))
    return far


FORMS: dict[str, tuple[str, Callable[[Sequence[Row]], str], tuple[str, ...]]] = {
    "wide inches": (".csv", wide_inches, ()),
    "nested": (".json", nested_json, ()),
    "arrays": (".json", arrays_json, ()),
    "long mm": (".csv", long_mm, ("--fps", "120", "--y", "down")),
}


@pytest.mark.parametrize("form", FORMS)
def test_forms_of_other_trackers_are_understood(
    tmp_path: Path, source: Path, form: str, capsys: pytest.CaptureFixture[str]
) -> None:
    suffix, text, words = FORMS[form]
    found = imported(write_foreign(source, tmp_path / "in", suffix, text), tmp_path / "out", *words)
    meant = read_clip_set(source)
    assert [clip.file for clip in found.clips] == [f"clips/shot_{k:04d}.csv" for k in range(1, 9)]
    assert {clip.struck for clip in found.clips} == {"cue"} and found.fps == pytest.approx(120.0)
    if form != "long mm":
        assert furthest(found, meant) < 2e-3
    else:
        assert all(abs(clip.origin - 0.5) < 0.02 for clip in found.clips)
        ways = [
            clip.balls["cue"].xy[-1] - other.balls["cue"].xy[-1]
            for clip, other in zip(found.clips, meant.clips, strict=True)
        ]
        assert np.abs(ways).max() < 1e-4
    assert ("assumed: y is taken to point up" in capsys.readouterr().out) == ("--y" not in words)


def test_parquet(tmp_path: Path, source: Path) -> None:
    arrow, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    files = []
    for file in sorted((source / "clips").glob("*.csv")):
        columns = dict(zip(("time", "ball", "x", "y"), map(list, zip(*rows_of(file), strict=True)), strict=True))
        files.append(tmp_path / f"{file.stem}.parquet")
        parquet.write_table(arrow.table(columns), files[-1])
    assert furthest(imported(files, tmp_path / "out"), read_clip_set(source)) < 1e-5


def pixel_files(folder: Path, meant: ClipSet, camera: Camera, upwards: bool) -> list[str]:
    """The clips as a tracker in the camera's picture writes them, y from the first row or from the last."""
    files = []
    for clip in meant.clips:
        files.append(folder / Path(clip.file).name)
        lines = ["frame;name;u;v"]
        for name, seen in clip.balls.items():
            frames = np.rint(seen.time * meant.fps).astype(int).tolist()
            pixels = zip(frames, camera.outline(seen.xy).tolist(), strict=True)
            lines += [f"{k};{name};{u:.3f};{camera.size[1] - 1 - v if upwards else v:.3f}" for k, (u, v) in pixels]
        files[-1].write_text("\n".join(lines) + "\n")
    return list(map(str, files))


@pytest.mark.parametrize("upwards", [False, True], ids=["y down", "y up"])
@pytest.mark.parametrize("centred", [False, True], ids=["beside", "straight above"])
def test_pixels_are_placed_by_the_camera_s_file(
    tmp_path: Path, upwards: bool, centred: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """Which way y is counted shows at the cushions, and is asked where the camera looks at the middle."""
    camera = over_table(tilt=(0.0, 0.0)) if centred else over_table(aim=(0.05, 0.1), span=3.0)
    size = ["--length", "2.0", "--width", "1.0", "--diameter", str(camera.diameter)]
    assert generate([str(tmp_path / "set"), "--seed", "2", "--clips", "8", "--kind", "cushion", "--no-cue", *size]) == 0
    write_camera(tmp_path / "cam.toml", dataclasses.replace(camera, place_sd_m=0.00097))
    meant = read_clip_set(tmp_path / "set")
    files = pixel_files(tmp_path, meant, camera, upwards)
    words = ["--camera", str(tmp_path / "cam.toml"), "--fps", "120", "--out", str(tmp_path / "out")]
    asked = ["--y", "up"] if upwards and centred else []
    assert main(["import", *files, *words, *asked]) == 0
    said = capsys.readouterr().out
    assert f"y counted {'upwards' if upwards else 'downwards'}" in said
    assert ("give --y up" in said) == (centred and not upwards)
    assert "positions are known to 0.97 mm rms, by the camera's calibration" in said
    found = read_clip_set(tmp_path / "out")
    assert found.table == camera.table and furthest(found, meant) < 1e-3


def test_what_a_camera_tells_is_not_stated_as_well(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_camera(tmp_path / "cam.toml", over_table())
    (tmp_path / "a.csv").write_text(lone(STRAIGHT, STRAIGHT, "t,ball,x_px,y_px"))
    words = [str(tmp_path / "a.csv"), "--camera", str(tmp_path / "cam.toml"), "--out", str(tmp_path / "out")]
    assert main(["import", *words, "--unit", "mm"]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "--unit: the camera's file determines" in line


def test_a_clip_set_with_wrong_entries_is_put_right_by_the_command_that_check_names(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wrong = tmp_path / "wrong"
    (wrong / "clips").mkdir(parents=True)
    (wrong / "clips.toml").write_text((source / "clips.toml").read_text())
    for file in (source / "clips").glob("*.csv"):
        rows = [f"{t},{ball},{1e3 * (x + LENGTH / 2)},{1e3 * (WIDTH / 2 - y)}," for t, ball, x, y in rows_of(file)]
        (wrong / "clips" / file.name).write_text("\n".join(["t,ball,x,y,theta", *rows]) + "\n")
    assert main(["check", str(wrong)]) == 2
    line = capsys.readouterr().out.splitlines()[0]
    words = line[line.index("sysid import") : line.index(" FIXED") + 6].split()
    assert words[2:-2] == [str(wrong), "--unit", "mm", "--origin", "corner", "--y", "down"]
    assert main([*words[1:-1], str(tmp_path / "fixed")]) == 0
    found, meant = read_clip_set(tmp_path / "fixed"), read_clip_set(source)
    assert furthest(found, meant) < 1e-5
    assert [clip.cue for clip in found.clips] == [clip.cue for clip in meant.clips]


def lone(xs: Sequence[float], ys: Sequence[float], head: str = "t,ball,x,y") -> str:
    return "\n".join([head, *(f"{k / 100},cue,{x},{y}" for k, (x, y) in enumerate(zip(xs, ys, strict=True)))]) + "\n"


STRAIGHT = np.linspace(0.1, 0.7, 60)
BAD: dict[str, tuple[str, tuple[str, ...], str]] = {
    "ambiguous origin": (lone(STRAIGHT, STRAIGHT), (), "state it with"),
    "too short": (lone(0.2 * STRAIGHT, -0.5 * STRAIGHT), (), "state it with --unit m|cm|mm|in|ft"),
    "too short still": (lone(0.2 * STRAIGHT, -0.5 * STRAIGHT), ("--unit", "m"), "state it with --x-along"),
    "no unit": (lone(1e5 * STRAIGHT, STRAIGHT), (), "pixels need --camera"),
    "pixels": (lone(1e3 * STRAIGHT, STRAIGHT, "t,ball,x_px,y_px"), (), "give the camera's file with --camera"),
    "mm or pixels": (lone(2e2 + 3e3 * STRAIGHT, 3e2 + 1e2 * STRAIGHT), (), "or pixels? neither cushions"),
    "too short for pixels": (
        lone(5e2 + 1e3 * STRAIGHT, 3e2 + 1e2 * STRAIGHT),
        (),
        "are pixels, give --camera",
    ),
    "frames": ("frame,x,y\n0,1,2\n1,1,2\n2,1,2\n", (), "--fps"),
    "a column of another line": (
        't,ball,"x\u2028z",y\n0,cue,1,2\n0.1,cue,far,2\n',
        ("--columns", "x=x\u2028z"),
        "column 'x\\u2028z', row 3",
    ),
    "text": ("t,ball,x,y\n0,cue,1,2\n0.1,cue,far,2\n", (), "row 3: 'far' is not a number"),
    "twice": ("t,ball,x,y\n0,cue,1,2\n0,cue,1,2\n", (), "appears twice"),
    "late": ("t,ball,x,y\n0,cue,1,2\n-1e308,cue,1,2\n", (), "row 3: t = -1e+308 is too large: "),
    "far": ("t,ball,x,y\n0,cue,1,2\n1,cue,1,2e99\n", (), "row 3: y = 2e+99 is too large: "),
    "ragged": ("t,ball,x,y\n0,cue,1\n", (), "row 2: 3 cells, but 4"),
    "nothing": ("t,ball,x,y\n", (), "holds no rows"),
    "no times": ("a,b,x,y\n1,2,3,4\n", (), "--columns"),
    "another column": ("a,ball,x,y\n1,2,3,4\n", ("--columns", "t=A1"), "no column 'A1'"),
    "columns": ("a,ball,x,y\n1,2,3,4\n", ("--columns", "t"), "write pairs"),
    "struck": ("t,ball,x,y\n0,cue,0,0\n0.1,cue,0.1,0\n", ("--struck", "red"), "has no ball 'red'"),
    "json": ("{]", (), "is not JSON"),
    "list": ("[1, 2]", (), "holds no rows"),
}


@pytest.mark.parametrize("name", BAD)
def test_refusals_are_one_line_and_leave_nothing(tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]) -> None:
    text, words, told = BAD[name]
    (tmp_path / "a.csv").write_text(text)
    assert main(["import", str(tmp_path / "a.csv"), *TABLE, *words, "--out", str(tmp_path / "out")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert told in line
    assert [file.name for file in tmp_path.iterdir()] == ["a.csv"]


def test_a_short_track_is_read_the_only_way_that_puts_it_on_the_table(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_text(lone(1.2 + 0.2 * STRAIGHT, 0.1 * STRAIGHT))
    [clip] = imported([tmp_path / "a.csv"], tmp_path / "out", "--unit", "m", "--origin", "centre").clips
    assert clip.balls["cue"].xy[-1] == pytest.approx([1.34, 0.07], abs=1e-5)
    assert "x along the length" in capsys.readouterr().out


def test_lengths_that_lie_on_the_table_as_the_format_has_them_are_read_so(tmp_path: Path) -> None:
    """One slow ball: across the width it would lie off the table, and in feet it shows too little of it."""
    (tmp_path / "a.csv").write_text(lone(-1.0 + 2.5 * (STRAIGHT - 0.1), 0.1 + 0.9 * (STRAIGHT - 0.1)))
    [clip] = imported([tmp_path / "a.csv"], tmp_path / "out").clips
    assert clip.balls["cue"].xy[-1] == pytest.approx([0.5, 0.64], abs=1e-5)


def test_a_long_table_is_split_by_its_column_of_shots(tmp_path: Path, source: Path) -> None:
    """In UTF-16, as spreadsheets write it, shots in any order of rows."""
    rows = [f"{k},{line}" for k, file in enumerate(sorted((source / "clips").glob("*.csv")), 1)
            for line in file.read_text().splitlines()[1:]]  # fmt: skip
    turns = sorted(rows, key=lambda row: (float(row.split(",")[1]), row))
    (tmp_path / "all.csv").write_text("\n".join(["shot,t,ball,x,y,theta", *turns]), encoding="utf-16")
    found = imported([tmp_path / "all.csv"], tmp_path / "out")
    assert [clip.file for clip in found.clips] == [f"clips/all_{k}.csv" for k in range(1, 9)]
    assert furthest(found, read_clip_set(source)) < 1e-5
    (tmp_path / "bad.csv").write_text("shot,t,ball,x,y\n1,0,cue,0,0\n2,0,cue,0,0\n1,1,cue,far,0\n")
    with pytest.raises(BadInput, match="row 4: 'far' is not a number"):
        [read_clip(part, {}) for _, part in shots_of(read_columns(tmp_path / "bad.csv"), {})]


def test_what_may_be_pixels_is_read_in_the_unit_that_is_stated(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(lone(2e2 + 3e3 * STRAIGHT, 3e2 + 1e2 * STRAIGHT))
    [clip] = imported([tmp_path / "a.csv"], tmp_path / "out", "--unit", "mm").clips
    assert clip.balls["cue"].xy[-1] == pytest.approx([2.3 - LENGTH / 2, 0.37 - WIDTH / 2], abs=1e-5)


def test_what_the_tracks_contradict_is_drawn_and_not_written(
    tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = write_foreign(source, tmp_path / "in", ".csv", long_mm)
    words = [*map(str, files), "--table", "3.569x1.778", "--ball-diameter", "0.0615", "--fps", "120", "--unit", "mm"]
    assert main(["import", *words, "--origin", "corner", "--x-along", "length", "--out", str(tmp_path / "out")]) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert "diameter = 0.0615" in line and "nothing was written" in line
    assert (tmp_path / "out.png").is_file() and not (tmp_path / "out").exists()


def test_readings_are_undone_by_what_they_say() -> None:
    from models.shot import Table

    table, xy = Table(LENGTH, WIDTH), np.array([[0.3, -0.2], [1.2, 0.7]])
    for exchanged in (False, True):
        for y_down in (False, True):
            reading = Reading("mm", True, exchanged, y_down, False)
            across = np.array([1.0, 0.0]), np.array([0.0, 1.0])
            moved = [reading.metres(1e3 * (xy + step), table) - reading.metres(1e3 * xy, table) for step in across]
            hand = np.cross(np.append(moved[0][0], 0), np.append(moved[1][0], 0))[2]
            assert hand == pytest.approx(-1.0 if y_down else 1.0)


def test_columns_are_known_by_many_names(tmp_path: Path) -> None:
    heads = ("time,object_id,pos_x,pos_y", "Timestamp [ms],Label,X (mm),Y (mm)", "t;ball;x;y", "frame_id\tid\tcx\tcy")
    for k, head in enumerate(heads):
        mark = next(one for one in ";\t," if one in head)
        file = tmp_path / f"{k}.csv"
        file.write_text("\n".join([head, *(mark.join((str(t), "1", "2.5", "3")) for t in range(3))]))
        clip = read_clip(read_columns(file), {})
        assert list(clip.balls) == ["ball 1"] and clip.balls["ball 1"].xy.tolist() == [[2.5, 3.0]] * 3
        assert clip.time_unit == (None, "milliseconds", None, "frames")[k]
        assert clip.length_unit == (None, "mm", None, None)[k]


@pytest.mark.slow
def test_tracks_that_begin_in_mid_motion(tmp_path: Path, source: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Several balls that move at first are told so; of one alone an option tells it."""
    whole = read_clip_set(source)
    write_clip_set(cut_in_motion(whole, 5), tmp_path / "cut")
    several = [len(clip.running) > 1 for clip in read_clip_set(tmp_path / "cut").clips]
    assert 0 < sum(several) < len(several)
    files = write_foreign(tmp_path / "cut", tmp_path / "in", ".csv", wide_inches)
    found = imported(files, tmp_path / "one")
    said = capsys.readouterr().out
    count = sum(bool(clip.running) for clip in found.clips)
    assert 0 < count < len(found.clips)
    assert f"{count} of 8 clips begin" in said
    found = imported(files, tmp_path / "all", "--running")
    assert all(clip.running for clip in found.clips)
    said = capsys.readouterr().out
    assert "8 of 8 clips begin in mid-motion" in said
    assert "struck:" not in said
    again = imported([tmp_path / "all"], tmp_path / "again")
    assert [clip.running for clip in again.clips] == [clip.running for clip in found.clips]
    shots = imported(write_foreign(source, tmp_path / "whole", ".csv", wide_inches), tmp_path / "shots")
    assert not any(clip.running for clip in shots.clips)
