"""Clips that begin in mid-motion tell the same constants, and states that are as sure as their samples."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.model_file import full_model
from sysid.clips import ClipSet, read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.estimation import begin, fit_clips
from sysid.estimation.chains.chain_search import found_states
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.states.initial_states import fit_states
from sysid.residuals.compare import compare
from sysid.selection.discover import discover
from tests.bench.accuracy import CONSTANTS
from tests.support.hidden_truth import make, miss
from tests.support.running_clips import cut_in_motion, written_running
from tests.truth.__main__ import main as generate

KINDS = "stun,draw,side,swerve,cushion,cushion_side,cut,cut_side"
Made = tuple[ClipSet, ClipSet, dict[str, float]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """Shots, the same cut at random moments, and the constants they hide."""
    folder = tmp_path_factory.mktemp("running")
    whole, truth = make(folder / "set", 4, kinds=KINDS)
    return whole, written_running(cut_in_motion(whole, 4), folder / "cut"), truth


def at_truth(clip_set: ClipSet, truth: dict[str, float]) -> ShotProblem:
    model = full_model(clip_set.table, clip_set.ball).with_values({name: truth[name] for name in CONSTANTS})
    return shot_problem(model, (), clip_set, position_noise(clip_set))


def test_constants_of_cut_clips_are_those_of_whole_ones(made: Made) -> None:
    whole, cut, truth = made
    assert all(clip.running for clip in cut.clips)
    found = {what: fit_clips(s, full_model(s.table, s.ball)) for what, s in (("whole", whole), ("cut", cut))}
    assert found["cut"].converged
    assert found["cut"].parts.excluded == ()
    off = {name: sds for name, sds in miss(found["cut"], truth).items() if np.isfinite(sds)}
    assert len(off) >= len(CONSTANTS) - 1  # the decay of a spin that no mark shows may be lost
    assert max(map(abs, off.values())) < 3, off
    for name, (value, sd) in found["cut"].constants.items():
        other, other_sd = found["whole"].constants[name]
        if np.isfinite(sd):
            assert abs(value - other) < 3 * np.hypot(sd, other_sd), name
            assert sd > 0.5 * other_sd, f"{name}: a part cannot tell more than the whole"


def test_the_state_of_every_ball_in_motion_is_found(made: Made) -> None:
    whole, cut, truth = made
    rows = np.array([k for k, clip in enumerate(cut.clips) if len(clip.running) > 1])
    assert rows.size
    problem = at_truth(cut, truth).only(rows)
    x = fit_states(problem, found_states(problem, np.zeros(0)), np.zeros(0), 30)
    r = problem.evaluate(x, np.zeros((len(x), 0)), np.arange(len(x)))
    assert np.sqrt(np.nanmean(r**2, axis=1)).max() < 1.15
    for k, row in enumerate(rows.tolist()):
        clip, uncut = problem.clips[k], whole.clips[row]
        shot = problem.shot(x[k], k, problem.times(k), whole.ball.radius)
        for b, name in enumerate(clip.running):
            seen, at = uncut.balls[name], clip.origin - uncut.origin
            near = np.abs(seen.time - at - 0.03) < 0.04
            near &= seen.time >= at
            slope, place = np.polyfit(seen.time[near] - at, seen.xy[near], 1)
            assert shot.position[b] == pytest.approx(place, abs=1.5e-3)
            assert np.hypot(*(shot.velocity[b] - slope)) < 0.08
    assert not any(shot.struck for shot in [problem.shot(x[0], 0, problem.times(0), whole.ball.radius)])


def test_both_engines_play_several_balls_that_move_at_first(made: Made) -> None:
    _, cut, truth = made
    rows = np.array([k for k, clip in enumerate(cut.clips) if len(clip.running) > 1])
    problem = at_truth(cut, truth).only(rows)
    other = dataclasses.replace(problem, model=dataclasses.replace(problem.model, engine="mujoco"))
    x, none, every = problem.start, np.zeros((len(rows), 0)), np.arange(len(rows))
    np.testing.assert_allclose(problem.evaluate(x, none, every), other.evaluate(x, none, every), atol=0.5)
    moved = x.copy()
    moved[:, problem.motions_from] += 0.1  # of the second ball in motion
    assert np.nanmax(np.abs(problem.evaluate(moved, none, every) - problem.evaluate(x, none, every))) > 5


def test_states_of_all_clips_fit_the_whole_set(made: Made) -> None:
    """Training and held-out clips may have other numbers of balls in motion."""
    _, cut, _ = made
    several = sorted(cut.clips, key=lambda clip: len(clip.running))
    order = [several[-1], *several[:-1]]  # those held out have fewer unknowns than those trained on
    mixed = dataclasses.replace(cut, clips=tuple(order))
    parts, found = begin(mixed, full_model(mixed.table, mixed.ball))
    assert parts.held_out is not None
    assert parts.held_out.start.shape[1] < parts.training.start.shape[1]
    states = parts.states_of(found, [clip.file for clip in mixed.clips])
    assert states is not None
    assert states.shape[1] == parts.training.start.shape[1]
    values = dict(zip(found.names, found.constants, strict=True))
    again = compare(mixed, found.problem.model.with_values(values), states)
    assert max(row.chi2_reduced for row in again.clips) < 2


@pytest.mark.slow
def test_a_hidden_effect_is_named_from_running_clips_alone(tmp_path: Path) -> None:
    kinds = ("--kind", "roll,stun,follow,cushion,long,cut")
    words = ("--seed", "8", "--clips", "14", "--seconds", "2.5", "--no-cue", *kinds)
    assert generate([str(tmp_path / "set"), *words, "--effect", "table_tilt=0.001,-0.0015"]) == 0
    cut = written_running(cut_in_motion(read_clip_set(tmp_path / "set"), 8, latest=0.4), tmp_path / "cut")
    found = discover(cut, full_model(cut.table, cut.ball))
    assert found.verdict == ("table_tilt",)
    values = dict(zip(found.last.names, found.last.constants, strict=True))
    for axis, slope in (("x", 0.001), ("y", -0.0015)):
        assert values[f"table_tilt.slope_{axis}"] == pytest.approx(slope, abs=2e-4)
