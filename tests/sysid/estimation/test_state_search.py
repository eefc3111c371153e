"""Shots of a dozen impacts at their true start: the search, and its derivatives."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from models.model_file import full_model, read_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.clips import Clip, ClipSet, Observation, read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.estimation.chains.chain_search import found_states
from sysid.estimation.from_nothing import begin, likelier_starts
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.states.initial_states import fit_states, own_scores
from sysid.estimation.states.state_search import from_other_sidespins, searched_states
from tests.support.long_shots import CAROM, NO_CONSTANTS, NOISE_M, SNOOKER, long_shots, struck_rms, true_model


@pytest.mark.slow
@pytest.mark.parametrize("table", [CAROM, SNOOKER], ids=["carom", "snooker"])
def test_long_shots_are_found_at_the_noise(table: tuple[Table, Ball]) -> None:
    """With the true model each ends where it was: the noise has two axes."""
    model = true_model(*table)
    problem = shot_problem(model, (), long_shots(model, 7, 3), NOISE_M)
    errors = struck_rms(problem, found_states(problem, NO_CONSTANTS))
    assert (errors < 1.2 * math.sqrt(2) * NOISE_M).all(), errors


def test_a_shot_begins_as_seen_before_its_first_impact() -> None:
    """Two frames before a cushion: a line through more would turn the frame in which its spin is known."""
    model = true_model(*CAROM)
    reach = model.table.centre_limits(model.ball)[1]
    times, azimuth = np.arange(0.0, 4.0, 1 / 60), 1.1
    velocity = 3.0 * np.array([math.cos(azimuth), math.sin(azimuth)])
    shot = Shot(("white",), np.array([[0.2, reach - 0.1]]), velocity[None], np.zeros((1, 3)), times)
    path = simulate(model, [shot])[0].position[:, 0]
    seen = Observation(times, path + np.random.default_rng(0).normal(0, NOISE_M, path.shape), times * np.nan)
    clip = Clip("clips/0.csv", "white", {"white": seen})
    problem = shot_problem(model, (), ClipSet(model.table, model.ball, 60.0, (clip,), NOISE_M), NOISE_M)
    assert problem.azimuth[0] == pytest.approx(azimuth, abs=0.05)
    assert struck_rms(problem, found_states(problem, NO_CONSTANTS))[0] < 1.2 * math.sqrt(2) * NOISE_M


@pytest.fixture(scope="module")
def cut_with_side() -> tuple[ShotProblem, Array]:
    """A cut with a sidespin of 0.43 m/s, and where a fit that begins without any ends."""
    model = true_model(*SNOOKER)
    times, aside, radius = np.arange(0.0, 2.0, 1 / 120), 0.6, model.ball.radius
    at = np.array([[-0.5, 0.0], [0.0, aside * 2 * radius]])
    spin = np.array([[0.0, 0.0, 0.43 / radius], [0.0, 0.0, 0.0]])
    shot = Shot(("white", "red"), at, np.array([[1.9, 0.0], [0.0, 0.0]]), spin, times)
    path, draw = simulate(model, [shot])[0].position, np.random.default_rng(0)
    seen = {
        name: Observation(times, path[:, k] + draw.normal(0, NOISE_M, path[:, k].shape), times * np.nan)
        for k, name in enumerate(shot.names)
    }
    clips = ClipSet(model.table, model.ball, 120.0, (Clip("clips/0.csv", "white", seen),), NOISE_M)
    problem = shot_problem(model, (), clips, NOISE_M)
    x = problem.start.copy()
    x[0, 6] = 0.0
    return problem, fit_states(problem, x, NO_CONSTANTS, 40)


def test_sidespin_that_the_cloth_would_end_is_found(cut_with_side: tuple[ShotProblem, Array]) -> None:
    """Where a fit begins without sidespin, a little of it changes nothing: it is gone before the balls meet."""
    problem, stuck = cut_with_side
    assert stuck[0, 6] == 0.0, "where a fit without sidespin ends"
    found = from_other_sidespins(problem.objective(), stuck, NO_CONSTANTS, np.arange(1), 2)
    assert found[0, 6] == pytest.approx(0.43, abs=0.05)


def test_the_shots_that_are_asked_for_are_searched(cut_with_side: tuple[ShotProblem, Array]) -> None:
    problem, stuck = cut_with_side
    found = likelier_starts(problem, stuck, NO_CONSTANTS, np.arange(1))
    assert found[0, 6] == pytest.approx(0.43, abs=0.05)
    assert likelier_starts(problem, stuck, NO_CONSTANTS, np.arange(0)).tobytes() == stuck.tobytes()
    again = likelier_starts(problem, found, NO_CONSTANTS, np.arange(1))
    assert again.tobytes() == found.tobytes(), "nothing is likelier"


def test_a_sidespin_that_is_no_unknown_is_not_searched(cut_with_side: tuple[ShotProblem, Array]) -> None:
    problem, stuck = cut_with_side
    held = dataclasses.replace(problem.objective(), free=np.zeros(stuck.shape, bool))
    assert from_other_sidespins(held, stuck, NO_CONSTANTS, np.arange(1), 2) is stuck


@pytest.mark.slow
def test_a_shot_is_found_whatever_others_are_beside_it() -> None:
    model = true_model(*CAROM)
    problem = shot_problem(model, (), long_shots(model, 8, 2, impacts=(4, 7)), NOISE_M)
    together = searched_states(problem, NO_CONSTANTS)
    for k in range(2):
        alone = problem.only(np.array([k]))
        width = alone.start.shape[1]
        assert searched_states(alone, NO_CONSTANTS).tobytes() == together[k : k + 1, :width].tobytes()


def test_a_state_is_as_likely_whatever_others_are_beside_it() -> None:
    """A score that followed the median of all shots made states that had been found once seem to be found again."""
    model = true_model(*CAROM)
    problem = shot_problem(model, (), long_shots(model, 8, 3), NOISE_M)
    together, rates = own_scores(problem, problem.start, NO_CONSTANTS)
    assert (rates > 0).all(), "starts as seen, not fitted"
    for k in range(3):
        alone = problem.only(np.array([k]))
        assert own_scores(alone, alone.start, NO_CONSTANTS)[0] == pytest.approx(together[k : k + 1], rel=1e-12)


@pytest.mark.slow
def test_derivatives_after_a_dozen_impacts_are_those_of_half_the_step() -> None:
    """A longer step than the state is known to leaves the range in which a shot is linear."""
    model = true_model(*CAROM)
    problem = shot_problem(model, (), long_shots(model, 9, 4), NOISE_M)
    x, n = found_states(problem, NO_CONSTANTS), len(problem.clips)

    def slopes(share: float) -> Array:
        rows = []
        for step in np.diag(share * problem.steps):
            moved = problem.evaluate(x + step, np.zeros((n, 0)), np.arange(n))
            rows.append((moved - problem.evaluate(x, np.zeros((n, 0)), np.arange(n))) / step.sum())
        return np.nan_to_num(np.stack(rows, axis=-1))

    whole, half = slopes(1.0), slopes(0.5)
    assert np.linalg.norm(whole - half, axis=(1, 2)).max() < 0.2 * np.linalg.norm(half, axis=(1, 2)).min()
    for a, b in zip(whole, half, strict=True):
        assert np.linalg.norm(a - b) < 0.05 * np.linalg.norm(b)


def test_the_true_model_finds_five_shots_of_ten_impacts(data_folder: Path) -> None:
    folder = data_folder / "cases" / "long_carom_fit"
    clip_set, model = read_clip_set(folder / "clips_without_cue"), read_model(folder / "truth.toml")
    problem = shot_problem(model, (), clip_set, position_noise(clip_set))
    assert struck_rms(problem, found_states(problem, NO_CONSTANTS)).max() < 0.00045


@pytest.mark.slow
def test_constants_of_long_shots_are_found_with_honest_intervals() -> None:
    """All constants unknown: the shots end at the noise, and each constant within what the fit claims of it."""
    table, ball = CAROM
    true = true_model(table, ball)
    _, found = begin(long_shots(true, 501, 8, impacts=(5, 8)), full_model(table, ball))
    sizes = {"table.length": table.length, "table.width": table.width, "ball.diameter": ball.diameter}
    truth = np.array([{**true.parameters(), **sizes}[name] for name in found.names])
    assert found.converged
    assert found.chi2 < 1.02
    off = (found.constants - truth) / np.sqrt(np.diag(found.covariance))
    assert np.all(np.abs(off) < 4.0), dict(zip(found.names, off, strict=True))
