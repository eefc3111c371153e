"""The random scenes and truths of a study.

In: a `Study` (model, repeatability, seed, method) and the number of a scene. Out: the scene, and the truth that its
strokes are evaluated on. A scene: balls within a 5 x 6 ft area at one end of the table and a pocket at its edge, as in
Robotic Billiards (2015); the goal position is where the cue ball stops after a random stroke that pots. The truth: the
model's constants drawn from their uncertainty, and one small effect that the model lacks. All random numbers of a scene
come from the study's seed and the scene's number, so that results depend neither on order nor on processes. Left out:
truths that deviate from the model by more than its uncertainty.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.effect_catalogue import effect_class
from models.errors import BadInput
from models.model_file import Estimate, Model, full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.evaluation.play import Player
from planner.evaluation.risk import draw_errors
from planner.evaluation.value import UtilityWeights
from planner.launcher.execution import Execution
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel
from planner.planning import METHODS
from planner.scene import POCKETS, Goal, Scene
from planner.search.candidates import Route, aimed_along, all_routes, fan_half_width
from planner.search.search import Effort

Array = NDArray[np.float64]
BALL_NAMES = ("white", "red", "blue", "pink", "black", "brown", "green", "yellow")
AREA_M = (1.829, 1.524)  # along and across the table, at its -x end (Robotic Billiards 2015)
AREA_POCKETS = ((-1, 1), (0, 1), (-1, -1), (0, -1))  # pockets at the area's edge
MIN_SEPARATION_RADII = 3.0  # least distance between the centres of two balls
CUSHION_CLEARANCE_M = 0.01  # least distance of the object ball from a cushion
MAX_CALLED_CUT_RAD = math.radians(65)  # cut angle beyond which a player would not call the pocket
MAX_SCENES_DRAWN = 2000  # most draws to find a playable scene
REACHABLE_STROKES = 512  # strokes drawn to find one that pots
PLACE_DECIMALS = 4  # decimals of stored positions and distances [m]
# Estimated standard deviations of constants for which the model has none.
PRIOR_SDS = {
    "decoupled_cloth.slide": 0.005, "decoupled_cloth.roll": 0.0002, "decoupled_cloth.spin": 0.5,
    "ball_impact.restitution": 0.01, "ball_impact.friction": 0.005,
    "cushion_impact.restitution": 0.02, "cushion_impact.friction": 0.01,
}  # fmt: skip
USUAL_CONSTANTS = {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}  # Mathavan 2010, 2014
# Effects that a truth may have and the model lacks, as shares of the natural size; of squirt, the residual after its
# correction.
UNMODELLED_EFFECTS = {
    "table_tilt": 0.4, "cloth_nap": 0.25, "speed_drag": 0.25, "air_drag": 0.25, "side_curve": 0.25,
    "slide_friction_speed": 0.25, "spin_decay_speed": 0.25, "spin_slide_coupling": 0.25, "off_centre_ball": 0.25,
    "cushion_restitution_speed": 0.25, "cushion_friction_speed": 0.25, "ball_friction_speed": 0.25,
    "ball_restitution_speed": 0.25, "cue_ball_mass": 0.25, "squirt": 0.1,
}  # fmt: skip


class Stream(IntEnum):
    """The random streams of a scene, one for each kind of draw."""

    SCENE = 0
    TRUTH = 1
    PLAN = 2
    OBSERVED = 3
    CEILING = 4


@dataclass(frozen=True)
class Study:
    """The common settings of a study's scenes."""

    model: Model
    execution: Execution = field(default_factory=Execution)
    balls: int = 2
    seed: int = 0
    method: str = "both"
    plays: int = 200  # plays that evaluate a stroke on the truth
    effort: Effort = field(default_factory=Effort)
    weights: UtilityWeights = field(default_factory=UtilityWeights)

    def __post_init__(self) -> None:
        """Raise BadInput for settings from which no scene can be drawn."""
        if self.method not in ("both", *METHODS):
            raise BadInput(f"method is {self.method!r}; choose from both, {', '.join(METHODS)}")
        if not 2 <= self.balls <= len(BALL_NAMES):
            raise BadInput(f"{self.balls} balls; give 2 to {len(BALL_NAMES)}")
        if self.seed < 0:
            raise BadInput(f"seed {self.seed}; give 0 or more")
        if not self.model.table.pockets:
            raise BadInput("the model's table has no pockets; give a model of one that has")

    @property
    def methods(self) -> tuple[str, ...]:
        """The methods that plan."""
        return METHODS if self.method == "both" else (self.method,)

    def number(self, scene: int, part: int) -> int:
        """A seed for one random stream of a scene."""
        return int(np.random.SeedSequence([self.seed, scene, part]).generate_state(1)[0])


def usual_model() -> Model:
    """The base on a full-size table with Mathavan's constants and the uncertainty of the priors."""
    model = full_model(SNOOKER_TABLE, SNOOKER_BALL).with_values(USUAL_CONSTANTS)
    return dataclasses.replace(model, estimates={k: Estimate(sd, "prior of the study") for k, sd in PRIOR_SDS.items()})


def draw_scene(study: Study, number: int) -> tuple[Scene, int]:
    """The scene with a number, and the number of draws to find it."""
    model, rng = study.model, np.random.default_rng(study.number(number, Stream.SCENE))
    names = BALL_NAMES[: study.balls]
    for tries in range(1, MAX_SCENES_DRAWN + 1):
        position = _places(model, study.balls, rng)
        if position is None:
            continue
        goal = Goal(names[0], names[1], None, avoid=names[2:])
        scene = Scene(model.table, model.ball, names, position, goal)
        direct = [r for r in all_routes(scene) if r.direct and not r.obstacle and r.cut < MAX_CALLED_CUT_RAD]
        called = [r for r in direct if POCKETS[r.pocket] in AREA_POCKETS]
        if not called:
            continue
        route = called[int(rng.integers(len(called)))]
        scene = dataclasses.replace(scene, goal=dataclasses.replace(goal, pocket=POCKETS[route.pocket]))
        rest = _reachable_position(Player(model, scene, LauncherModel(), threads=1), route, rng)
        if rest is not None:
            return dataclasses.replace(scene, goal=dataclasses.replace(scene.goal, rest=rest)), tries
    raise BadInput(
        f"no playable scene of {study.balls} balls among {MAX_SCENES_DRAWN} drawn; give fewer --balls, or another "
        "--model"
    )


def _places(model: Model, count: int, rng: np.random.Generator) -> Array | None:
    """Random positions of balls (count, 2) [m] in the area; None if two are too close."""
    limit, end = model.table.centre_limits(model.ball), model.table.length / 2
    low = np.array([-limit[0], -min(AREA_M[1] / 2, limit[1])])
    high = np.array([min(AREA_M[0] - end, limit[0]), -low[1]])
    clearance = np.zeros((count, 2))
    clearance[1] = CUSHION_CLEARANCE_M
    low, high = np.maximum(low, -limit + clearance), np.minimum(high, limit - clearance)
    xy = np.round(low + (high - low) * rng.random((count, 2)), PLACE_DECIMALS)
    one, other = np.triu_indices(count, 1)
    close = np.hypot(*(xy[one] - xy[other]).T) < MIN_SEPARATION_RADII * model.ball.radius
    return None if close.any() else np.clip(xy, low, high)


def _reachable_position(player: Player, route: Route, rng: np.random.Generator) -> Array | None:
    """End point (2,) of the cue ball after a random stroke that pots without a foul; None if none does."""
    scene, launcher, n = player.scene, player.launcher, REACHABLE_STROKES
    offset, angle = launcher.max_offset(scene.ball) * np.sqrt(rng.random(n)), 2 * np.pi * rng.random(n)
    q = np.zeros((n, 4))
    q[:, SIDE], q[:, HEIGHT] = offset * np.cos(angle), offset * np.sin(angle)
    q[:, SPEED] = rng.uniform(launcher.slowest, launcher.fastest, n) * launcher.gain(q, scene.ball)
    q = aimed_along(player, route, q)
    q[:, AZIMUTH] += fan_half_width(player, route, q) * rng.uniform(-1, 1, n)
    out = player.screen(q)
    made = np.flatnonzero(out.made & np.isfinite(out.cue[:, 0]))
    if made.size == 0:
        return None
    limit = scene.table.centre_limits(scene.ball)
    return np.clip(np.round(out.cue[made[int(rng.integers(made.size))]], 3), -limit, limit)


def draw_truth(study: Study, number: int) -> tuple[Model, dict[str, Any]]:
    """The true model of a scene by number, without uncertainty, and the values drawn for it."""
    model = study.model
    estimates = {n: e for n, e in model.estimates.items() if 0 < e.sd < math.inf}
    estimates = {n: Estimate(PRIOR_SDS[n]) for n in model.parameters() if n in PRIOR_SDS} | estimates
    seed = study.number(number, Stream.TRUTH)
    drawn = draw_errors(dataclasses.replace(model, estimates=estimates), Execution(), 1, seed).values
    constants = {name: float(v[0]) for name, v in drawn.items()}
    rng = np.random.default_rng([seed, 1])
    in_model = {e.name() for e in model.effects if not e.is_off()}
    names = [name for name in UNMODELLED_EFFECTS if name not in in_model]
    name = names[int(rng.integers(len(names)))]
    values = _effect_values(name, rng)
    truth = dataclasses.replace(model.with_values(constants), estimates={}, fitted={})
    return truth.add(effect_class(name)(**values)), {"effect": name, "values": values, "constants": constants}


def _effect_values(name: str, rng: np.random.Generator) -> dict[str, float]:
    """Random parameters of an unmodelled effect, of either sign if its bounds allow; a tilt in any direction."""
    angle, tilt = rng.uniform(0, 2 * np.pi), name == "table_tilt"
    out = {}
    for k, (key, meta) in enumerate(effect_class(name).parameters().items()):
        if meta["off"] is None:
            continue
        size = UNMODELLED_EFFECTS[name] * (meta["default"] - meta["off"])
        factor = math.cos(angle - k * np.pi / 2)
        if not tilt:
            factor = 1.0 if meta["off"] - abs(size) < meta["bounds"][0] else math.copysign(1.0, factor)
        out[key] = float(meta["off"] + factor * size)
    return out
