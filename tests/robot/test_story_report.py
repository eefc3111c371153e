"""A series on paper, as a picture and as a recording: its figures are right, whatever was not seen stays unsaid."""

from __future__ import annotations

import dataclasses
import math
import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from models.recording.series import STORY_CURVES, SeriesRecording, SeriesShot
from models.recording.story import write_story
from robot.learning.blocks import blocks, changes, ends
from robot.learning.history import History, Refit
from robot.learning.report import recording_of, sentences, write_picture, write_recording, write_report
from tests.support.html_pages import STRANGE, Page
from tests.support.outputs import check_bad_places, check_page, check_recording
from tests.support.reviewed_clips import column, read, seconds
from tests.support.series_samples import series
from tests.support.story_samples import FAR, FELL, FOUND, NEAR, NO_FILM, UNSEEN, long_story, sample_story

EMPTY = History({"every": 10}, (), (), "")


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("story") / "story.html"
    write_report(path, sample_story(), "A series")
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Any]]:
    path = tmp_path_factory.mktemp("story") / "story.rrd"
    write_recording(path, sample_story())
    return read(path)


def rows_of(page: str, which: int) -> list[list[str]]:
    """Cells of a table of the page."""
    table = re.findall(r"<tbody>(.*?)</tbody>", page, re.DOTALL)[which]
    return [re.findall(r"<td[^>]*>(.*?)</td>", row) for row in re.findall(r"<tr>(.*?)</tr>", table)]


@pytest.mark.parametrize(("count", "every"), ((0, 10), (1, 10), (9, 10), (10, 10), (14, 10), (15, 10), (60, 7)))
def test_blocks_hold_every_shot_once_and_end_at_refits(count: int, every: int) -> None:
    story = History({"every": every}, (sample_story().shots[0],) * count, (), "")
    found = blocks(story)
    assert [k for first, last in found for k in range(first, last + 1)] == list(range(1, count + 1))
    assert all(last % every == 0 for _, last in found[:-1])
    shown = ends(story)
    assert shown[:1] == found[:1]
    assert len(shown) == (0 if count == 0 else 1 if count < 1.5 * every else 2)
    if len(shown) == 2:
        assert 2 * (shown[1][1] - shown[1][0] + 1) >= every


def test_what_refits_add_and_drop_comes_to_their_verdict() -> None:
    base = sample_story().refits[0]
    verdicts = [("a", "b"), ("a", "b"), ("b", "c"), ("a", "c")]
    refits = tuple(dataclasses.replace(base, shots=k, verdict=v) for k, v in enumerate(verdicts))
    held: set[str] = set()
    for change, verdict in zip(changes(History({}, (), refits, "")), verdicts, strict=True):
        assert not held & set(change.added)
        held = (held | set(change.added)) - set(change.dropped)
        assert held == set(verdict)
    said = " ".join(sentences(dataclasses.replace(sample_story(), refits=refits)))
    assert "after 2 shots c, a dropped; after 3 shots a, b dropped" in said


def test_sentences_tell_the_medians() -> None:
    said = " ".join(sentences(sample_story()))
    first = 1e3 * np.median([FAR * (0.5 + 0.1 * k) for k in range(1, 7) if k != FELL])
    last = 1e3 * np.median([NEAR * (0.5 + 0.1 * k) for k in range(7, 13) if k != UNSEEN])
    floor = 1e3 * np.median([0.02 + 0.001 * k for k in (10, 11, 12)])
    assert f"(shots 1 to 6) the cue ball missed by {first:.0f} mm" in said
    assert f"(shots 7 to 12) by {last:.1f} mm: {first / last:.1f} times less" in said
    assert f"is {floor:.1f} mm: the cue ball misses by {last / floor:.2f} times that" in said
    promised = sum(0.5 + 0.03 * k for k in range(1, 13) if k != UNSEEN)
    assert f"{promised:.1f} predicted and 7 seen, of 11 shots" in said
    assert "12 shots played, 1 refit" in said
    assert f"after 6 shots {', '.join(FOUND)}." in said
    assert "Unexplained: after the cushion +x." in said
    assert "The series ended: all 12 shots are played." in said


def test_without_repeats_the_plans_say_what_to_expect() -> None:
    story = sample_story()
    shots = tuple(dataclasses.replace(shot, floor=math.nan) for shot in story.shots)
    spread = 1e3 * np.median([0.05 / k for k in range(7, 13)])
    said = " ".join(sentences(dataclasses.replace(story, shots=shots)))
    assert f"No stroke was repeated; the plans of shots 7 to 12 predicted a miss of {spread:.2f} mm" in said
    blind = tuple(dataclasses.replace(shot, spread=math.nan) for shot in shots)
    assert "the plans predict no miss" in " ".join(sentences(dataclasses.replace(story, shots=blind)))


def test_a_series_that_gets_worse_is_told_so() -> None:
    story = sample_story()
    turned = tuple(
        dataclasses.replace(shot, number=13 - shot.number) for shot in reversed(story.shots)
    )  # the near ones first
    assert "3.6 times more" in " ".join(sentences(dataclasses.replace(story, shots=turned)))


def test_the_page_is_whole_and_needs_nothing_else(page: str) -> None:
    words = " ".join(check_page(page, 4).words)
    assert page.count('media="screen and (max-width:560px)"') == 1, "the error falling, whole on a phone"
    assert all(line in words for line in sentences(sample_story()))


def test_pictures_tell_medians_effects_and_constants(page: str) -> None:
    misses, constants, above, pots = Page(page).pictures()
    for word in ("+ table_tilt", "+ squirt", ">160<", ">45.0<", "repeats", "in a pocket, or not seen"):
        assert word in misses, word
    for word in ("decoupled_cloth.roll", "table_tilt.slope_x", "tip_restitution", "cue_mass"):
        assert word in constants, word
    for word in ("Shots 1 to 6: median miss 160 mm", "Shots 7 to 12: median miss 45.0 mm", "fell, or not seen"):
        assert word in above, word
    for number in range(1, 13):
        assert f">{number}<" in above
    for word in ("4 of 6", "3 of 5", "1–6", "7–12"):
        assert word in pots, word


def test_tables_tell_every_shot_and_refit(page: str) -> None:
    (refit,) = rows_of(page, 0)
    assert refit == ["6", "table_tilt, squirt", "after the cushion +x", f"{0.52 * 2**0.5:.2f} mm", "–", "1.07", "64.2"]
    shots, story = rows_of(page, 1), sample_story()
    assert [row[0] for row in shots] == [str(k) for k in range(1, 13)]
    for row, shot in zip(shots, story.shots, strict=True):
        size = 1e3 * (FAR if shot.number <= 6 else NEAR) * (0.5 + 0.1 * shot.number)
        missing = shot.number in (FELL, UNSEEN)
        assert row[1:4] == ["corner +x +y", f"{50 + 3 * shot.number} %", row[3]]
        assert row[3] == ("–" if shot.number == UNSEEN else "no" if shot.number % 3 == 0 else "yes")
        assert row[4] == ("–" if missing else f"{size:#.3g} mm".replace(". ", " "))
        assert (row[6] == "–") is missing
    noted = {k: shots[k - 1][-1] for k in (1, NO_FILM, FELL, UNSEEN)}
    assert noted[1] == "–"
    assert noted[NO_FILM] == "no film; the film is lost: the disk is &lt;full&gt;"
    assert noted[FELL] == "in-off"
    assert "unknown whether it was struck; no film; resting place of the cue ball not seen" in noted[UNSEEN]


def test_what_is_not_known_is_a_dash(tmp_path: Path) -> None:
    story = sample_story()
    nothing: Any = None
    refit = Refit(6, (), "", math.nan, math.nan, nothing, {"a": (math.nan, math.nan)}, {}, math.nan)
    blind = tuple(
        dataclasses.replace(
            shot, cue_end=None, potted=None, clip=None, spread=math.nan, floor=math.nan, pot_probability=math.nan,
            planned_end=np.full(2, math.nan), played={}, plan={},
        )
        for shot in story.shots
    )  # fmt: skip
    story = dataclasses.replace(story, refits=(refit,), shots=blind, course={})
    write_report(tmp_path / "a.html", story, "Nothing seen")
    write_picture(tmp_path / "a.png", story)
    write_recording(tmp_path / "a.rrd", story)
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert "nan" not in re.sub(r"base64,[^\"]+", "", page)
    assert "None" not in page
    assert not any("nan" in picture for picture in Page(page).pictures())
    assert rows_of(page, 0) == [["6", "none", "–", "–", "–", "–", "–"]]
    assert all(row[2:7] == ["–"] * 5 for row in rows_of(page, 1))
    said = " ".join(sentences(story))
    assert "the cue ball was not seen to stop" in said
    assert "No shot was seen to its end." in said


@pytest.mark.parametrize(("count", "refits"), ((0, 0), (0, 1), (1, 1)))
def test_a_series_that_has_just_begun_is_drawn(count: int, refits: int, tmp_path: Path) -> None:
    whole = sample_story()
    story = dataclasses.replace(EMPTY, shots=whole.shots[:count], refits=whole.refits[:refits])
    write_report(tmp_path / "a.html", story, "Begun")
    write_picture(tmp_path / "a.png", story)
    write_recording(tmp_path / "a.rrd", story)
    page = (tmp_path / "a.html").read_text(encoding="utf-8")
    assert Page(page).open == []
    assert "The series has not ended." in page
    assert ("No shot was played yet." in page) is (count == 0)
    assert "times less" not in page  # there is one block at most
    assert cv2.imread(str(tmp_path / "a.png")).shape[1] > 1400


def test_the_same_series_gives_the_same_bytes(page: str, tmp_path: Path) -> None:
    write_report(tmp_path / "a.html", sample_story(), "A series")
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == page
    for name in ("a.png", "b.png"):
        write_picture(tmp_path / name, sample_story())
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()


def test_text_of_any_kind_stays_text(tmp_path: Path) -> None:
    story = sample_story()
    refit = dataclasses.replace(story.refits[0], verdict=(STRANGE,), unexplained=STRANGE, values={STRANGE: (1.0, 0.1)})
    shot = dataclasses.replace(story.shots[0], played={"noted": [STRANGE]}, plan={"kind": STRANGE})
    story = dataclasses.replace(story, refits=(refit,), shots=(shot,), ended=STRANGE)
    write_report(tmp_path / "a.html", story, STRANGE)
    write_recording(tmp_path / "a.rrd", story)
    page = Page((tmp_path / "a.html").read_text(encoding="utf-8"))
    assert page.open == []
    assert "script" not in {tag for tag, _ in page.seen}


def test_notes_over_the_picture_do_not_overlap() -> None:
    from robot.learning.misses import FIGURE_WIDTH_IN, _placed_notes

    notes, rows = _placed_notes(long_story(40, 4), FIGURE_WIDTH_IN)
    assert {text[2:] for *_, text in notes} == {
        "table_tilt", "cloth_nap", "cushion_restitution_speed", "squirt", "ball_friction_speed",
    }  # fmt: skip
    wide = {text: len(text) * 0.05 * 40 / 9.6 for *_, text in notes}  # shots
    for k, (x, row, side, text) in enumerate(notes):
        assert 0 <= row < rows
        low = x if side == "left" else x - wide[text]
        for at, other, where, word in notes[:k]:
            begin = at if where == "left" else at - wide[word]
            assert other != row or begin + wide[word] <= low or low + wide[text] <= begin


def test_the_recording_holds_ways_and_places_of_every_shot(recorded: dict[str, list[Any]]) -> None:
    story = sample_story()
    planned, played = (series(recorded[f"/top/{who}/white"], "LineStrips2D:strips") for who in ("planned", "played"))
    told, stopped = series(recorded["/top/target"], ":strips"), series(recorded["/top/stopped"], "Ellipses2D:centers")
    arrows = series(recorded["/top/miss"], "Arrows2D:vectors")
    for shot in story.shots:
        k = shot.number
        assert np.array(planned[k][0][0]) == pytest.approx(np.array(shot.plan["tracks"][0]["xy"]), abs=1e-6)
        assert np.array(told[k][0]).mean(axis=(0, 1)) == pytest.approx(shot.planned_end, abs=1e-6)
        if shot.clip is None:
            assert played[k] == [[]]
        else:
            assert np.array(played[k][0][0]) == pytest.approx(shot.clip.balls["white"].xy, abs=1e-6)
        if shot.cue_end is None:
            assert stopped[k] == arrows[k] == [[]]
        else:
            assert stopped[k][0][0] == pytest.approx(shot.cue_end, abs=1e-6)
            assert np.hypot(*arrows[k][0][0]) == pytest.approx(shot.miss, abs=1e-6)


def test_balls_roll_shot_after_shot_and_one_that_fell_goes(recorded: dict[str, list[Any]]) -> None:
    batches = [b for b in recorded["/top/ball/white"] if "shot" in b.schema.names]
    shown, times = series(batches, "Points2D:positions"), seconds(batches)
    assert times == sorted(times)
    assert times[0] == 0.0
    assert [row for row in shown[FELL] if not row] == [[]] == [shown[FELL][-1]]
    for shot in sample_story().shots:
        if shot.clip is None:
            (row,) = shown[shot.number]
            assert row[0] == pytest.approx(shot.scene.position[0], abs=1e-6)
        elif shot.number != FELL:
            assert shown[shot.number][-1][0] == pytest.approx(shot.cue_end, abs=1e-6)


def test_the_recording_holds_curves_and_refits(recorded: dict[str, list[Any]]) -> None:
    story = sample_story()
    for key, of in (("miss", "miss"), ("spread", "spread"), ("floor", "floor")):
        rows = series(recorded[f"/plot/{key}"], "Scalars:scalars")
        found = [rows[shot.number][0][0] for shot in story.shots]
        assert found == pytest.approx([1e3 * getattr(shot, of) for shot in story.shots], nan_ok=True)
    median = series(recorded["/plot/median"], "Scalars:scalars")
    assert [median[k][0][0] for k in (1, 6, 7, 12)] == pytest.approx([160, 160, 45, 45])
    refits = series(recorded["/log/refit"], "TextLog:text")
    assert list(refits) == [6]
    assert "new: table_tilt, squirt" in refits[6][0][0]
    lines = column(recorded["/log/shot"], "TextLog:text")
    assert len(lines) == 12
    assert "in-off" in lines[FELL - 1][0]
    assert "160 mm" in column(recorded["/text/series"], "TextDocument:text")[0][0]


def test_views_of_the_recording(tmp_path: Path) -> None:
    views = {
        "The shot from above", "Shots, and what refits found", "This shot", "How to read this",
        "Miss of the cue ball over the shots [mm]",
    }  # fmt: skip
    check_recording(
        tmp_path, lambda path, title: write_recording(path, sample_story(), title), views, {"shot", "shot_time"}
    )


def test_a_recording_is_plain_values() -> None:
    made = recording_of(sample_story())
    assert [scene.number for scene in made.scenes] == list(range(1, 13))
    assert set(made.scenes[0].curves) == set(STORY_CURVES)
    assert recording_of(EMPTY) == SeriesRecording((), (), "\n\n".join(sentences(EMPTY)))


def test_arrays_that_do_not_fit_are_named(tmp_path: Path) -> None:
    scene = SeriesShot(4, {}, planned={"red": (np.zeros(3), np.zeros((2, 2)))})
    with pytest.raises(ValueError, match=r"shot 4, ball 'red': time \(3,\), xy \(2, 2\)"):
        write_story(tmp_path / "a.rrd", SeriesRecording((scene,)), title="t")
    assert list(tmp_path.iterdir()) == []


def test_a_bad_place_is_named_and_nothing_is_left(tmp_path: Path) -> None:
    check_bad_places(
        tmp_path, lambda at: write_report(at, EMPTY, "t"), lambda at: write_picture(at, EMPTY),
        lambda at: write_recording(at, EMPTY),
    )  # fmt: skip
