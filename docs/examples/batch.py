"""Many strokes at once on mujoco.batch: where the red goes for cuts from thin to full."""

import mujoco.batch
import numpy as np

from models import World, full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

COUNT, SECONDS = 32, 1.5
world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"))
batch = mujoco.batch.Batch(world.mj_model, COUNT)
batch.expand("opt.timestep")  # each simulation has steps of its own
states = {name: batch.bind(name).reshape(COUNT, -1) for name in ("qpos", "qvel", "userdata", "time")}
for number, offset in enumerate(np.linspace(-0.04, 0.04, COUNT)):
    data = world.place({"white": (-0.8, 0.0), "red": (0.2, offset)})
    world.strike(data, velocity=(2.0, 0.0))
    for name in ("qpos", "qvel", "userdata"):
        states[name][number] = getattr(data, name)
while (going := np.flatnonzero(states["time"] < SECONDS)).size:
    batch.step(ids=going, nstep=50)

red = states["qpos"].reshape(COUNT, 2, 7)[:, 1, :2]
for offset, place in zip(np.linspace(-40, 40, COUNT)[::8], red[::8], strict=True):
    print(f"red {offset:+5.1f} mm aside: at {place.round(3)} after {SECONDS} s")
