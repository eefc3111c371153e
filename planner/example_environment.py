"""A policy that finds a shot from rewards alone: python -m planner.example_environment

The environment of planner/environment.py on one scene, and the cross-entropy method (Rubinstein 1999): actions are
drawn about a mean, the best of them say where and how wide to draw next. After a wide first round every action is
judged over several hands of the launcher's errors and the model's uncertainty, the one found over hands not yet seen.
It begins with a plain stroke at the middle of the object ball, and knows of no pocket, angle or spin:
planner/search/search.py does, and finds better shots sooner.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.command_line import input_option, lone_command, run, seed_option
from models.console import Status
from models.environment.task import ShotEnvironment
from models.errors import BadInput
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.model_file import Estimate, Model, full_model, read_model
from planner.environment import load
from planner.scene import Goal, Scene, read_scene

Array = NDArray[np.float64]
FIRST = 1200  # actions of the first round, which must hit upon a pot
DRAWN, BEST = 100, 10  # of the later ones
ROUNDS = 12
PLAYS = 16  # that an action is judged over
FRESH = 256  # for the figures that are told
LEAST = np.array([0.02, 2e-4, 2e-4, 3e-4])  # spread below which nothing is told apart: as q
# How well a fit of some fifty shots knows the constants: one standard deviation each.
KNOWN = {
    "decoupled_cloth.slide": 0.005, "decoupled_cloth.roll": 0.0003, "decoupled_cloth.spin": 1.0,
    "ball_impact.restitution": 0.01, "ball_impact.friction": 0.01,
    "cushion_impact.restitution": 0.015, "cushion_impact.friction": 0.02,
}  # fmt: skip


def example_scene() -> Scene:
    """A red to be cut into a corner 0.6 m away, a blue that must stay, the white wanted on the other side."""
    places = np.array([[0.9, 0.35], [1.35, 0.45], [1.45, -0.3]])
    goal = Goal("white", "red", (1, 1), rest=np.array([0.9, -0.2]), rest_radius=0.1, avoid=("blue",))
    return Scene(SNOOKER_TABLE, SNOOKER_BALL, ("white", "red", "blue"), places, goal)


def example_model() -> Model:
    """The base model with usual constants, as uncertain as a fit leaves them."""
    base = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    known = {name: Estimate(sd, "assumed for the example") for name, sd in KNOWN.items()}
    return Model(base.table, base.ball, effects=base.effects, estimates=known)


def plain(environment: ShotEnvironment, diameter: float) -> tuple[Array, Array]:
    """A plain stroke at the middle of the object ball, `diameter` [m], and how far about it to look: (4,), (4,)."""
    observed, spec = environment.reset().observation, environment.action_spec()
    way = observed["position"][1] - observed["position"][0]
    mean = np.array([0.5 * (spec.minimum[0] + spec.maximum[0]), 0.0, 0.0, math.atan2(way[1], way[0])])
    width = math.asin(min(diameter / float(np.hypot(*way)), 1.0))
    return mean, np.array([*(spec.maximum - spec.minimum)[:3] / 4, width / 2])


def improve(environment: ShotEnvironment, mean: Array, spread: Array, rng: np.random.Generator) -> Array:
    """The action that the cross-entropy method arrives at: (4,)."""
    for k in range(ROUNDS):
        count = DRAWN if k else FIRST
        actions = np.concatenate([mean[None], mean + spread * rng.normal(size=(count, 4))])
        found = environment.expected(actions, PLAYS if k else 1)
        best = actions[np.argsort(-found, kind="stable")[:BEST]]
        mean, spread = best.mean(axis=0), np.maximum(best.std(axis=0), LEAST)
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
    environment = load(scene, read_model(model_file) if model_file else example_model(), seed=seed)
    began = time.perf_counter()
    mean, spread = plain(environment, scene.ball.diameter)
    found = improve(environment, mean, spread, np.random.default_rng(seed))
    before, after = environment.expected([mean, found], FRESH)
    speed, side, height, theta = found
    print(
        f"mean reward over {FRESH} plays: {before:.3f} before, {after:.3f} after ({time.perf_counter() - began:.0f} s)"
    )
    print(f"cue speed {speed:.2f} m/s, x'0 {1e3 * side:+.1f} mm, y'0 {1e3 * height:+.1f} mm, theta {theta:+.4f} rad")
    return Status.DONE


def main(words: Sequence[str] | None = None) -> int:
    """Run the example; returns the exit status."""
    return run(command, words)


if __name__ == "__main__":
    sys.exit(main())
