"""One stroke of the launcher under way, step by step: drive, cue and tip, until the tip has left the ball.

In: the ball that is struck, what the tip feels of the cue, a copy of the world's model and its data. Out: `TipContact`,
the contact of tip and ball summed up, and the peaks of the drive.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import mujoco
import numpy as np

from models.mjcf.launcher import (
    GEAR_RATIO,
    NAME_PREFIX,
    PINION_RADIUS_M,
    CueProperties,
)
from models.mjcf.stroke import BRAKING_DECELERATION, CUE_TILT, MIN_ACCELERATION, RUN_UP_M
from models.mujoco import memory as mem
from models.shot import Array

COARSE_STEP_S, FINE_STEP_S = 1e-4, 1e-5  # steps of the stroke and of the hit [s]
LAUNCHER_STEP_S: Final = 2e-5  # longest that explicit damping of the leather allows, with room [s]
CONTROL_STEPS: Final = 2  # coarse steps a change of the speed command
RELEASE_STEPS: Final = 20  # fine steps without contact until the tip counts as gone
HIT_TIME_S: Final = 0.02  # in which a tip that is about to touch meets the ball, or misses it


@dataclass
class TipContact:
    """The contact of tip and ball, summed up over its steps."""

    cue_speed: float  # along its axis, just before the tip touches [m/s]
    cue_left: float  # the same, as the tip leaves [m/s]
    steps: int = 0  # with contact
    touched: float = 0.0  # when it began [s]
    time: float = 0.0  # of them [s]
    peak: float = 0.0  # of the normal force [N]
    slip: float = 0.0  # of the tip over the ball [m]
    pushed: float = 0.0  # impulse of the normal force [N s]
    slipping: float = 0.0  # part of it during which the tip slipped [N s]
    state: Array = field(default_factory=lambda: np.zeros(0))  # of the ball as the tip leaves: qvel (6,), quaternion


class Stroke:
    """One stroke under way."""

    def __init__(self, name: str, device: CueProperties, model: Any, data: Any, side: float, height: float) -> None:
        """Put the machine to its start, before the ball of that name; the step of `model`, a copy, will change."""
        self.model, self.data, self.name = model, data, name
        self.friction = device.tip_friction
        self.ball = model.geom(f"ball {name}").id
        self.tip = model.geom(f"{NAME_PREFIX}tip").id
        self.mesh = model.equality(f"{NAME_PREFIX}mesh").id
        self.servo = model.actuator(f"{NAME_PREFIX}servo").id
        self.dof = {
            name: model.joint(f"{NAME_PREFIX}{name}").dofadr[0] for name in ("motor", "pinion", "rack", "grip slide")
        }
        self.torque = self.power = self.speed = self.force = 0.0
        for k in range(model.njnt):
            joint = model.joint(k)
            if joint.name.startswith(NAME_PREFIX):
                data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = 0.0, 0.0
        for name, value in (("stage x", side), ("stage y", height / np.cos(CUE_TILT))):
            data.joint(f"{NAME_PREFIX}{name}").qpos = value  # the stage has moved before the stroke
            data.actuator(f"{NAME_PREFIX}{name}").ctrl = value
        mujoco.mj_forward(model, data)

    def step(self, cue_speed: float, longest: float, count: int = 1) -> None:
        """Go on with the servo at this speed of the cue [m/s]; notes the drive's peaks."""
        data, option = self.data, self.model.opt
        data.userdata[mem.LONGEST] = longest
        # Implicit damping is left out of MuJoCo's contact solver: with it, the leather's damping would soften the
        # contact, and the tip chatter on the ball. At fine steps everything may be explicit.
        fine = longest <= LAUNCHER_STEP_S
        option.integrator = mujoco.mjtIntegrator.mjINT_EULER if fine else mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        data.ctrl[self.servo] = cue_speed * GEAR_RATIO / PINION_RADIUS_M
        mujoco.mj_step(self.model, data, count)
        torque, turn = abs(data.actuator_force[self.servo]), abs(data.qvel[self.dof["motor"]])
        self.torque, self.speed = max(self.torque, torque), max(self.speed, turn)
        self.power = max(self.power, torque * turn)
        gear = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == self.mesh)
        self.force = max(self.force, float(np.abs(data.efc_force[gear]).max(initial=0.0)))

    def cue_speed(self) -> float:
        """Speed of the cue along its axis [m/s]."""
        return float(self.data.qvel[self.dof["rack"]] + self.data.qvel[self.dof["grip slide"]])

    def gap(self) -> float:
        """Gap between the surfaces of tip and ball [m]."""
        apart = np.linalg.norm(self.data.geom_xpos[self.tip] - self.data.geom_xpos[self.ball])
        return float(apart - self.model.geom_size[self.tip, 0] - self.model.geom_size[self.ball, 0])

    def touch(self) -> tuple[float, float, float] | None:
        """Force of the tip on the ball in the last step: normal, friction [N], slip speed [m/s]; None if apart."""
        data = self.data
        for k in range(data.ncon):
            contact = data.contact[k]
            if {contact.geom1, contact.geom2} == {self.tip, self.ball} and contact.efc_address >= 0:
                row = contact.efc_address
                force, slip = data.efc_force[row : row + 3], data.efc_vel[row + 1 : row + 3]
                return float(force[0]), float(np.hypot(force[1], force[2])), float(np.hypot(slip[0], slip[1]))
        return None

    def _near(self, cue_speed: float) -> float:
        """Gap at which the stroke goes on in fine steps [m]."""
        return 3 * CONTROL_STEPS * COARSE_STEP_S * cue_speed

    def run_up(self, cue_speed: float) -> None:
        """Accelerate from rest until the tip is about to touch."""
        start, ramp = self.data.time, min(2 * RUN_UP_M / cue_speed, cue_speed / MIN_ACCELERATION)  # [s]
        while self.gap() > self._near(cue_speed):
            part = min((self.data.time - start) / ramp, 1.0)
            self.step(cue_speed * (0.5 - 0.5 * np.cos(np.pi * part)), COARSE_STEP_S, CONTROL_STEPS)

    def begin(self, cue_speed: float) -> None:
        """Put the cue at its speed before the ball, as far as a run-up would have taken it."""
        data, near = self.data, self._near(cue_speed)
        while (left := self.gap() - near) > 0.01 * near:
            data.qpos[self.model.joint(f"{NAME_PREFIX}rack").qposadr[0]] += left
            data.qpos[self.model.joint(f"{NAME_PREFIX}pinion").qposadr[0]] += left / PINION_RADIUS_M
            data.qpos[self.model.joint(f"{NAME_PREFIX}motor").qposadr[0]] += GEAR_RATIO * left / PINION_RADIUS_M
            mujoco.mj_kinematics(self.model, data)
        data.qvel[self.dof["rack"]] = cue_speed
        data.qvel[self.dof["pinion"]] = cue_speed / PINION_RADIUS_M
        data.qvel[self.dof["motor"]] = GEAR_RATIO * cue_speed / PINION_RADIUS_M
        mujoco.mj_forward(self.model, data)

    def hit(self, cue_speed: float) -> TipContact:
        """Go on in fine steps until the tip has left the ball, or has not touched it in HIT_TIME_S."""
        data, hit = self.data, TipContact(self.cue_speed(), self.cue_speed())
        alone, deadline = 0, data.time + HIT_TIME_S
        while alone < RELEASE_STEPS and data.time < deadline:
            before = data.time
            self.step(cue_speed, FINE_STEP_S)
            passed, touch = data.time - before, self.touch()
            if touch is not None:
                hit.touched = hit.touched if hit.steps else before
                normal, friction, sliding = touch
                hit.peak, hit.slip, hit.pushed = (
                    max(hit.peak, normal), hit.slip + sliding * passed, hit.pushed + normal * passed
                )  # fmt: skip
                hit.slipping += normal * passed if friction > 0.98 * self.friction * normal else 0.0
                hit.steps, hit.time, alone = hit.steps + 1, hit.time + passed, 0
            elif hit.steps:
                if alone == 0:
                    joint = data.joint(self.name)
                    hit.state, hit.cue_left = np.concatenate([joint.qvel, joint.qpos[3:]]), self.cue_speed()
                alone += 1
            else:
                hit.cue_speed = self.cue_speed()
        return hit

    def follow_through(self, cue_speed: float) -> float:
        """Brake until the rack stands; returns how far it has travelled [m]."""
        left = cue_speed
        while left > 0 or self.cue_speed() > 0.02:
            self.step(left, COARSE_STEP_S, CONTROL_STEPS)
            left = max(left - BRAKING_DECELERATION * CONTROL_STEPS * COARSE_STEP_S, 0.0)
        self.data.userdata[mem.LONGEST] = 0.0
        return float(self.data.joint(f"{NAME_PREFIX}rack").qpos[0])
