"""A comparison names what is wrong: clips of known truth against models with one wrong constant."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.commands.console import write_json
from models.effect_catalogue import effect_class
from models.model_file import Model, full_model
from sysid.clips import ClipSet, read_clip_set, write_clip_set
from sysid.report.text import in_words, print_comparison
from sysid.residuals.compare import compare
from sysid.residuals.comparison import Comparison, Group
from tests.support.hidden_truth import truth_of
from tests.truth.__main__ import main as make_truth

KINDS = "stun,side,roll,cushion,cushion_side,cut"
NOISE = 5e-4  # [m]


@pytest.fixture(scope="module")
def clip_set(tmp_path_factory: pytest.TempPathFactory) -> ClipSet:
    """Twelve short clips with at most a few second events."""
    folder = tmp_path_factory.mktemp("compare") / "set"
    assert make_truth([str(folder), "--seed", "41", "--clips", "12", "--seconds", "1.3", "--kind", KINDS]) == 0
    return read_clip_set(folder)


@pytest.fixture(scope="module")
def right(clip_set: ClipSet) -> Model:
    """The model with the true constants."""
    return full_model(clip_set.table, clip_set.ball).with_values(truth_of(clip_set.folder))


@pytest.fixture(scope="module")
def fair(clip_set: ClipSet, right: Model) -> Comparison:
    return compare(clip_set, right)


def wrong(clip_set: ClipSet, right: Model, fair: Comparison, name: str, factor: float) -> Comparison:
    """One constant off; the initial states start from those of the right model, which saves the time to find them."""
    return compare(clip_set, right.with_values({name: factor * right.parameters()[name]}), start=fair.initial_states)


def worst(comparison: Comparison, by: str) -> Group:
    return next(d for d in comparison.where if d.by == by)


def test_the_origin_of_the_clock_changes_nothing(clip_set: ClipSet, right: Model, tmp_path: Path) -> None:
    few = dataclasses.replace(clip_set, clips=clip_set.clips[:3])
    write_clip_set(few, tmp_path / "plain")
    plain = compare(read_clip_set(tmp_path / "plain"), right)
    for origin in (-10.0, -0.01, 100.0, 1000.0):
        clips = tuple(dataclasses.replace(c, origin=origin) for c in few.clips)
        write_clip_set(dataclasses.replace(few, clips=clips), tmp_path / "late")
        late = compare(read_clip_set(tmp_path / "late"), right)
        assert json.dumps(late.to_json()) == json.dumps(plain.to_json())  # NaN equals NaN
        np.testing.assert_array_equal(late.initial_states, plain.initial_states)


def test_nothing_stands_out_with_the_right_constants(fair: Comparison) -> None:
    for d in fair.where:
        # Groups of few samples scatter about 1 by themselves.
        assert abs(d.ratio - 1) < 0.06 + 3 / np.sqrt(2 * d.samples), d
    line, white = in_words(fair)
    assert line.startswith("Nothing stands out: none of ") and line.endswith("with noise of 0.50 mm.")
    assert white.startswith("Residuals are white")
    assert fair.local.named == () and fair.local.tests > 50
    assert all(0.7 < c.chi2_reduced < 1.4 for c in fair.clips)
    assert np.median([s.ratio for s in fair.segments]) == pytest.approx(1.0, abs=0.08)


def test_wrong_rolling_friction_shows_while_rolling(clip_set: ClipSet, right: Model, fair: Comparison) -> None:
    found = wrong(clip_set, right, fair, "decoupled_cloth.roll", 1.3)
    assert worst(found, "phase").where == "while rolling"
    assert worst(found, "phase").ratio > 2
    # 0.3 of rolling friction's deceleration is too much.
    named = max((d for d in found.local.named if d.of == "motion"), key=lambda d: d.gain)
    assert named.group.startswith("rolling balls") and named.quantity.startswith("acceleration along")
    assert named.value > 0 and named.unit.startswith("m/s^2")
    assert "rolling balls" in in_words(found)[0].lower() and "less than modelled" in in_words(found)[0]


def test_wrong_sliding_friction_shows_while_sliding(clip_set: ClipSet, right: Model, fair: Comparison) -> None:
    found = wrong(clip_set, right, fair, "decoupled_cloth.slide", 1.3)
    assert worst(found, "phase").where == "while sliding"


@pytest.fixture(scope="module")
def one_event(tmp_path_factory: pytest.TempPathFactory) -> ClipSet:
    """Clips in which no ball meets a second thing: what follows an event is that event's doing."""
    folder = tmp_path_factory.mktemp("compare") / "one"
    options = ["--seed", "42", "--clips", "12", "--seconds", "0.8", "--no-pockets", "--kind", "cushion,cut"]
    assert make_truth([str(folder), *options]) == 0
    truth = json.loads(folder.with_name("one.truth.json").read_text(encoding="utf-8"))
    rows = [k for k, clip in enumerate(truth["clips"]) if len(clip["events"]) == 1]
    assert len(rows) >= 8
    clip_set = read_clip_set(folder)
    return dataclasses.replace(clip_set, clips=tuple(clip_set.clips[k] for k in rows))


@pytest.mark.parametrize(
    ("name", "event", "other"),
    [
        ("cushion_impact.restitution", "after one cushion impact", "after one ball-ball impact"),
        ("ball_impact.restitution", "after one ball-ball impact", "after one cushion impact"),
    ],
)
def test_a_wrong_restitution_shows_after_its_impact(one_event: ClipSet, name: str, event: str, other: str) -> None:
    right = full_model(one_event.table, one_event.ball).with_values(truth_of(one_event.folder))
    found = compare(one_event, right.with_values({name: 0.85 * right.parameters()[name]}))
    events = {d.where: d.ratio for d in found.where if d.by == "event"}
    assert worst(found, "event").where == event
    assert events[event] > 5 > events[other]
    # Between the impacts nothing is wrong.
    assert found.summary()["segment_ratio_median"] < 1.1


def test_groups_come_worst_first(clip_set: ClipSet, right: Model, fair: Comparison) -> None:
    found = wrong(clip_set, right, fair, "decoupled_cloth.roll", 1.3)
    for by in {d.by for d in found.where} - {"clip"}:
        ratios = [d.ratio for d in found.where if d.by == by]
        assert ratios == sorted(ratios, reverse=True), by
    rms = [d.rms_m for d in found.where if d.by == "clip"]
    assert rms == sorted(rms, reverse=True) and rms[0] == max(c.rms_m for c in found.clips)


def test_finding_the_shots_from_nothing_or_from_known_ones_is_the_same(
    clip_set: ClipSet, right: Model, fair: Comparison
) -> None:
    again = compare(clip_set, right, start=fair.initial_states)
    for one, other in zip(fair.clips, again.clips, strict=True):
        assert one.rms_m == pytest.approx(other.rms_m, rel=0.01)


def test_the_figures_are_those_of_the_tracks(clip_set: ClipSet, fair: Comparison) -> None:
    """`struck_rms_m` over the whole clip: square root of the mean squared distance, frame by frame."""
    for clip, track, row in zip(clip_set.clips, fair.tracks, fair.clips, strict=True):
        seen = clip.balls[clip.struck]
        index = np.searchsorted(track.times, seen.time)
        np.testing.assert_allclose(track.times[index], seen.time, atol=1e-9)
        gap = track.position[index, track.names.index(clip.struck)] - seen.xy
        assert row.struck_rms_m == pytest.approx(np.sqrt(np.mean(np.sum(gap**2, axis=1))), rel=1e-9)


def test_samples_say_what_the_ball_did(fair: Comparison) -> None:
    s = fair.samples
    assert {"slide", "roll"} <= set(s.motion) and set(s.last) <= {"strike", "ball", "cushion"}
    n = len(s.clip)
    assert {len(getattr(s, field.name)) for field in dataclasses.fields(s)} == {n}
    assert np.all(np.isfinite(s.residual)) and np.all(s.speed >= 0)
    before = np.array(s.last) == "strike"
    np.testing.assert_array_equal(before, s.events == 0)


def test_the_json_form(fair: Comparison, tmp_path: Path) -> None:
    write_json(str(tmp_path / "c.json"), fair.to_json())
    data: dict[str, Any] = json.loads((tmp_path / "c.json").read_text(encoding="utf-8"))
    assert data["format"] == "billiard-comparison/1"
    assert data["noise_m"] == NOISE
    assert [c["file"] for c in data["clips"]] == [c.file for c in fair.clips]
    for clip in data["clips"]:
        assert {"file", "struck_rms_m", "rms_m", "chi2_reduced"} <= set(clip)
        assert all(isinstance(clip[k], float) and clip[k] > 0 for k in ("struck_rms_m", "rms_m", "chi2_reduced"))
    assert data["where"] == []
    keys = {"where", "variable", "group", "quantity", "value", "unit", "sd", "z", "samples"}
    assert len(data["local_groups"]) > 50 and all(keys <= set(d) for d in data["local_groups"])
    assert all({"by", "where", "rms_m", "ratio", "samples"} <= set(d) for d in data["groups"])
    assert all({"of", "variable", "share", "z"} <= set(d) for d in data["dependence"])
    assert data["whiteness"]["white"] is True and len(data["whiteness"]["autocorrelation"]) == 40
    assert "NaN" not in (tmp_path / "c.json").read_text(encoding="utf-8")


def test_the_table_a_person_reads(fair: Comparison, capsys: pytest.CaptureFixture[str]) -> None:
    print_comparison(fair)
    said = capsys.readouterr().out
    assert "12 clips, noise 0.50 mm an axis" in said
    assert all(name in said for name in ("decoupled_cloth", "ball_impact", "cushion_impact"))
    assert "Worst clips" in said and "Where the model misses" in said
    assert "Nothing stands out" in said
    assert max(map(len, said.splitlines())) < 130


def test_segments_of_balls_with_sidespin_are_followed_by_the_model_that_bends_them(tmp_path: Path) -> None:
    """From no sidespin alone, some of their fits end at another optimum, many times the noise away."""
    folder = tmp_path / "set"
    options = ["--seed", "5", "--clips", "8", "--seconds", "2.5", "--kind", "side,cushion_side"]
    assert make_truth([str(folder), *options, "--effect", "side_curve=0.0022"]) == 0
    clips = read_clip_set(folder)
    bends = full_model(clips.table, clips.ball).add(effect_class("side_curve")(0.0022))
    found = compare(clips, bends.with_values(truth_of(folder)))
    assert max(one.ratio for one in found.segments) < 1.3
