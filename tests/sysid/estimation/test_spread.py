"""Problems of a fit given to other processes: the same bytes, whoever computes them."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.model_file import full_model
from models.workers import open_workers
from sysid.clips import read_clip_set
from sysid.estimation.problem import shared_constants, values_of
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.solver import spread
from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint
from sysid.estimation.solver.least_squares import fit_each, solve_each

EXAMPLE = Path(__file__).parents[3] / "sysid" / "example"
NOISE_M = 5e-4


def problem_of(engine: str) -> ShotProblem:
    clips = read_clip_set(EXAMPLE)
    model = dataclasses.replace(full_model(clips.table, clips.ball), engine=engine)
    return shot_problem(model, tuple(model.parameters()), clips, NOISE_M)


def fitted(problem: ShotProblem) -> Solution:
    shared = shared_constants(problem.model, problem.names, problem.known)
    c = values_of(problem.model, problem.names)
    return fit_joint(problem.objective(), problem.start, c, shared, StoppingRule(2, 1e-5))


@pytest.mark.slow
def test_fits_are_the_same_whoever_computes_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spread, "MIN_PROBLEMS_SENT", 3)
    sent: list[Any] = []
    problem, here = problem_of("events"), fitted(problem_of("events"))
    slow = problem_of("mujoco").only(np.arange(6)).until(np.full(6, 0.2))
    c = values_of(slow.model, slow.names)
    slow_here = fit_each(slow.objective(), slow.start, c, 1)
    with open_workers(None, 2) as workers, spread.spread_over(workers):
        whole = type(workers).in_turn
        monkeypatch.setattr(type(workers), "in_turn", lambda *args: sent.append(args) or whole(*args))
        there = fitted(problem)
        assert len(sent) > 4, "each kind of step goes to the workers"
        slow_there = fit_each(slow.objective(), slow.start, c, 1)
    for name in ("initial_states", "constants", "covariance", "information", "gradient"):
        assert getattr(here, name).tobytes() == getattr(there, name).tobytes(), name
    assert all(a.tobytes() == b.tobytes() for a, b in zip(slow_here, slow_there, strict=True))


def test_a_few_problems_stay_here() -> None:
    class Nobody:
        def count(self) -> int:
            return 8

    problem = problem_of("events").only(np.arange(3))
    with spread.spread_over(Nobody()):  # type: ignore[arg-type]
        fit_each(problem.objective(), problem.start, values_of(problem.model, problem.names), 1)


def test_a_singular_problem_changes_no_other() -> None:
    rng = np.random.default_rng(3)
    root = rng.normal(size=(5, 4, 4))
    matrix, right = root @ np.swapaxes(root, 1, 2), rng.normal(size=(5, 4, 2))
    alone = solve_each(matrix, right)
    for spoilt in (np.zeros((4, 4)), np.full((4, 4), np.nan)):
        other = matrix.copy()
        other[2] = spoilt
        found = solve_each(other, right)
        assert np.delete(found, 2, axis=0).tobytes() == np.delete(alone, 2, axis=0).tobytes()
        assert np.isfinite(found).all()
