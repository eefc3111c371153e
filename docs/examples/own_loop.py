"""A stroke in a loop of one's own: mj_step moves the balls, and contact forces are MuJoCo's."""

import mujoco
import numpy as np

from models import World, full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"), jaws=True)
data = world.place({"white": (-0.8, 0.0), "red": (0.2, 0.02)})
world.strike(data, velocity=(2.0, 0.0), spin=(0.0, 30.0, 10.0))

hardest, force = 0.0, np.zeros(6)
while not world.rests(data):
    mujoco.mj_step(world.mj_model, data)
    for number in range(data.ncon):
        mujoco.mj_contactForce(world.mj_model, data, number, force)
        hardest = max(hardest, float(force[0]))

print(f"at rest after {data.time:.2f} s; the hardest contact took {hardest:.0f} N")
for name in world.in_play(data):
    print(name, data.joint(name).qpos[:2].round(3))
