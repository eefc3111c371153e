"""Shots that depart alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.model_file import full_model
from models.shot import Event
from sysid.clips import Clip, read_clip_set
from sysid.estimation.from_nothing import fit_from_nothing
from sysid.estimation.split import split
from sysid.selection.departures import ShotDeparture, common_event, departing, departing_held_out
from sysid.selection.discover import discover
from sysid.selection.exchange import exchanged
from sysid.selection.scoring.evidence import mean_squares
from tests.truth.__main__ import main as generate


def test_a_shot_departs_by_size_and_significance() -> None:
    squares, counts = np.array([1.0, 1.05, 2.0, 2.0, 0.95]), np.array([900, 900, 900, 20, 900])
    assert departing(squares, counts, 1.0, 1.0).tolist() == [2]  # twenty residuals may be that large by chance
    assert departing(squares, counts, 60.0, 1.0).size == 0
    assert departing(squares, counts, 1.0, 2.0).size == 0


def test_mean_squares_leave_out_what_is_missing_and_clip_what_is_wild() -> None:
    squares, counts = mean_squares(np.array([[1.0, -1.0, np.nan], [3.0, 100.0, 0.0]]), 4.0)
    assert counts.tolist() == [2, 3]
    assert squares == pytest.approx([1.0, (9 + 16) / 3])
    assert mean_squares(np.array([[2.0, 4.0]]))[0] == pytest.approx([10.0])


def departure(kind: str | None) -> ShotDeparture:
    return ShotDeparture(
        0, 2.0, None if kind is None else Event(0.5, kind, ("cue",), "+x" if kind == "cushion" else "")
    )


@pytest.mark.parametrize(
    ("kinds", "cause"),
    [((), None), (("ball",), None), (("ball", "ball"), "ball"), ((None, None), "start"), (("ball", "cushion"), None),
     (("cushion",) * 3 + ("ball",), "cushion")],
)  # fmt: skip
def test_several_shots_share_a_cause_if_they_depart_after_one_kind_of_event(
    kinds: tuple[str | None, ...], cause: str | None
) -> None:
    assert common_event([departure(kind) for kind in kinds]) == cause


def test_a_departure_says_after_what() -> None:
    assert "2 times the error of the others, from its impact at the cushion +x at 0.50 s on" in departure(
        "cushion"
    ).text("clips/0004.csv")
    assert "from its start" in departure(None).text("clips/0004.csv")


@pytest.mark.slow
@pytest.mark.thorough
def test_balls_that_cling_now_and_then_are_located(tmp_path: Path) -> None:
    """By chance, in some collisions: no effect or formula says in which, and no clip departs alone."""
    words = ("--seed", "71", "--clips", "12", "--sigma", "0.0005", "--missing", "0.01", "--seconds", "4")
    cling = ("--constant", "cling=1.0", "--constant", "cling_share=0.4")
    cuts = ("--kind", "cut,roll,cut_side,cushion,cut,side,cut_side,draw,cut,cushion_side,cut_side,long")
    assert generate([str(tmp_path / "set"), *words, *cuts, *cling]) == 0
    clip_set = read_clip_set(tmp_path / "set")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == () and not found.parts.excluded
    assert found.unexplained is not None and found.unexplained["where"] == "collisions of balls"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("row", "trained"), [(5, 7), pytest.param(4, 8, marks=pytest.mark.thorough)], ids=["in training", "held out"]
)
def test_a_clip_with_a_wrong_clock_is_named_and_no_effect_is(tmp_path: Path, row: int, trained: int) -> None:
    words = ("--seed", "51", "--clips", "10", "--sigma", "0.0005", "--seconds", "3")
    assert generate([str(tmp_path / "set"), *words]) == 0
    clip_set = read_clip_set(tmp_path / "set")

    def slowed(clip: Clip) -> Clip:
        balls = {name: dataclasses.replace(seen, time=1.03 * seen.time) for name, seen in clip.balls.items()}
        return dataclasses.replace(clip, balls=balls) if clip.file == odd else clip

    odd = clip_set.clips[row].file
    spoiled = dataclasses.replace(clip_set, clips=tuple(slowed(c) for c in clip_set.clips))
    found = discover(spoiled, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == () and found.unexplained is None
    assert [line.split(":")[0] for line in found.parts.excluded] == [odd]
    assert "alone departs" in found.parts.excluded[0]
    assert len(found.parts.training.clips) == trained and found.last.rms < 1.05 * 0.0005


@pytest.mark.slow
def test_a_clip_that_alone_shows_an_effect_is_excluded_with_the_impact_named(tmp_path: Path) -> None:
    """Clip 12 alone shows the friction of the cushion at +x, which is first named in windows."""
    words = ["--seed", "30252", "--clips", "12", "--sigma", "0.0005", "--missing", "0.01", "--seconds", "4"]
    assert generate([str(tmp_path / "set"), *words, "--constant", "muc_px=0.015"]) == 0
    clip_set = read_clip_set(tmp_path / "set")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.verdict == () and found.unexplained is None
    (line,) = found.parts.excluded
    assert line.startswith("clips/0012.csv") and "from its impact at the cushion +x" in line


def test_a_held_out_shot_that_is_not_followed_changes_places_with_another(tmp_path: Path) -> None:
    """Once: it is fitted, and the nearest in the session held out, with nothing else changed."""
    words = ("--seed", "72", "--clips", "10", "--sigma", "0.0005", "--seconds", "1.5", "--kind", "roll,cut,cushion")
    assert generate([str(tmp_path / "set"), *words]) == 0
    clip_set = read_clip_set(tmp_path / "set")
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    parts, _, now = fit_from_nothing(parts, model, searching=False)
    assert now.held_out is not None and departing_held_out(now) == [] and exchanged(parts, now) is None
    residuals = now.held_out.open_residuals.copy()
    residuals[1] += 3.0
    odd = dataclasses.replace(now, held_out=dataclasses.replace(now.held_out, open_residuals=residuals))
    assert departing_held_out(odd) == [1]
    other = exchanged(parts, odd)
    assert other is not None and other.exchanged == (("clips/0010.csv", "clips/0009.csv"),)
    fitted = [clip.file for clip in other.training.clips]
    assert fitted == [f"clips/{k:04d}.csv" for k in (1, 2, 3, 4, 6, 7, 8, 10)] and other.held_out is not None
    assert [clip.file for clip in other.held_out.clips] == ["clips/0005.csv", "clips/0009.csv"]
    other, _, again = fit_from_nothing(other, model, searching=False)
    assert again.chi2 == pytest.approx(now.chi2, rel=0.1) and departing_held_out(again) == []
    back = dataclasses.replace(parts, exchanged=(("clips/0010.csv", "clips/0009.csv"),))
    assert exchanged(back, odd) is None, "once"
