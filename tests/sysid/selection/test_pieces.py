"""Shots cut into pieces of one impact each and runs of none, and what is found in them."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from models.effects.cue.cue_hop import CueHop
from models.effects.cue.squirt import Squirt
from models.model_file import full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, read_clip_set
from sysid.clips.noise import position_noise
from sysid.clips.pieces import cut_clips, parent_clip
from sysid.estimation.initial_states import fit_states
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.split import fit_anew, split, subset
from sysid.selection.discover import discover
from sysid.selection.runs import screen_segments, segments_of
from tests.truth.__main__ import main as generate

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


def made(folder: Path, *words: str) -> tuple[ClipSet, dict[str, float]]:
    """A clip set of the independent generator, and its constants."""
    assert generate([str(folder), "--no-cue", *words]) == 0
    truth: dict[str, float] = json.loads(Path(f"{folder}.truth.json").read_text())["parameters"]
    return read_clip_set(folder), truth


def misses(part: ClipSet, truth: dict[str, float]) -> np.ndarray:
    """Rms residual over noise of every clip, at the true constants, initial states fitted."""
    model = full_model(part.table, part.ball).with_values({
        "ball_impact.restitution": truth["ebb"], "ball_impact.friction": truth["mubb"],
        "cushion_impact.restitution": truth["ec"], "cushion_impact.friction": truth["muc"],
        "decoupled_cloth.slide": truth["mus"], "decoupled_cloth.roll": truth["mur"],
        "decoupled_cloth.spin": truth["spin"],
    })  # fmt: skip
    problem = shot_problem(model, (), part, position_noise(part))
    x = fit_states(problem, problem.start, np.zeros(0), 30)
    r = problem.evaluate(x, np.zeros((len(x), 0)), np.arange(len(x)))
    return np.asarray(np.sqrt(np.nanmean(r**2, axis=1)))


@pytest.fixture(scope="module")
def shots(tmp_path_factory: pytest.TempPathFactory) -> tuple[ClipSet, dict[str, float]]:
    kinds = ("--kind", "cushion,long,cut,roll,stun,cut_side")
    return made(tmp_path_factory.mktemp("pieces") / "set", "--seed", "3", "--clips", "12", "--seconds", "4", *kinds)


def test_runs_hold_no_impact_and_are_followed_to_the_noise(shots: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set, truth = shots
    runs = cut_clips(clip_set, position_noise(clip_set), impacts=False)
    assert len(runs.clips) > len(clip_set.clips)
    assert all(len(c.balls) == 1 for c in runs.clips)
    miss = misses(runs, truth)
    assert np.median(miss) == pytest.approx(1.0, abs=0.15)
    assert np.mean(miss < 1.5) > 0.9


def test_pieces_hold_one_impact_and_are_followed_to_the_noise(shots: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set, truth = shots
    pieces = cut_clips(clip_set, position_noise(clip_set))
    runs = cut_clips(clip_set, position_noise(clip_set), impacts=False)
    assert len(clip_set.clips) < len(pieces.clips) < len(runs.clips)
    assert any(len(c.balls) == 2 for c in pieces.clips)
    assert np.mean(misses(pieces, truth) < 1.5) > 0.8  # some begin with a sidespin that their run does not show


def test_no_sample_is_in_two_pieces_and_times_begin_at_0(shots: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set, _ = shots
    for impacts in (False, True):
        pieces = cut_clips(clip_set, position_noise(clip_set), impacts)
        for clip in clip_set.clips:
            own = [p for p in pieces.clips if parent_clip(p.file) == clip.file]
            assert own
            assert sum(bool(p.running) for p in own) == len(own) - 1, "one piece begins with the strike"
            for name, seen in clip.balls.items():
                known = {tuple(xy) for xy in seen.xy}
                used = [tuple(xy) for p in own for b, o in p.balls.items() if b == name for xy in o.xy]
                moving = [xy for xy in used if xy in known]  # the place of a ball that lay is a mean
                assert len(moving) == len(set(moving))
                assert len(moving) >= len(used) - 1
            assert all(o.time[0] >= 0 and np.all(np.diff(o.time) > 0) for p in own for o in p.balls.values())
            assert all(p.balls[p.struck].time[0] == 0 for p in own)


def test_a_piece_is_called_after_its_clip() -> None:
    assert (
        parent_clip("clips/0001.csv#3")
        == "clips/0001.csv"
        == parent_clip("clips/0001.csv#3#12")
        == parent_clip("clips/0001.csv")
    )


def test_what_the_cue_did_does_not_act_on_a_ball_that_was_on_its_way() -> None:
    times = np.linspace(0, 0.5, 20)

    def played(struck: bool, *effects: CueHop | Squirt) -> np.ndarray:
        model = full_model(TABLE, BALL)
        for effect in effects:
            model = model.add(effect)
        shot = Shot(
            ("cue",), np.zeros((1, 2)), np.array([[1.5, 0.0]]), np.array([[0.0, 0.0, 60.0]]), times, struck=struck
        )
        return simulate(model, [shot])[0].position[:, 0]

    cue = CueHop(time_per_speed=0.05), Squirt(per_offset=10.0)
    np.testing.assert_allclose(played(False, *cue), played(False), atol=1e-9)
    assert np.abs(played(True, *cue) - played(True)).max() > 0.005


@pytest.mark.slow
def test_a_strong_effect_on_the_cloth_is_found_where_whole_shots_are_not_followed(tmp_path: Path) -> None:
    words = ("--seed", "5", "--clips", "10", "--seconds", "6", "--kind", "long", "--kind", "cushion_side")
    clip_set, truth = made(tmp_path / "set", *words, "--constant", "mur=0.005", "--effect", "speed_drag=0.08")
    found = discover(clip_set, full_model(clip_set.table, clip_set.ball))
    assert found.rounds[0].segments > 10
    assert found.verdict == ("speed_drag",)
    assert found.last.value("speed_drag.rate")[0] == pytest.approx(truth["drag1"], rel=0.02)
    assert found.last.rms < 1.05 * 0.0005
    assert found.ladder[0].rms > 10 * found.last.rms


@pytest.mark.slow
def test_long_shots_that_are_not_followed_are_cut(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = ("--seed", "6", "--clips", "6", "--seconds", "5", "--kind", "long", "--kind", "cushion")
    clip_set, truth = made(tmp_path / "set", *words, "--effect", "speed_drag=0.06")
    monkeypatch.setattr("sysid.estimation.split.MAX_EVENTS", 0)  # events beyond which a shot is long
    parts, _, model = split(clip_set, full_model(clip_set.table, clip_set.ball))
    assert parts.cut == 6
    assert all(len(e) <= 1 for e in parts.training.events)
    base = fit_anew(parts, model, "base")
    assert not parts.follows(base)
    seen = screen_segments(parts, base)
    assert seen is not None and seen.best is not None
    assert seen.best.name == "speed_drag"
    assert seen.best.fitted.value("speed_drag.rate")[0] == pytest.approx(truth["drag1"], rel=0.05)
    assert seen.best.fitted.model.table == clip_set.table


def test_a_run_with_an_impact_that_nobody_saw_is_left_out(shots: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set, _ = shots
    parts, _, model = split(subset(clip_set, range(6)), full_model(TABLE, BALL))
    runs = segments_of(parts, model)
    one = next(k for k, c in enumerate(parts.training.clips) if c.note == "roll")
    seen = parts.training.clips[one].balls["cue"]
    half = len(seen.time) // 2
    seen.xy[half:] += 0.3 * (seen.xy[half:] - seen.xy[half]) @ np.array([[0.0, 1.0], [-1.0, 0.0]])  # it turns by itself
    fewer = segments_of(parts, model)
    assert len(fewer.training.clips) < len(runs.training.clips)
