"""The dm_control task of models/environment/task.py with Gymnasium's interface, by way of shimmy.

Needs the extra `gym` of this distribution. shimmy counts on numpy's legacy random numbers; here a seed goes to the
generator that the task draws from. An episode is one shot, so every step terminates it.
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

import gymnasium
import numpy as np

from models.environment.task import ShotEnvironment
from models.errors import BadInput

with contextlib.redirect_stdout(io.StringIO()):  # it names environments of others that lack a library
    from shimmy.dm_control_compatibility import DmControlCompatibilityV0
    from shimmy.utils.dm_env import dm_env_step2gym_step

RENDER_MODES = (None, "rgb_array")


class GymnasiumShot(DmControlCompatibilityV0):
    """A ShotEnvironment as a gymnasium.Env."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 1}  # noqa: RUF012 (gymnasium's own attribute)

    def __init__(
        self, environment: ShotEnvironment, render_mode: str | None = None, render_kwargs: dict[str, Any] | None = None
    ) -> None:
        """Wrap an environment; `render_kwargs` go to ShotPhysics.render.

        Raises:
            BadInput: for a mode other than None and "rgb_array".
        """
        if render_mode not in RENDER_MODES:
            raise BadInput(f"render_mode is {render_mode!r}; choose from None, 'rgb_array'")
        super().__init__(environment, render_mode, render_kwargs)
        self.metadata = dict(type(self).metadata)

    @property
    def np_random(self) -> np.random.Generator:
        """The generator of the task."""
        return self._env.task.rng

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        self._env.task.rng = value

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Draw an episode; the same seed draws the same one."""
        gymnasium.Env.reset(self, seed=seed)
        if seed is not None:
            self.np_random = self._np_random
        observation, _, _, _, info = dm_env_step2gym_step(self._env.reset())
        return observation, info
