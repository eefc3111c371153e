"""Scenes on a fitted model as a dm_control task.

In: a scene, or a function that draws scenes; a model with its uncertainty; the launcher's repeatability. Out: the
environment of models/environment from `load`, or with Gymnasium's interface from `gymnasium_env`.

Every reset draws one Monte Carlo sample (planner/evaluation/risk.py): execution errors of the launcher, and the model's
constants from their uncertainty. Shots are played with pocket jaws and all of the model's effects, in MuJoCo, or in the
event engine, which is faster. The reward is the utility of planner/evaluation/value.py, from -foul to 1.

The action's offsets are those of the cue's axis, (R + r_t) / R farther out than the contact, and its azimuth is the
cue's: if the model has no squirt effect, the ball leaves with the squirt of models/analytic/cueing.py
(planner/launcher/stroke.py). Left out: the next shot; an episode is one shot.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.environment.task import ActionBounds, Ending, ShotEnvironment
from models.errors import BadInput
from models.model_file import Model
from models.shot import Ball, Table
from planner.evaluation.outcome import Outcomes
from planner.evaluation.play import Player
from planner.evaluation.risk import ErrorSamples, draw_errors
from planner.evaluation.value import UtilityWeights, utility
from planner.launcher.execution import Execution, execution_from
from planner.launcher.stroke import AZIMUTH, HEIGHT, SIDE, SPEED, LauncherModel
from planner.scene import MAX_BALLS, Scene, pocket_places

if TYPE_CHECKING:
    from models.environment.gym import GymnasiumShot

Array = NDArray[np.float64]
Source = Scene | Callable[[np.random.Generator], Scene]


def as_strokes(launcher: LauncherModel, model: Model, actions: Array) -> Array:
    """The strokes (n, 4) of planner/launcher/stroke.py that play actions (n, 4) (V_C0, x'0, y'0, theta)."""
    ball, q = model.ball, np.zeros((len(actions), 4))
    q[:, [SIDE, HEIGHT]] = actions[:, 1:3] * ball.radius / (ball.radius + launcher.cue.tip_radius)
    q[:, SPEED] = actions[:, 0] * launcher.gain(q, ball)
    squirt = [launcher.command(model, row)["squirt"] for row in q]
    q[:, AZIMUTH] = actions[:, 3] + squirt
    return q


@dataclass(frozen=True)
class ScenePlay:
    """A scene, and the errors of one play; see models.environment.task.Episode."""

    player: Player
    samples: ErrorSamples  # a single sample
    weights: UtilityWeights
    mujoco: bool
    rows: int  # number of observed balls; those of the scene come first

    @property
    def position(self) -> Array:
        """Positions (rows, 2) [m], the cue ball first, then the object ball; NaN in rows without a ball."""
        return self._padded(self.player.scene.position[None])[0]

    @property
    def table(self) -> Table:
        """The table."""
        return self.player.scene.table

    @property
    def ball(self) -> Ball:
        """Size and mass of the balls."""
        return self.player.scene.ball

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the scene's balls."""
        return self.player.scene.names

    @property
    def goal(self) -> dict[str, NDArray[Any]]:
        """The goal.

        `pocket` (2,) [m] is the pocket's position, zeros if `any_pocket` (1,); `rest` (2,) [m] the cue ball's goal
        position, with `rest_radius` (1,) [m] about it, zeros if `any_rest` (1,); `rest_for` (rows,) marks the ball to
        leave a shot on, `avoid` (rows,) those that nothing may touch.
        """
        scene, goal = self.player.scene, self.player.scene.goal
        pocket = np.zeros(2) if goal.pocket is None else pocket_places(scene.table)[goal.pocket]
        names = [*scene.names, *[""] * (self.rows - len(scene.names))]
        return {
            "pocket": np.array(pocket, float), "any_pocket": np.array([goal.pocket is None]),
            "rest": np.zeros(2) if goal.rest is None else np.array(goal.rest, float),
            "rest_radius": np.array([float(goal.rest_radius)]), "any_rest": np.array([goal.rest is None]),
            "rest_for": np.array([bool(n) and n == goal.rest_for for n in names]),
            "avoid": np.array([n in goal.avoid for n in names]),
        }  # fmt: skip

    def play(self, actions: Array) -> Ending:
        """Play actions (n, 4) with the errors of this episode."""
        outcomes = self._outcomes(actions, self.samples)
        return Ending(self._padded(outcomes.place), utility(self.player.scene, outcomes, self.weights))

    def expected(self, actions: Array, plays: int, rng: np.random.Generator) -> Array:
        """Expected utility of actions (n, 4), estimated from new samples common to all of them: (n,)."""
        if plays < 1:
            raise BadInput(f"plays is {plays}; give 1 or more to take the mean over")
        samples = _draw(self.player.model, self.samples.execution, plays, rng)
        values = utility(self.player.scene, self._outcomes(actions, samples), self.weights)
        return np.asarray(values.reshape(len(actions), plays).mean(axis=1))

    def _outcomes(self, actions: Array, samples: ErrorSamples) -> Outcomes:
        q = as_strokes(self.player.launcher, self.player.model, actions)
        return samples.play(self.player, q, mujoco=self.mujoco)

    def _padded(self, place: Array) -> Array:
        """Places (n, nball, 2) padded with NaN to the number of observed balls: (n, rows, 2)."""
        return np.pad(place, ((0, 0), (0, self.rows - place.shape[1]), (0, 0)), constant_values=np.nan)


def _draw(model: Model, execution: Execution, count: int, rng: np.random.Generator) -> ErrorSamples:
    return draw_errors(model, execution, count, int(rng.integers(2**63)))


def load(
    scene: Source, model: Model, execution: Execution | None = None, weights: UtilityWeights | None = None, *,
    seed: int = 0, mujoco: bool = True, launcher: LauncherModel | None = None, balls: int | None = None,
    threads: int = 0, flat: bool = False,
) -> ShotEnvironment:  # fmt: skip
    """The environment of a scene, or of scenes drawn from a Generator.

    Args:
        scene: of every episode, or a function that draws one.
        model: fitted to the same table and ball; its constants are drawn from their uncertainty.
        execution: the launcher's repeatability; by default that of the model file, or the usual one.
        weights: of the utility.
        seed: of all random numbers.
        mujoco: play in MuJoCo; otherwise in the event engine.
        launcher: by default the usual one.
        balls: number of observed balls, the same in every episode; that of the scene, or 22 if scenes are drawn.
        threads: largest number of threads; 0 for all.
        flat: observe one vector instead of named arrays.

    Raises:
        BadInput: for a model that does not fit the scene, or a scene of more balls than are observed.
    """
    device, weights = launcher or LauncherModel(), weights or UtilityWeights()
    errors = execution or (execution_from(model.execution, "model") if model.execution else Execution())
    rows = balls or (len(scene.names) if isinstance(scene, Scene) else MAX_BALLS)

    def sample_episode(rng: np.random.Generator) -> ScenePlay:
        player = Player(model, scene if isinstance(scene, Scene) else scene(rng), device, threads)
        if len(player.scene.names) > rows:
            raise BadInput(f"the scene has {len(player.scene.names)} balls, but {rows} are observed; increase `balls`")
        return ScenePlay(player, _draw(player.model, errors, 1, rng), weights, mujoco, rows)

    axis = device.offset * (model.ball.radius + device.cue.tip_radius)
    return ShotEnvironment(sample_episode, ActionBounds(device.slowest, device.fastest, axis), seed, flat=flat)


def gymnasium_env(
    scene: Source, model: Model, *, render_mode: str | None = None, render_kwargs: dict[str, Any] | None = None,
    **given: Any,
) -> GymnasiumShot:  # fmt: skip
    """The same environment with Gymnasium's interface, through shimmy.

    Args:
        scene: as for `load`.
        model: as for `load`.
        render_mode: "rgb_array" for pictures, otherwise None.
        render_kwargs: of pictures: `height`, `width` [pixels], `camera_id`, as for models.environment.task.ShotPhysics.
        given: further arguments of `load`.

    Raises:
        BadInput: without the packages for it, with the command that installs them; and as `load` does.
    """
    try:
        from models.environment.gym import GymnasiumShot
    except ModuleNotFoundError as error:
        if (error.name or "").split(".")[0] in ("cuelab", "models"):
            raise
        raise BadInput(f"Gymnasium's interface needs {error.name}: pip install -e '.[gym]' in the checkout") from error
    return GymnasiumShot(load(scene, model, **given), render_mode, render_kwargs)
