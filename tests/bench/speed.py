"""How fast: shots a second, and one Jacobian of the shipped example: all its clips under every perturbed constant."""

from __future__ import annotations

import dataclasses
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

import sysid
from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from sysid.clips import read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.estimation.open_cloth import values_of
from sysid.estimation.problem import constant_steps
from sysid.estimation.shot_problem import shot_problem
from sysid.estimation.solver.least_squares import differences

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
COUNT = 256
TIMES = np.linspace(0, 3, 91)
EXAMPLE = Path(str(sysid.__path__[0])) / "example"


def two_ball_shots(count: int = COUNT) -> list[Shot]:
    """Shots at a ball that lies half a metre ahead, a little off the line."""
    rng, shots = np.random.default_rng(1), []
    for _ in range(count):
        start, heading = rng.uniform((-1.2, -0.4), (0.6, 0.4)), rng.uniform(-0.6, 0.6)
        way = np.array([np.cos(heading), np.sin(heading)])
        red = start + 0.5 * way + rng.uniform(-0.03, 0.03) * np.array([-way[1], way[0]])
        velocity, spin = np.zeros((2, 2)), np.zeros((2, 3))
        velocity[0], spin[0] = rng.uniform(1.0, 2.5) * way, rng.normal(0, 25, 3)
        shots.append(Shot(("cue", "red"), np.array([start, red]), velocity, spin, TIMES))
    return shots


def best(action: Callable[[], object], repeats: int) -> float:
    """The shortest of a few runs [s]."""
    took = []
    for _ in range(repeats):
        began = time.perf_counter()
        action()
        took.append(time.perf_counter() - began)
    return min(took)


def shot_rows() -> list[tuple[str, ...]]:
    """Simulated shots a second by threads: native and with effects in MuJoCo, with effects in the event engine."""
    shots = two_ball_shots()
    events = full_model(TABLE, BALL)
    models = (Model(TABLE, BALL), dataclasses.replace(events, engine="mujoco"), events)
    for model in models:
        simulate(model, shots[:2])  # compiles
    rows = [(f"{COUNT} two-ball shots of 3 s", "native /s", "effects /s", "engine /s")]
    for threads in (1, 2):
        rate = [COUNT / best(lambda m=model, n=threads: simulate(m, shots, threads=n), 2) for model in models]
        rows.append((f"  {threads} thread{'s' * (threads > 1)}", *(f"{r:.0f}" for r in rate)))
    return rows


def jacobian_rows() -> list[tuple[str, ...]]:
    """All residuals of the example with their derivatives by initial states and constants, in one batch."""
    clip_set = read_clip_set(EXAMPLE)
    model = full_model(clip_set.table, clip_set.ball)
    names = tuple(model.parameters())
    problem = shot_problem(model, names, clip_set, position_noise(clip_set))
    which, c = np.arange(len(clip_set.clips)), values_of(model, names)

    def jacobian() -> None:
        differences(problem.evaluate, problem.start, c, which, problem.steps, constant_steps(model, names))

    jacobian()
    took, runs = best(jacobian, 3), len(which) * (1 + len(problem.steps) + len(names))
    return [
        (f"Jacobian of the example, {len(which)} clips", "ms", "shots", "shots /s"),
        ("  one batch", f"{took * 1e3:.0f}", str(runs), f"{runs / took:.0f}"),
    ]


def peak_memory_mb() -> float:
    """Of this process so far [MB]."""
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (1e6 if sys.platform == "darwin" else 1e3)
