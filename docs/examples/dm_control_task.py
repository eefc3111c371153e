"""A dm_control task with the launcher's motors as its action, for policies and for dm_control's viewer."""

import os

import numpy as np
from dm_control import mujoco
from dm_control.mujoco import wrapper
from dm_control.rl import control
from dm_env import specs

from models import World, full_model
from models.mujoco.launcher import Launcher
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"), furnished=True, marked=True)
launcher = Launcher(world)


class PushRed(control.Task):
    """Reward: how far the red has moved. Action: stage to the right and up [m], speed of the motor [rad/s]."""

    def initialize_episode(self, physics: mujoco.Physics) -> None:
        world.place({"white": (-0.8, 0.0), "red": (-0.5, 0.02)}, physics.data.ptr)
        launcher.aim(physics.data, azimuth=0.0)

    def action_spec(self, physics: mujoco.Physics) -> specs.BoundedArray:
        return mujoco.action_spec(physics)

    def before_step(self, action: np.ndarray, physics: mujoco.Physics) -> None:
        physics.set_control(action)

    def get_observation(self, physics: mujoco.Physics) -> dict[str, np.ndarray]:
        return {name: physics.named.data.qpos[name][:2].copy() for name in world.names}

    def get_reward(self, physics: mujoco.Physics) -> float:
        return float(np.hypot(*(physics.named.data.qpos["red"][:2] - [-0.5, 0.02])))


physics = mujoco.Physics.from_model(wrapper.MjModel(world.mj_model))
env = control.Environment(physics, PushRed(), n_sub_steps=50)
if os.environ.get("DISPLAY"):
    from dm_control import viewer

    viewer.launch(env)
else:
    step = env.reset()
    while physics.time() < 1.0:
        ramp = min(physics.time() / 0.2, 1.0)
        step = env.step(np.array([0.0, 0.0, 150.0 * ramp if physics.time() < 0.3 else 0.0]))
    print(f"the red has moved {step.reward:.2f} m")
