"""Shots cut into segments without impacts, and what is found in them."""

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
from sysid.clips.pieces import cut_clips
from sysid.estimation.initial_states import fit_states
from sysid.estimation.shot_problem import shot_problem
from sysid.selection.discover import discover
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
    runs = cut_clips(clip_set, position_noise(clip_set))
    assert len(runs.clips) > len(clip_set.clips)
    assert all(len(c.balls) == 1 for c in runs.clips)
    miss = misses(runs, truth)
    assert np.median(miss) == pytest.approx(1.0, abs=0.15)
    assert np.mean(miss < 1.5) > 0.9


def test_no_sample_is_in_two_segments_and_times_begin_at_0(shots: tuple[ClipSet, dict[str, float]]) -> None:
    clip_set, _ = shots
    runs = cut_clips(clip_set, position_noise(clip_set))
    for clip in clip_set.clips:
        own = [p for p in runs.clips if p.file.startswith(f"{clip.file}#")]
        assert sum(bool(p.running) for p in own) == len(own) - 1, "one segment begins with the strike"
        for name, seen in clip.balls.items():
            known = {tuple(xy) for xy in seen.xy}
            used = [tuple(xy) for p in own for b, o in p.balls.items() if b == name for xy in o.xy]
            assert set(used) <= known and len(used) == len(set(used))
        assert all(o.time[0] == 0 and np.all(np.diff(o.time) > 0) for p in own for o in p.balls.values())


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
    assert found.rounds[0].windows > 10
    assert found.verdict == ("speed_drag",)
    assert found.last.value("speed_drag.rate")[0] == pytest.approx(truth["drag1"], rel=0.02)
    assert found.last.rms < 1.05 * 0.0005
    assert found.ladder[0].rms > 10 * found.last.rms
