"""A policy that finds a shot from rewards alone: python -m planner.example_environment

In: a scene and a model, or the built-in ones. Out: a stroke, with its mean reward before and after the optimisation.

The cross-entropy method (Rubinstein 1999) runs on the environment of planner/environment.py: actions are drawn from a
normal distribution, whose mean and spread follow the best of them. After a wide first iteration every action is
evaluated over several samples of execution errors and model uncertainty. It learns in the event engine, which is a
hundred times as fast, and the final stroke is evaluated in MuJoCo, over new samples. It starts from a stroke without
spin at the middle of the object ball and knows nothing of pockets, angles or spin; planner/search/search.py does, and
finds better shots sooner.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.commands.console import Status
from models.commands.options import input_option, seed_option
from models.commands.program import lone_command, run
from models.environment.task import ShotEnvironment
from models.errors import BadInput
from models.model_file import Estimate, Model, full_model, read_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.environment import load
from planner.scene import Goal, Scene, read_scene

Array = NDArray[np.float64]
FIRST_ACTIONS = 1200  # actions of the first iteration, which must contain a pot
LATER_ACTIONS, ELITE_ACTIONS = 100, 10  # actions of later iterations, and the best ones that set mean and spread
MAX_ITERATIONS = 12
SAMPLES_PER_ACTION = 16
FINAL_SAMPLES = 256  # samples for the printed figures
MIN_SPREAD = np.array([0.02, 2e-4, 2e-4, 3e-4])  # least spread of an action (4,) [m/s, m, m, rad]
# Standard deviations of the constants after a fit of some fifty shots.
CONSTANT_SD = {
    "decoupled_cloth.slide": 0.005, "decoupled_cloth.roll": 0.0003, "decoupled_cloth.spin": 1.0,
    "ball_impact.restitution": 0.01, "ball_impact.friction": 0.01,
    "cushion_impact.restitution": 0.015, "cushion_impact.friction": 0.02,
}  # fmt: skip


def example_scene() -> Scene:
    """A red to be cut into a corner 0.6 m away, a blue to be avoided, a goal region for the white on the other side."""
    places = np.array([[0.9, 0.35], [1.35, 0.45], [1.45, -0.3]])
    goal = Goal("white", "red", (1, 1), rest=np.array([0.9, -0.2]), rest_radius=0.1, avoid=("blue",))
    return Scene(SNOOKER_TABLE, SNOOKER_BALL, ("white", "red", "blue"), places, goal)


def example_model() -> Model:
    """The base model with usual constants and the uncertainty of a fit."""
    base = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    estimates = {name: Estimate(sd, "assumed for the example") for name, sd in CONSTANT_SD.items()}
    return Model(base.table, base.ball, effects=base.effects, estimates=estimates)


def initial_distribution(environment: ShotEnvironment, diameter: float) -> tuple[Array, Array]:
    """Mean (4,), a stroke without spin at the middle of the object ball of `diameter` [m], and spread (4,)."""
    observed, spec = environment.reset().observation, environment.action_spec()
    line = observed["position"][1] - observed["position"][0]
    mean = np.array([0.5 * (spec.minimum[0] + spec.maximum[0]), 0.0, 0.0, math.atan2(line[1], line[0])])
    width = math.asin(min(diameter / float(np.hypot(*line)), 1.0))
    return mean, np.array([*(spec.maximum - spec.minimum)[:3] / 4, width / 2])


def optimise(environment: ShotEnvironment, mean: Array, spread: Array, rng: np.random.Generator) -> Array:
    """The action (4,) at which the cross-entropy method ends."""
    for k in range(MAX_ITERATIONS):
        count = LATER_ACTIONS if k else FIRST_ACTIONS
        actions = np.concatenate([mean[None], mean + spread * rng.normal(size=(count, 4))])
        values = environment.expected(actions, SAMPLES_PER_ACTION if k else 1)
        elite = actions[np.argsort(-values, kind="stable")[:ELITE_ACTIONS]]
        mean, spread = elite.mean(axis=0), np.maximum(elite.std(axis=0), MIN_SPREAD)
    return environment.task.bounds.clip(mean[None])[0]


@lone_command("planner.example_environment")
@input_option("scene", "SCENE.toml", "Scene file; needs --model. By default one built in.")
@input_option("model", "M.toml", "Model file, fitted to the scene's table.")
@seed_option()
def command(scene_file: Path | None, model_file: Path | None, seed: int) -> int:
    """Find a shot from rewards alone."""
    if bool(scene_file) != bool(model_file):
        raise BadInput("--scene and --model go together; give both, or neither for the built-in ones")
    scene = read_scene(scene_file) if scene_file else example_scene()
    model = read_model(model_file) if model_file else example_model()
    environment = load(scene, model, seed=seed, mujoco=False)
    began = time.perf_counter()
    mean, spread = initial_distribution(environment, scene.ball.diameter)
    found = optimise(environment, mean, spread, np.random.default_rng(seed))
    judged = load(scene, model, seed=seed)
    judged.reset()
    before, after = judged.expected([mean, found], FINAL_SAMPLES)
    speed, side, height, theta = found
    seconds = time.perf_counter() - began
    print(f"mean reward over {FINAL_SAMPLES} plays in MuJoCo: {before:.3f} before, {after:.3f} after ({seconds:.0f} s)")
    print(f"cue speed {speed:.2f} m/s, x'0 {1e3 * side:+.1f} mm, y'0 {1e3 * height:+.1f} mm, theta {theta:+.4f} rad")
    return Status.DONE


def main(words: Sequence[str] | None = None) -> int:
    """Run the example; returns the exit status."""
    return run(command, words)


if __name__ == "__main__":
    sys.exit(main())
