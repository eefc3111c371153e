"""The shot as a dm_control task of one step.

In: a function that draws an `Episode` (balls, goal, execution errors), and the launcher's bounds. Out: an environment
whose observation is the balls and the goal, whose action is one stroke and whose reward is the utility of the shot.

The action is the paper's q = (V_C0, x'_0, y'_0, theta): speed of the cue [m/s], offset of its axis to the right and
upwards [m], azimuth [rad], within V_C0 < 2.2 m/s and a contact offset < 0.5 R (Robotic Billiards 2015, section VI).
Positions, goal and errors come from the package above through the Episode. Every reset draws a new one; its errors are
not observed, so that a policy has to maximise the expected reward.

The physics is a dm_control.rl.control.Physics and not a dm_control.mujoco.Physics: that one steps a single MjModel by a
fixed time, while simulation/simulate.py lets the effects act between steps, lands on what happens next, and plays shots
side by side. So a step is a whole shot, until all balls rest, and time is counted in shots. Leaves out the resolution
of speed strings and stage.
"""

from __future__ import annotations

import math
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from dm_control.rl import control
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from models.shot import Ball, Table

if TYPE_CHECKING:
    from models.mjcf.painter import Painter

Array = NDArray[np.float64]
ACTION_NAMES = ("cue speed [m/s]", "x'0 [m]", "y'0 [m]", "theta [rad]")


@dataclass(frozen=True)
class Ending:
    """Results of n strokes."""

    place: Array  # (n, nball, 2) [m], where balls stopped; NaN where none is on the table
    reward: Array  # (n,)


class Episode(Protocol):
    """Initial positions, and the errors of one play, which are not observed."""

    @property
    def position(self) -> Array:
        """Positions of the balls before the stroke: (nball, 2) [m]; NaN in rows without a ball."""

    @property
    def table(self) -> Table:
        """The table, for rendering."""

    @property
    def ball(self) -> Ball:
        """The balls' size and mass, for rendering."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the balls in the first rows of `position`, which choose their colours."""

    @property
    def goal(self) -> Mapping[str, NDArray[Any]]:
        """The goal as it is observed: arrays of the same shapes in every episode."""

    def play(self, actions: Array) -> Ending:
        """Play actions (n, 4), each from the same start and with the same errors."""

    def expected(self, actions: Array, plays: int, rng: np.random.Generator) -> Array:
        """Mean reward of actions (n, 4) over so many plays whose errors are drawn from `rng`: (n,)."""


EpisodeSampler = Callable[[np.random.Generator], Episode]


@dataclass(frozen=True)
class ActionBounds:
    """Bounds of the launcher's commands."""

    slowest: float  # of the cue [m/s]
    fastest: float  # of the cue [m/s]
    offset: float  # of the cue's axis from the ball's centre, in any direction [m]

    def spec(self) -> specs.BoundedArray:
        """Bounds of an action (4,): a square of offsets, of which only the inscribed circle is played."""
        high = np.array([self.fastest, self.offset, self.offset, math.pi])
        low = np.array([self.slowest, *-high[1:]])
        return specs.BoundedArray((4,), np.float64, low, high, name=", ".join(ACTION_NAMES))

    def clip(self, actions: ArrayLike) -> Array:
        """The commands for actions (n, 4): speeds within bounds, offsets scaled into the circle, azimuths within pi.

        Raises:
            ValueError: for another shape, or numbers that are not finite.
        """
        out = np.array(actions, np.float64)
        if out.ndim != 2 or out.shape[1] != len(ACTION_NAMES):
            raise ValueError(f"actions have shape {out.shape}; give (n, 4): {', '.join(ACTION_NAMES)}")
        if not np.isfinite(out).all():
            raise ValueError(f"an action holds {out[~np.isfinite(out)][0]}; give finite {', '.join(ACTION_NAMES)}")
        out[:, 0] = np.clip(out[:, 0], self.slowest, self.fastest)
        out[:, 1:3] *= np.minimum(1.0, self.offset / np.maximum(np.hypot(out[:, 1], out[:, 2]), 1e-12))[:, None]
        turned = np.abs(out[:, 3]) > math.pi
        out[turned, 3] = np.remainder(out[turned, 3] + math.pi, 2 * math.pi) - math.pi
        return out


class ShotPhysics(control.Physics):
    """Balls on a table, moved by whole shots."""

    def __init__(self, episode: Episode) -> None:
        """Start with an episode."""
        self._painter: Painter | None = None
        self._painted: tuple[Table, Ball, tuple[str, ...]] | None = None
        self.start(episode)

    def start(self, episode: Episode) -> None:
        """Place the balls of an episode."""
        self.episode = episode
        self.reset()

    def reset(self) -> None:
        """Move the balls back to their initial positions."""
        self.position = self.episode.position
        self.sent, self.reward, self.shots = np.zeros(len(ACTION_NAMES)), 0.0, 0

    def after_reset(self) -> None:
        """Do nothing: balls at rest have no derived state."""

    def set_control(self, control: Array) -> None:
        """Load the launcher with a stroke (4,) that it can play."""
        self.sent = control

    def step(self, n_sub_steps: int = 1) -> None:
        """Play the stroke until all balls rest."""
        if n_sub_steps != 1:
            raise ValueError(f"n_sub_steps is {n_sub_steps}; a step is a whole shot, play 1")
        ending = self.episode.play(self.sent[None])
        self.position, self.reward = ending.place[0], float(ending.reward[0])
        self.shots += 1

    def time(self) -> float:
        """Shots played since the reset."""
        return float(self.shots)

    def timestep(self) -> float:
        """One shot."""
        return 1.0

    def render(self, height: int = 240, width: int = 320, camera_id: str | int = "overhead") -> NDArray[np.uint8]:
        """The table as it is now: (height, width, 3), red, green, blue.

        Args:
            height: of the picture [pixels].
            width: of the picture [pixels].
            camera_id: "overhead", "corner" or "baulk", or 0 to 2.

        Raises:
            BadInput: if rendering is not possible, with what to install or to set.
        """
        from models.mjcf.painter import Painter

        rendered = self.episode.table, self.episode.ball, self.episode.names
        if self._painter is None or self._painted != rendered:
            self.free()
            self._painter, self._painted = Painter(*rendered), rendered
        return self._painter.draw(self.position[: len(rendered[2])], camera=camera_id, size=(width, height))

    def free(self) -> None:
        """Release the renderer; the next picture makes a new one."""
        if self._painter is not None:
            self._painter.close()
            self._painter = None


class ShotTask(control.Task):
    """One stroke and its utility.

    Observed are `position` (nball, 2) [m], zeros for balls off the table; `on_table` (nball,); `sent` (4,), the stroke
    as commanded, which differs from an action outside the launcher's bounds; and the goal.
    """

    def __init__(self, sample_episode: EpisodeSampler, bounds: ActionBounds, rng: np.random.Generator) -> None:
        """Store the sampler of episodes, the launcher's bounds, and the source of random numbers."""
        self.sample_episode, self.bounds, self.rng = sample_episode, bounds, rng

    def initialize_episode(self, physics: ShotPhysics) -> None:
        """Draw a start and the errors of a play."""
        physics.start(self.sample_episode(self.rng))

    def action_spec(self, physics: ShotPhysics) -> specs.BoundedArray:
        """Bounds of the action."""
        return self.bounds.spec()

    def before_step(self, action: ArrayLike, physics: ShotPhysics) -> None:
        """Load the action, moved into the launcher's bounds."""
        physics.set_control(self.bounds.clip(np.asarray(action)[None])[0])

    def get_observation(self, physics: ShotPhysics) -> OrderedDict[str, NDArray[Any]]:
        """The balls as a camera sees them, the stroke as commanded, and the goal."""
        seen = np.isfinite(physics.position[:, 0])
        found: OrderedDict[str, NDArray[Any]] = OrderedDict()
        found["position"] = np.where(seen[:, None], physics.position, 0.0)
        found["on_table"] = seen
        found["sent"] = physics.sent.copy()
        for name, value in physics.episode.goal.items():
            found[name] = np.array(value)
        return found

    def get_reward(self, physics: ShotPhysics) -> float:
        """Utility of the last shot."""
        return physics.reward

    def get_termination(self, physics: ShotPhysics) -> float:
        """Discount 0: an episode is one shot."""
        return 0.0


class ShotEnvironment(control.Environment):
    """A dm_env.Environment of one step, which also plays many strokes at once for search methods."""

    def __init__(self, sample_episode: EpisodeSampler, bounds: ActionBounds, seed: int, *, flat: bool = False) -> None:
        """Draw a first episode, from which the specs are read; the first reset draws the same again.

        Args:
            sample_episode: draws an episode.
            bounds: of the launcher's commands.
            seed: of all random numbers.
            flat: observe one vector instead of named arrays.
        """
        first = sample_episode(np.random.default_rng(seed))
        task = ShotTask(sample_episode, bounds, np.random.default_rng(seed))
        super().__init__(ShotPhysics(first), task, flat_observation=flat)

    def reward_spec(self) -> specs.Array:
        """One number."""
        return specs.Array((), np.float64, name="reward")

    def discount_spec(self) -> specs.BoundedArray:
        """0, as an episode ends with its shot."""
        return specs.BoundedArray((), np.float64, 0.0, 1.0, name="discount")

    def rewards(self, actions: ArrayLike) -> Array:
        """Rewards of `step` for each of actions (n, 4) in this episode, with its hidden errors: (n,)."""
        return self.physics.episode.play(self.task.bounds.clip(actions)).reward

    def expected(self, actions: ArrayLike, plays: int) -> Array:
        """Mean reward of actions (n, 4) over newly drawn errors, the same for all actions: (n,)."""
        return self.physics.episode.expected(self.task.bounds.clip(actions), plays, self.task.rng)
