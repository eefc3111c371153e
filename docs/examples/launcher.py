"""The launcher's tip strikes: servo, stage and cue are bodies of the same world, with their own sensors."""

import numpy as np

from models import World, full_model
from models.mujoco.launcher import Launcher
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white", "red"))
launcher = Launcher(world)
data = world.place({"white": (-0.8, 0.0), "red": (0.2, 0.02)})
launcher.aim(data, azimuth=0.02)
stroke = launcher.strike(data, 1.5, side=0.004, height=0.006)  # cue speed [m/s], offsets of its axis [m]
speed, squirt = np.hypot(*stroke.velocity[:2]), np.degrees(stroke.squirt)
print(
    f"cue {stroke.cue_speed:.3f} m/s, ball {speed:.3f} m/s, squirt {squirt:.2f} degrees, tip {stroke.tip_force:.0f} N"
)
print(f"the slate bears {data.sensor('load white').data[0]:.2f} N, the motor gives {stroke.torque:.2f} N m")
world.advance(data, 1.2)
print("red:", data.joint("red").qpos[:2].round(3))
