"""The table as a dm_control Physics, and a picture of it."""

from dm_control import mujoco
from dm_control.mujoco import wrapper

from models import World, full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"), furnished=True, marked=True)
physics = mujoco.Physics.from_model(wrapper.MjModel(world.mj_model))
world.place({"white": (-0.8, 0.0), "red": (0.2, 0.02)}, physics.data.ptr)
world.strike(physics.data, velocity=(2.0, 0.0))
while physics.time() < 1.0:
    physics.step()

print("red after a second:", physics.named.data.qpos["red"][:2].round(3))
picture = physics.render(height=360, width=640, camera_id="corner")
print("a picture of", picture.shape)
