"""A body of one's own in the same world: a paddle, pushed by a motor, drives the ball before it."""

import mujoco

from models import World, full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

world = World(full_model(SNOOKER_TABLE, SNOOKER_BALL), ("white",))
body = world.spec.worldbody.add_body(name="paddle", pos=[-0.3, 0.0, SNOOKER_BALL.radius])
body.add_joint(name="rail", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[1, 0, 0], damping=2.0)
body.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.01, 0.05, 0.01], mass=0.3, contype=2, conaffinity=2)
world.spec.add_actuator(
    name="motor", target="rail", trntype=mujoco.mjtTrn.mjTRN_JOINT, gainprm=[1.0] + [0.0] * 9
)  # fmt: skip
world.recompile()

data = world.place({"white": (0.0, 0.0)})
data.ctrl[0] = 2.0
world.advance(data, 1.2)
print(f"paddle at {data.joint('rail').qpos[0] - 0.3:.3f} m, white at {data.joint('white').qpos[0]:.3f} m")
