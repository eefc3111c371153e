"""Shots of a dozen impacts from the project's own engine, at starts that nobody is told, and how a fit misses them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from models.model_file import Model, full_model
from models.shot import Ball, Shot, Table
from models.simulation.simulate import simulate
from models.table.presets import TABLE_SETS
from sysid.clips import Clip, ClipSet, Observation
from sysid.estimation.problem import Array
from sysid.estimation.shot_problem import ShotProblem, residual

NOISE_M, FPS, LAST_TIME_S = 0.0003, 60.0, 14.0
NO_CONSTANTS = np.zeros(0)
CAROM = Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)
SNOOKER = dataclasses.replace(TABLE_SETS["snooker"].table, pockets=False), TABLE_SETS["snooker"].ball
TRUE = {
    "decoupled_cloth": {"slide": 0.17, "roll": 0.0075, "spin": 12.0},
    "ball_impact": {"restitution": 0.95, "friction": 0.05},
    "cushion_impact": {"restitution": 0.9, "friction": 0.15},
}


def true_model(table: Table, ball: Ball) -> Model:
    model = full_model(table, ball)
    return dataclasses.replace(
        model, effects=tuple(dataclasses.replace(e, **TRUE[e.name()]) for e in model.effects)
    )  # fmt: skip


def long_shots(model: Model, seed: int, count: int, impacts: tuple[int, int] = (8, 14)) -> ClipSet:
    """Clips of shots of so many impacts, two to four balls, no commands, from starts that nobody is told."""
    rng, table, ball, clips = np.random.default_rng(seed), model.table, model.ball, list[Clip]()
    times, limits = np.arange(0, LAST_TIME_S, 1 / FPS), table.centre_limits(ball) - 0.02
    while len(clips) < count:
        balls = int(rng.integers(2, 5))
        places = rng.uniform(-limits, limits, (balls, 2))
        gaps = np.linalg.norm(places[:, None] - places, axis=2) + 10 * np.eye(balls)
        if gaps.min() < 1.2 * ball.diameter:
            continue
        speed, azimuth = rng.uniform(1.5, 5.0), rng.uniform(-math.pi, math.pi)
        surface, spin = speed / ball.radius, np.zeros((balls, 3))
        follow, side = rng.uniform(-0.6, 1.1) * surface, rng.uniform(-0.9, 0.9) * surface
        spin[0] = -follow * math.sin(azimuth), follow * math.cos(azimuth), side
        velocity = np.zeros((balls, 2))
        velocity[0] = speed * math.cos(azimuth), speed * math.sin(azimuth)
        names = ("white", "yellow", "red", "blue")[:balls]
        track = simulate(model, [Shot(names, places, velocity, spin, times)])[0]
        if not impacts[0] <= sum(event.kind in ("ball", "cushion") for event in track.events) <= impacts[1]:
            continue
        seen = {
            name: Observation(times, track.position[:, k] + rng.normal(0, NOISE_M, (len(times), 2)), times * np.nan)
            for k, name in enumerate(names)
        }
        clips.append(Clip(f"clips/{len(clips)}.csv", "white", seen))
    return ClipSet(table, ball, FPS, tuple(clips), NOISE_M)


def struck_rms(problem: ShotProblem, x: Array) -> Array:
    """Of the struck ball over every clip: (n,) [m]."""
    n, found = len(problem.clips), []
    for k, track in enumerate(problem.tracks(x, np.zeros((n, 0)), np.arange(n))):
        seen = problem.clips[k].balls[problem.clips[k].struck]
        error, _ = residual(track, 0, seen, len(seen.time))
        found.append(math.sqrt(float(np.mean(np.sum(error**2, axis=1)))))
    return np.array(found)
