"""The review recording: what is written is what is read back, whole or not at all."""

from __future__ import annotations

import dataclasses
import math
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.errors import BadInput
from models.recording import layers
from models.recording import shots as view
from models.recording.clips import Review
from models.recording.shots import write_review
from models.recording.table import pocket_discs
from models.shot import Table, Track
from models.table import palette
from models.table.palette import ball_colour
from models.table.pocket_shape import POCKET_SETS
from tests.support.outputs import check_recording
from tests.support.reviewed_clips import BALL, OFFSET, TABLE, clip, column, read, seconds


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Any]]]:
    path = tmp_path_factory.mktemp("view") / "review.rrd"
    only_seen = Review("only seen", {"blue": (np.array([0.2, 0.3, 0.4]), np.full((3, 2), 0.1))})
    write_review(path, TABLE, BALL, [clip("first"), clip("second"), only_seen], title="Two and one")
    return path, read(path)


def test_errors_of_a_known_offset(written: tuple[Path, dict[str, list[Any]]]) -> None:
    for plot, want in (("distance/found", 5.0), ("x", 3.0), ("y", -4.0)):
        for ball in ("cue", "red"):
            values = np.array(column(written[1][f"/error/{plot}/{ball}"], "Scalars:scalars"), dtype=float).ravel()
            assert np.isnan(values).sum() == 2  # one gap after each clip
            assert values[np.isfinite(values)] == pytest.approx(want, abs=1e-3)
    assert "/error/x/blue" not in written[1]


def test_speed_is_the_models(written: tuple[Path, dict[str, list[Any]]]) -> None:
    values = np.array(column(written[1]["/speed/cue"], "Scalars:scalars"), dtype=float).ravel()
    assert (values[0], np.nanmin(values)) == (pytest.approx(0.9), pytest.approx(0.5))


def test_clips_follow_one_another_from_whole_seconds(written: tuple[Path, dict[str, list[Any]]]) -> None:
    assert sorted(seconds(written[1]["/text/clip"])) == pytest.approx([0.0, 3.0, 6.0])
    times = np.array(seconds(written[1]["/error/x/cue"]))
    assert (times.min(), times.max()) == (0.0, pytest.approx(3.0 + 119 / 60 + 1e-3))


def test_table_frame_and_disappearance(written: tuple[Path, dict[str, list[Any]]]) -> None:
    rows = column(written[1]["/top/measured/blue"], "Points2D:positions")
    assert rows[:3] == [[], [], []]  # absent from both first clips, and not yet seen at the third's start
    assert np.array(rows[3:]) == pytest.approx(0.1)
    assert column(written[1]["/top/measured/cue"], "Points2D:positions")[-1] == []  # hidden in the last clip
    high = column(written[1]["/space/model/found/ball/cue"], "Ellipsoids3D:centers")
    assert high[0][0] == pytest.approx([-1.0 + OFFSET[0], OFFSET[1], BALL.radius])


def test_paths_are_whole_from_the_beginning_of_a_clip(written: tuple[Path, dict[str, list[Any]]]) -> None:
    dots = column(written[1]["/top/measured_path/red"], "Points2D:positions")
    lines = column(written[1]["/top/model/found/path/red"], "LineStrips2D:strips")
    assert [len(row) for row in dots] == [120, 120, 0]
    assert [[len(strip) for strip in row] for row in lines] == [[500], [500], []]


def test_events_are_marked_where_they_happen(written: tuple[Path, dict[str, list[Any]]]) -> None:
    marks = column(written[1]["/top/event/cushion"], "Points2D:positions")
    assert marks[0][0] == pytest.approx([-0.2 + OFFSET[0], OFFSET[1]], abs=1e-4)
    assert seconds(written[1]["/error/distance/event_cushion"]) == pytest.approx([1.0, 4.0])
    log = [text for row in column(written[1]["/text/log"], "TextLog:text") for text in row]
    assert "cushion: cue +x" in log
    assert "ball hits ball: cue and red" in log


def test_words_name_clips_and_errors(written: tuple[Path, dict[str, list[Any]]]) -> None:
    pages = [row[0] for row in column(written[1]["/text/clip"], "TextDocument:text")]
    assert "# first" in pages[0]
    assert "**rms position error 5.00 mm**" in pages[0]
    assert "note of second" in pages[1]
    assert "Measured only" in pages[2]
    guide = column(written[1]["/text/guide"], "TextDocument:text")[0][0]
    assert "measured" in guide
    assert "Cyan" in guide


def test_up_on_the_picture_is_plus_y(written: tuple[Path, dict[str, list[Any]]]) -> None:
    """A view leaves out the transform of its own origin, so the mirror has to lie below it."""
    from rerun.chunk import RrdReader

    (mirror,) = column(written[1]["/top"], "Transform3D:mat3x3")
    assert np.reshape(mirror, (3, 3)) == pytest.approx(np.diag([1.0, -1.0, 1.0]))
    reader = RrdReader(written[0])
    batches = [chunk.to_record_batch() for chunk in reader.stream(store=reader.blueprints()[0]).to_chunks()]
    views = {
        column([batch], "display_name")[0][0]: column([batch], "space_origin")[0][0]
        for batch in batches
        if column([batch], "space_origin")
    }
    assert views["Table from above"] == "/"


def test_pockets_only_when_the_table_has_them(tmp_path: Path, written: tuple[Path, dict[str, list[Any]]]) -> None:
    write_review(tmp_path / "no.rrd", Table(2.0, 1.0, pockets=False), BALL, [clip("a")], title="t")
    assert "/top/table/pockets" in written[1]
    assert not [path for path in read(tmp_path / "no.rrd") if "pockets" in path]


@pytest.mark.parametrize("name", ["snooker", "pool 9 ft", "pool 7 ft"])
def test_pockets_are_drawn_as_wide_as_they_are(name: str) -> None:
    table = Table(2.54, 1.27, POCKET_SETS[name])
    discs, radii = pocket_discs(table)
    corner, middle = POCKET_SETS[name].corner.mouth, POCKET_SETS[name].middle.mouth
    assert 2 * radii == pytest.approx([corner] * 4 + [middle] * 2)
    assert np.all(table.to_pocket(discs) < radii)


def test_a_potted_ball_goes_and_has_no_error_from_then_on(tmp_path: Path) -> None:
    review = clip("pot")
    review.models["found"].position[250:, 1] = math.nan
    write_review(tmp_path / "pot.rrd", TABLE, BALL, [review], title="t")
    found = read(tmp_path / "pot.rrd")
    errors = np.array(column(found["/error/distance/found/red"], "Scalars:scalars"), dtype=float).ravel()
    assert 55 < np.isfinite(errors).sum() < 61
    assert column(found["/top/model/found/ball/red"], "Ellipses2D:centers")[-1] == []


@pytest.fixture(scope="module")
def ladder(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, list[Any]]]:
    """A clip with three models, OFFSET, twice and three times OFFSET away, in the order base, one, two."""
    path, one = tmp_path_factory.mktemp("ladder") / "review.rrd", clip("shot")
    track = one.models["found"]
    spin = np.zeros_like(track.spin)
    spin[..., 1] = track.velocity[..., 0] / BALL.radius
    tracks = {
        name: dataclasses.replace(track, position=track.position + more * OFFSET, spin=spin)
        for name, more in (("base", 2), ("base + one", 1), ("base + one + two", 0))
    }
    write_review(path, TABLE, BALL, [dataclasses.replace(one, models=tracks)], title="ladder")
    return path, read(path)


def test_every_model_of_a_ladder_has_paths_of_its_own(ladder: tuple[Path, dict[str, list[Any]]]) -> None:
    for more, part in ((3, "base"), (2, "base\\ \\+\\ one"), (1, "base\\ \\+\\ one\\ \\+\\ two")):
        rings = column(ladder[1][f"/top/model/{part}/ball/cue"], "Ellipses2D:centers")
        assert rings[0][0] == pytest.approx([-1.0, 0.0] + more * OFFSET)
        assert f"/space/model/{part}/path/red" in ladder[1]
        sizes = np.array(column(ladder[1][f"/error/distance/{part}/cue"], "Scalars:scalars"), dtype=float)
        assert np.nanmedian(sizes) == pytest.approx(5.0 * more, abs=1e-3)
    colours = [
        str(column(ladder[1][f"/error/distance/{part}/cue"], "SeriesLines:colors")[0])
        for part in ("base", "base\\ \\+\\ one\\ \\+\\ two")
    ]
    assert colours[0] != colours[1], "the curves of one ball are told apart"
    along_x = np.array(column(ladder[1]["/error/x/cue"], "Scalars:scalars"), dtype=float)
    assert np.nanmedian(along_x) == pytest.approx(3.0, abs=1e-3), "of the last model alone"
    page = column(ladder[1]["/text/clip"], "TextDocument:text")[0][0]
    assert "| base | 15.00 mm |" in page and "| base + one + two | 5.00 mm |" in page


def test_models_between_first_and_last_are_hidden_at_first(ladder: tuple[Path, dict[str, list[Any]]]) -> None:
    from rerun.chunk import RrdReader

    reader = RrdReader(ladder[0])
    chunks = list(reader.stream(store=reader.blueprints()[0]).to_chunks())
    shown = {c.entity_path: column([c.to_record_batch()], "EntityBehavior:visible") for c in chunks}
    hidden = [path for path, values in shown.items() if values == [[False]]]
    assert len(hidden) == 4, "in the table from above, in 3-D, among the misses and in the plot"
    assert all("base\\ \\+\\ one/visualizers" in path for path in hidden)


def test_impulses_are_mass_times_the_change_of_velocity(tmp_path: Path) -> None:
    one = clip("cushion")
    track = one.models["found"]
    track.velocity[track.times > 1.0, 0] = -0.5, 0.2
    write_review(tmp_path / "x.rrd", TABLE, BALL, [one], title="t")
    found = read(tmp_path / "x.rrd")
    ((arrow,),) = column(found["/top/impulse/cushion"], "Arrows2D:vectors")
    assert arrow == pytest.approx(BALL.mass * np.array([-0.5 - 0.7, 0.2]), abs=1e-4)
    assert column(found["/space/impulse/cushion"], "Arrows3D:vectors")[0][0] == pytest.approx([*arrow, 0.0])
    assert column(found["/top/impulse/cushion"], "Arrows2D:labels") == [["impulse 0.171 N s"]]
    assert "/top/impulse/ball" not in found, "without a change of velocity there is no arrow"


def test_spin_lies_along_its_axis(ladder: tuple[Path, dict[str, list[Any]]]) -> None:
    batches = ladder[1]["/space/spin/cue"]
    arrows = [row for row in column(batches, "Arrows3D:vectors") if row is not None]
    assert arrows[0][0] == pytest.approx([0.0, 0.9 * layers.SPIN_S, 0.0])
    assert arrows[-1] == [], "hidden at the end"
    assert len(arrows) < 70, "not one for every sample"


def test_misses_are_magnified_from_where_a_ball_was_seen(ladder: tuple[Path, dict[str, list[Any]]]) -> None:
    (lines,) = column(ladder[1]["/top/miss/base/red"], "LineStrips2D:strips")
    assert 40 <= len(lines) <= layers.MAX_MISSES
    assert np.array(lines[0][0]) == pytest.approx([-1.0, 0.03])
    assert np.array(lines[0][1]) - lines[0][0] == pytest.approx(5 * 3 * OFFSET, rel=1e-3), "15 mm, drawn within 0.12 m"


def test_a_ball_at_rest_is_written_once(tmp_path: Path) -> None:
    resting = np.full((120, 2), 0.5)
    times = np.arange(120) / 60
    still = Track(("red",), times, resting[:, None], np.zeros((120, 1, 2)), np.zeros((120, 1, 3)), np.zeros((120, 1)))
    write_review(tmp_path / "x.rrd", TABLE, BALL, [Review("r", {"red": (times, resting)}, {"m": still})], title="t")
    found = read(tmp_path / "x.rrd")
    for path, name in (("/top/measured/red", "Points2D:positions"), ("/top/model/m/ball/red", "Ellipses2D:centers")):
        assert column(found[path], name) == [[[0.5, 0.5]]] * 2, "at the first and the last sample"


def test_the_same_review_is_the_same_recording(tmp_path: Path) -> None:
    views = {"Table from above", "Table in 3-D", "This clip", "How to read this"}
    check_recording(
        tmp_path, lambda path, title: write_review(path, TABLE, BALL, [clip("x")], title=title), views,
        {"shot_time", "clip"},
    )  # fmt: skip
    one, other, third = (content(tmp_path / name) for name in "abc")
    assert one == other != third
    assert any(rows > 100 for _, rows, _ in one), "the paths of balls"


UUID = re.compile(r"[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}")


def content(path: Path) -> list[tuple[str, int, str]]:
    """What a file holds, but for what Rerun stamps it with: of every chunk its entity, rows and values, in order.

    Of the layout, which names its views anew each time and by them its entities, only what it is made of.
    """
    from rerun.chunk import RrdReader

    found, reader = [], RrdReader(path)
    for chunk in reader.stream().to_chunks():
        batch = chunk.to_record_batch()
        kept = {name: batch[name].to_pylist() for name in sorted(batch.schema.names) if "RowId" not in name}
        found.append((chunk.entity_path, batch.num_rows, repr(kept)))
    for chunk in (chunk for store in reader.blueprints() for chunk in reader.stream(store=store).to_chunks()):
        entity, batch = UUID.sub("...", chunk.entity_path), chunk.to_record_batch()
        found.append((entity, batch.num_rows, repr(sorted(batch.schema.names))))
    return sorted(found)


def test_an_interrupted_write_leaves_nothing_and_keeps_what_was_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "review.rrd"
    write_review(path, TABLE, BALL, [clip("x")], title="t")
    before = path.read_bytes()

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(view, "_describe", stop)
    with pytest.raises(KeyboardInterrupt):
        write_review(path, TABLE, BALL, [clip("y")], title="t")
    assert path.read_bytes() == before
    assert [file.name for file in tmp_path.iterdir()] == ["review.rrd"]


def test_faults_are_named(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no clips"):
        write_review(tmp_path / "x.rrd", TABLE, BALL, [], title="t")
    with pytest.raises(ValueError, match=r"clip 'bad', ball 'cue': time \(3,\), xy \(2, 2\)"):
        bad = Review("bad", {"cue": (np.arange(3.0), np.zeros((2, 2)))})
        write_review(tmp_path / "x.rrd", TABLE, BALL, [bad], title="t")
    with pytest.raises(BadInput, match="nowhere"):
        write_review(tmp_path / "nowhere" / "x.rrd", TABLE, BALL, [clip("x")], title="t")


def test_names_with_any_character(tmp_path: Path) -> None:
    write_review(tmp_path / "x.rrd", TABLE, BALL, [clip("a/b", balls=("ball 1/2", "rød"))], title="t / u")
    assert len([path for path in read(tmp_path / "x.rrd") if path.startswith("/error/x/")]) == 2


def test_colours_follow_names() -> None:
    assert ball_colour("red_07") == ball_colour("Red") == palette.SCREEN_COLOURS["red"]
    assert ball_colour("white") == ball_colour("cue")
    assert ball_colour("lilac") == ball_colour("lilac") in palette.OTHER_COLOURS


def test_many_clips_and_a_full_table_are_quick(tmp_path: Path) -> None:
    write_review(tmp_path / "warm.rrd", TABLE, BALL, [clip("x")], title="imports Rerun")
    full = clip("break", duration=5.0, fps=180.0, balls=("cue", *(f"red_{k:02d}" for k in range(21))))
    start = time.process_time()
    write_review(tmp_path / "break.rrd", TABLE, BALL, [full], title="t")
    middle = time.process_time()
    write_review(tmp_path / "many.rrd", TABLE, BALL, [clip(f"clip {k}", duration=5.0) for k in range(120)], title="t")
    print(f"full table {middle - start:.2f} s, 120 clips {time.process_time() - middle:.2f} s")
    assert middle - start < 1.0
    assert time.process_time() - middle < 4.0
    assert len(column(read(tmp_path / "many.rrd")["/text/clip"], "TextDocument:text")) == 120
