"""The cue launcher in an MJCF world: `launcher.xml`, attached behind a ball, with a given cue.

`launcher.xml` is the device of Robotic Billiards (2015), section V: a regular cue on a rack, driven by a 200 W servo
through a 3:1 gearbox and a pinion, tilted by 6.5 degrees, on a two-axis stage; its azimuth is set by hand. In a world
that moves (models/mujoco/launcher.py) it strikes.

Offsets are those of the cue axis from the ball's centre in the plane normal to the axis: side to the right, height up,
seen from behind the cue. The stage moves in the vertical plane, so it is sent height / cos(tilt). The tip is a dome of
10 mm; it meets the ball at offset R / (R + 10 mm) of the axis.

What makes the tip grip: the leather is an equal spring along and across the cue (three slide joints, contact time
1 ms, e = 0.75 against a 0.1406 kg ball), with a hard surface whose friction holds as long as the pull stays in the cone
of 0.6; the limit is sin(atan 0.6) = 0.514 of the radius. (A solref contact alone gives nothing back across its normal:
at 12 mm of side the ball is 3 % slow and squirts 0.6 degrees too much.) The last 7 g of the shaft are free across the
cue (Cross 2008, Shepard 2001: end mass), which is what makes squirt.

Left out: bending modes of the shaft beyond that one, the tip's wear and chalk, backlash and play, cogging of the motor.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.errors import BadInput
from models.mjcf.native import CONTACT_TIME, solref
from models.shot import Ball

DEVICE_FILE = Path(__file__).with_name("launcher.xml")
NAME_PREFIX = "launcher/"
TIP_RADIUS = 0.010  # radius of the dome (Robotic Billiards 2015) [m]
TIP_FRICTION = 0.6  # chalked leather (Alciatore, Cross 2008: about 0.6)
TIP_RESTITUTION = 0.75  # leather (Alciatore: 0.71 to 0.75)
CUE_MASS = 0.5  # a regular cue, 17 to 18 oz [kg]
END_MASS = 0.00703  # end mass of the shaft, 1/20 of a snooker ball [kg]
LEATHER_TIME_S: Final = 1e-3  # contact time of the tip (Shepard 2001)
GEAR_RATIO, PINION_RADIUS_M = 3.0, 0.028  # motor turns a pinion turn (Robotic Billiards 2015); pitch radius [m]
STAGE_TRAVEL_M = 0.025  # travel of the stage in each direction
SLATE_IMPEDANCE = (0.999, 0.9999, 0.001, 0.5, 2)  # solimp of a struck ball's bed: a softer one kicks it up by 0.08 m/s
CUE_SPEED_RANGE = (0.2, 3.2)  # range of the cue's speed [m/s]; the paper's strings give 0.3 to 2.75


@dataclass(frozen=True)
class CueProperties:
    """The properties of cue and tip."""

    cue_mass: float = CUE_MASS  # with its end [kg]
    end_mass: float = END_MASS  # of the shaft, which moves sideways with the ball [kg]
    tip_restitution: float = TIP_RESTITUTION  # of the leather [1]
    tip_friction: float = TIP_FRICTION  # of the tip on the ball [1]

    def check(self) -> None:
        """Raise BadInput for impossible numbers."""
        if not 0.002 <= self.end_mass <= 0.1:
            raise BadInput(f"end_mass is {self.end_mass} kg; give 0.002 to 0.1")
        if not 0.2 <= self.cue_mass <= 3.0:
            raise BadInput(f"cue_mass is {self.cue_mass} kg; give 0.2 to 3")
        if not 0.3 <= self.tip_restitution < 1.0:
            raise BadInput(f"tip_restitution is {self.tip_restitution}; give 0.3 to below 1")
        if not 0 < self.tip_friction <= 2:
            raise BadInput(f"tip_friction is {self.tip_friction}; give a number above 0 and up to 2")


def attach_launcher(
    spec: mujoco.MjSpec, name: str, ball: Ball, device: CueProperties | None = None, aim: ArrayLike = (0.0, 0.0, 0.0)
) -> None:  # fmt: skip
    """Attach a launcher to a world, aimed along +x, its names prefixed "launcher/".

    Args:
        spec: the world.
        name: of the ball to be struck.
        ball: that ball.
        device: properties of cue and tip.
        aim: centre of the ball, table frame (3,) [m].

    Raises:
        BadInput: a number of the device is out of range.
    """
    device = device or CueProperties()
    device.check()
    frame = spec.worldbody.add_frame(pos=np.asarray(aim, float))
    machine = mujoco.MjSpec.from_file(str(DEVICE_FILE))
    machine.option.timestep, machine.option.integrator = spec.option.timestep, spec.option.integrator
    spec.attach(machine, frame=frame, prefix=NAME_PREFIX)
    leather = spec.body(f"{NAME_PREFIX}tip").mass
    spec.body(f"{NAME_PREFIX}shaft end").mass = device.end_mass - leather
    spec.body(f"{NAME_PREFIX}cue").mass = device.cue_mass - device.end_mass
    reduced = 1.0 / (1.0 / ball.mass + 1.0 / device.cue_mass)
    longer = CONTACT_TIME / LEATHER_TIME_S
    stiffness, damping = (-value for value in solref(device.tip_restitution))
    for axis in "xyz":
        joint = spec.joint(f"{NAME_PREFIX}leather {axis}")
        joint.stiffness = [longer**2 * stiffness * reduced, 0, 0]
        joint.damping = [longer * damping * reduced, 0, 0]
    pair = spec.add_pair(
        spec.find_default(f"{NAME_PREFIX}tip_ball"),
        name=f"{NAME_PREFIX}tip",
        geomname1=f"{NAME_PREFIX}tip",
        geomname2=f"ball {name}",
    )
    pair.friction = [device.tip_friction, device.tip_friction, 0, 0, 0]
