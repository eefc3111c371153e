"""Clip sets that contradict what is told of them: spoiled one way at a time, each is named; sound ones are not."""

from __future__ import annotations

import csv
import dataclasses
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from models.errors import BadInput
from sysid.clips import check_clip_set, inspect_clip_set, read_clip_set, write_clip_set
from sysid.clips.consistency.contact_distance import contact_distance
from sysid.clips.consistency.contradictions import contradictions, rebounds, size_notes
from tests.truth.__main__ import main as generate
from tests.truth.sizes import options as size_options

EXAMPLE = Path(__file__).parents[3] / "sysid" / "example"
LENGTH, WIDTH = 3.569, 1.778
Row = tuple[float, float, float]  # t, x, y


def spoiled(folder: Path, rows: Callable[[float, float, float], Row] | None = None, **told: float) -> Path:
    """The shipped example with other numbers in its rows, or other ones in clips.toml."""
    shutil.copytree(EXAMPLE, folder)
    settings = (folder / "clips.toml").read_text()
    for key, value in told.items():
        settings, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", settings)
        assert count == 1
    (folder / "clips.toml").write_text(settings)
    for file in sorted((folder / "clips").glob("*.csv")) if rows else []:
        with file.open(newline="") as text:
            head, *body = csv.reader(text)
        with file.open("w", newline="") as text:
            out = csv.writer(text)
            out.writerow(head)
            for t, ball, x, y, theta in body:
                assert rows is not None
                t2, x2, y2 = rows(float(t), float(x), float(y))
                out.writerow([f"{t2:.9g}", ball, f"{x2:.9g}", f"{y2:.9g}", theta])
    return folder


def only_fault(folder: Path) -> str:
    """The one fault of a clip set, which every reader of it refuses."""
    faults = check_clip_set(folder)
    assert len(faults) == 1, faults
    with pytest.raises(BadInput, match=re.escape(faults[0])):
        read_clip_set(folder)
    return faults[0]


FRAME_FAULTS: dict[str, tuple[Callable[[float, float, float], Row], str, str]] = {
    "mm": (lambda t, x, y: (t, 1e3 * x, 1e3 * y), "look like mm: ", "divide them by 1000"),
    "cm": (lambda t, x, y: (t, 100 * x, 100 * y), "look like cm: ", "divide them by 100"),
    "inches": (lambda t, x, y: (t, x / 0.0254, y / 0.0254), "look like inches: ", "multiply them by 0.0254"),
    "corner": (lambda t, x, y: (t, x + LENGTH / 2, y + WIDTH / 2), "metres from a corner: ", "subtract half"),
    "mm from a corner": (
        lambda t, x, y: (t, 1e3 * (x + LENGTH / 2), 1e3 * (y + WIDTH / 2)),
        "mm from a corner: ",
        "divide them by 1000, then subtract half",
    ),
    "feet": (lambda t, x, y: (t, x / 0.3048, y / 0.3048), "look like feet: ", "--unit ft"),
    "pixels": (lambda t, x, y: (t, 400 * x + 960, 540 - 400 * y), "fit no unit of length", "--camera CAM.toml"),
    "a corner, downwards": (
        lambda t, x, y: (t, x + LENGTH / 2, WIDTH / 2 - y),
        "corner with y downwards: ",
        "--origin corner --y down",
    ),
    "exchanged": (lambda t, x, y: (t, y, x), "x and y exchanged: ", "exchange the columns"),
    "y downwards": (lambda t, x, y: (t, x, -y), "rad from the commanded azimuth", "change the sign of y"),
    "x from the right": (lambda t, x, y: (t, -x, y), "rad from the commanded azimuth", "change the sign of x"),
    "half turn": (lambda t, x, y: (t, -x, -y), "rad from the commanded azimuth", "signs of x and y"),
    "frames": (lambda t, x, y: (round(120 * t), x, y), "t counts frames: ", "divide it by the frame rate"),
    "twice as fast": (lambda t, x, y: (t / 2, x, y), "fps = 120, but rows are 0.004167 s", ": multiply t by 2"),
    "a tenth too small": (lambda t, x, y: (t, 0.9 * x, 0.9 * y), "everything is 0.9", "multiply x and y by 1.111"),
    "milliseconds": (lambda t, x, y: (1e3 * t, x, y), "t looks like milliseconds: ", "divide it by 1000"),
}


@pytest.mark.parametrize("name", FRAME_FAULTS)
def test_coordinates_and_times_that_are_all_wrong_are_one_line(tmp_path: Path, name: str) -> None:
    rows, says, remedy = FRAME_FAULTS[name]
    fault = only_fault(spoiled(tmp_path / "set", rows))
    assert fault.startswith(("all clips: ", "clips.toml: fps"))
    assert says in fault
    assert remedy in fault


def test_times_as_a_film_is_played_are_told_by_how_balls_roll(tmp_path: Path) -> None:
    fault = only_fault(spoiled(tmp_path / "slow", lambda t, x, y: (4 * t, x, y), fps=30.0))
    assert "rolling balls slow down by 0.0073 m/s^2" in fault and "--fps F" in fault
    fault = only_fault(spoiled(tmp_path / "fast", lambda t, x, y: (t / 2, x, y), fps=240.0))
    assert "set off at 1.85 of the commanded speed" in fault and "correct t and fps" in fault


def test_a_frame_rate_that_makes_balls_slow_down_as_on_no_cloth_stops_until_it_is_said_to_be_right(
    tmp_path: Path,
) -> None:
    """Twice the frames taken in a second: no ball is too fast for a cue, yet all roll as through sand."""
    folder = spoiled(tmp_path / "fast", lambda t, x, y: (t / 2, x, y), fps=240.0)
    file = folder / "clips.toml"
    text = re.sub(r"\n\[clip.cue\]\n(\w+ = .*\n)*", "", file.read_text())
    file.write_text(text)
    assert "0.47 m/s^2" in (fault := only_fault(folder)) and "write times_checked = true under [camera]" in fault
    file.write_text(text.replace("[camera]", "[camera]\ntimes_checked = true"))
    found = inspect_clip_set(folder)
    assert not found.faults and "rolling balls slow down" in found.warnings[0]
    write_clip_set(found.sound(), tmp_path / "again")  # a film that was tracked is not lost to a wrong frame rate
    file.write_text(text)
    write_clip_set(dataclasses.replace(found.sound(), extra={}), folder)
    assert "write times_checked" in only_fault(folder)


def test_a_clip_wholly_in_millimetres_is_said_to_be_that_in_one_line(tmp_path: Path) -> None:
    folder = spoiled(tmp_path / "set")
    with (folder / "clips/0003.csv").open(newline="") as text:
        head, *body = csv.reader(text)
    rows = [[t, ball, f"{1e3 * float(x):.1f}", f"{1e3 * float(y):.1f}", theta] for t, ball, x, y, theta in body]
    (folder / "clips/0003.csv").write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    fault = only_fault(folder)
    assert fault.startswith("clips/0003.csv: x = ") and "look like mm, other than in the rest" in fault
    assert "divide them by 1000" in fault


def test_frames_are_told_even_where_the_frame_rate_is_said_to_be_one(tmp_path: Path) -> None:
    fault = only_fault(spoiled(tmp_path / "set", FRAME_FAULTS["frames"][0], fps=1.0))
    assert "t counts frames" in fault and "--time frames --fps F" in fault


def test_a_clip_that_begins_before_the_strike_is_read_from_there(tmp_path: Path) -> None:
    folder = spoiled(tmp_path / "set")
    file = folder / "clips/0002.csv"
    head, *body = file.read_text().splitlines()
    cells = [row.split(",") for row in body]
    still = [[f"{-k / 120:.6f}", *cells[0][1:]] for k in range(30, 0, -1)]
    file.write_text("\n".join([head, *(",".join(row) for row in [*still, *cells])]) + "\n")
    found, plain = inspect_clip_set(folder), inspect_clip_set(EXAMPLE)
    assert (found.resting, plain.resting) == (1, 0)
    clip, meant = found.sound().clips[1], plain.sound().clips[1]
    assert abs(clip.origin) < 1.5 / 120
    assert abs(len(clip.balls["cue"].time) - len(meant.balls["cue"].time)) <= 2


def test_another_ball_that_moves_first_is_the_struck_one(tmp_path: Path) -> None:
    assert generate([str(tmp_path / "set"), "--seed", "5", "--clips", "4", "--kind", "cut"]) == 0
    toml = tmp_path / "set" / "clips.toml"
    toml.write_text(toml.read_text().replace('struck = "cue"', 'struck = "red"'))
    fault = only_fault(tmp_path / "set")
    assert "struck = 'red' of clips/0001.csv, but 'cue' moves while that one rests (3 more clips are so)" in fault


def test_coordinates_of_one_clip_are_a_matter_of_its_rows(tmp_path: Path) -> None:
    folder = spoiled(tmp_path / "set")
    shutil.copy(spoiled(tmp_path / "mm", FRAME_FAULTS["mm"][0]) / "clips/0003.csv", folder / "clips/0003.csv")
    assert all(fault.startswith("clips/0003.csv") for fault in check_clip_set(folder))


def test_another_diameter_is_found_by_where_balls_meet(tmp_path: Path) -> None:
    for wrong in (0.0615, 0.05715):
        fault = only_fault(spoiled(tmp_path / str(wrong), diameter=wrong))
        assert fault.startswith(f"clips.toml: diameter = {wrong:g} m, but balls meet with their centres 0.052")
    for number, diameter in enumerate((0.0525 * 1.005, 0.0525 * 0.995)):
        folder = spoiled(tmp_path / f"set{number}", diameter=diameter)
        assert check_clip_set(folder) == []
        assert inspect_clip_set(folder).warnings == ()


def test_the_diameter_is_measured_to_two_per_cent() -> None:
    assert contact_distance(read_clip_set(EXAMPLE)).value == pytest.approx(0.0525, rel=0.02)


@pytest.mark.parametrize(
    ("key", "value", "rails"),
    [("length", 3.2, "-x"), ("length", 4.0, "-x"), ("width", 1.6, "+y"), ("width", 2.0, "-y")],
)
def test_another_table_is_found_by_where_balls_turn(tmp_path: Path, key: str, value: float, rails: str) -> None:
    folder = spoiled(tmp_path / "set", **{key: value})
    faults = check_clip_set(folder)
    lines = [*faults, *inspect_clip_set(folder).warnings]
    assert any(line.startswith(f"clips.toml: {key} = {value:g}") and f"{rails} at" in line for line in lines)
    assert any("from nose to nose" in line for line in lines)


def test_cushions_are_measured_to_a_thousandth() -> None:
    limits = read_clip_set(EXAMPLE).table.centre_limits(read_clip_set(EXAMPLE).ball)
    found = rebounds(read_clip_set(EXAMPLE))
    for rail in ("-x", "+y", "-y"):
        assert found[rail].value == pytest.approx(limits["xy".index(rail[1])], rel=1e-3)


def test_a_table_that_is_a_little_off_is_a_note_and_no_contradiction(tmp_path: Path) -> None:
    assert size_notes(read_clip_set(EXAMPLE)) == []
    folder = spoiled(tmp_path / "set", width=1.7886)
    assert not inspect_clip_set(folder).warnings
    (note,) = size_notes(read_clip_set(folder))
    assert note.startswith("clips.toml: width = 1.7886 m, but rebounds put the cushions 1.77")
    assert "from nose to nose" in note


@pytest.mark.parametrize(("fps", "factor"), [(60.0, "2"), (240.0, "0.5"), (100.0, "1.2"), (25.0, "4.8")])
def test_another_frame_rate_is_a_fault_unless_every_other_frame_may_be_left_out(
    tmp_path: Path, fps: float, factor: str
) -> None:
    folder = spoiled(tmp_path / "set", fps=fps)
    line = inspect_clip_set(folder).warnings[0] if fps == 240.0 else only_fault(folder)
    assert line.startswith(f"clips.toml: fps = {fps:g}, but rows are 0.008333 s apart, as at 120 frames")
    assert line.endswith(f"multiply t by {factor}")


def test_speeds_that_no_cue_gives(tmp_path: Path) -> None:
    folder = spoiled(tmp_path / "fast", lambda t, x, y: (t / 10, x, y), fps=1200.0)
    assert any("no cue gives more than 13" in warning for warning in inspect_clip_set(folder).warnings)
    faster = spoiled(tmp_path / "faster", lambda t, x, y: (t / 20, x, y), fps=2400.0)
    assert "no cue gives more than 13" in only_fault(faster)


@pytest.mark.parametrize(
    ("angle", "told"),
    [(np.degrees, "write theta in radians"), (lambda a: (a + np.pi) % (2 * np.pi) - np.pi, "theta jumps by a whole")],
)
def test_angles_of_marks_in_degrees_or_counted_anew(tmp_path: Path, angle: Callable[[float], float], told: str) -> None:
    kinds = ["--kind", "side,cushion_side", "--marked", "--clips", "6"]
    assert generate([str(tmp_path / "set"), "--seed", "3", *kinds]) == 0
    assert check_clip_set(tmp_path / "set") == []
    for file in (tmp_path / "set" / "clips").glob("*.csv"):
        head, *body = [row.split(",") for row in file.read_text().splitlines()]
        rows = [[*row[:4], f"{angle(float(row[4])):.4f}" if row[4] else ""] for row in body]
        file.write_text("\n".join(",".join(row) for row in [head, *rows]) + "\n")
    assert told in only_fault(tmp_path / "set")


def test_azimuths_that_fit_no_other_reading_are_a_warning(tmp_path: Path) -> None:
    folder = spoiled(tmp_path / "set")
    text = (folder / "clips.toml").read_text()
    rng = np.random.default_rng(1)
    text = re.sub(r"(?m)^azimuth = .*$", lambda _: f"azimuth = {rng.uniform(-3, 3):.4f}", text)
    (folder / "clips.toml").write_text(text)
    (warning,) = inspect_clip_set(folder).warnings
    assert "correct cue.azimuth" in warning


@pytest.mark.parametrize(
    "options",
    [
        ["--soiled", "--outliers", "0.004", "--clips", "12"],
        ["--soiled", "--no-cue", "--no-sigma", "--fps", "60", "--clips", "12"],
        *([*size_options(effect), "--clips", "8"] for effect in ("image_scale", "lens_distortion", "camera_tilt")),
    ],
    ids=lambda options: options[0] + options[1],
)
def test_soil_and_cameras_contradict_nothing(tmp_path: Path, options: list[str]) -> None:
    assert generate([str(tmp_path / "set"), "--seed", "7", *options]) == 0
    faults = check_clip_set(tmp_path / "set")
    assert [fault for fault in faults if "lies outside the table" not in fault] == []  # wild samples do
    if not faults:
        assert contradictions(read_clip_set(tmp_path / "set")) == []


@pytest.mark.slow
def test_no_set_of_the_data_is_contradicted(data_folder: Path) -> None:
    for toml in sorted(data_folder.glob("**/clips.toml")):
        assert contradictions(read_clip_set(toml.parent)) == [], toml
