"""MuJoCo's own viewer on a table that moves, with a shot under way; without a screen the shot is played unseen."""

import time

import mujoco.viewer

from models import World, full_model
from models.recording.viewer import display_missing
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"), furnished=True, marked=True)
data = world.place({"white": (-0.8, 0.0), "red": (0.2, 0.02)})
world.strike(data, velocity=(2.0, 0.0))
viewer = None if display_missing() else mujoco.viewer.launch_passive(world.mj_model, data)
while not world.rests(data) and (viewer is None or viewer.is_running()):
    began = time.monotonic()
    world.advance(data, data.time + 1 / 60)
    if viewer is not None:
        viewer.sync()
        time.sleep(max(1 / 60 - (time.monotonic() - began), 0.0))
print("red after the shot:", data.joint("red").qpos[:2].round(3))
