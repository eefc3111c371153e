"""The cue launcher in a world that `mj_step` moves: its stage, servo and cue strike the first ball with the tip.

    world = World(model, ("white", "red"))
    launcher = Launcher(world)  # the machine is now part of world.spec, and compiled
    data = world.place({"white": (-1.0, 0.0), "red": (0.5, 0.02)})
    launcher.aim(data, azimuth=0.02)
    stroke = launcher.strike(data, 2.0, side=0.004)  # until the tip has left the ball
    world.advance(data, 4.0)

Servo and stage are driven by `data.ctrl`; nothing but the tip's contact moves the ball, on whose cloth the slate's load
rubs it (`World.weigh`). A whole stroke begins at rest; `run_up=False` puts the cue a little before the ball at its
speed, for many strokes in a short time. With a launcher the longest step is LAUNCHER_STEP_S, which the leather needs.
The machine itself: models/mjcf/launcher.md.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.errors import BadInput
from models.mjcf.launcher import (
    CUE_SPEED_RANGE,
    GEAR_RATIO,
    NAME_PREFIX,
    PINION_RADIUS_M,
    STAGE_TRAVEL_M,
    TIP_RADIUS,
    CueProperties,
    attach_launcher,
)
from models.mjcf.stroke import BRAKING_DECELERATION, CUE_TILT, MIN_ACCELERATION, RUN_UP_M
from models.mujoco import memory as mem
from models.mujoco.world import memory
from models.shot import UNKNOWN_SESSION, Array, Session

if TYPE_CHECKING:
    from models.mujoco.world import World

COARSE_STEP_S, FINE_STEP_S = 1e-4, 1e-5  # steps of the stroke and of the hit [s]
LAUNCHER_STEP_S: Final = 2e-5  # longest that explicit damping of the leather allows, with room [s]
CONTROL_STEPS: Final = 2  # coarse steps a change of the speed command
RELEASE_STEPS: Final = 20  # fine steps without contact until the tip counts as gone
HIT_TIME_S: Final = 0.02  # in which a tip that is about to touch meets the ball, or misses it
MISCUE_SHARE: Final = 0.2  # part of the impulse that the tip passes on while it slips, above which it is a miscue


@dataclass(frozen=True)
class SimulatedStroke:
    """Result of a stroke: the ball as the tip leaves it, and the peaks of the drive."""

    cue_speed: float  # along its axis, just before it hits [m/s]
    cue_left: float  # the same, as the tip leaves [m/s]
    velocity: Array  # of the ball: (3,) [m/s], table frame
    spin: Array  # of the ball: (3,) [rad/s], table frame
    squirt: float  # direction of the ball against the aim [rad], > 0 to the left
    contact_time: float  # [s]
    since: float  # the tip touched the ball, at the end of the stroke [s]
    tip_force: float  # peak [N]
    slip: float  # of the tip over the ball [m]
    miscue: bool  # the tip slipped during more than a fifth of the impulse
    torque: float  # of the motor, peak [N m]
    power: float  # of the motor, peak [W]
    motor_speed: float  # peak [rad/s]
    rack_force: float  # between pinion and rack, peak [N]
    travel: float  # of the rack in all [m]; nan unless it was followed to its stop


class Launcher:
    """The machine in a world, behind the first ball."""

    def __init__(self, world: World, device: CueProperties | None = None) -> None:
        """Add it to a world, which is compiled anew.

        Args:
            world: its first ball is struck.
            device: what the tip feels of the cue.

        Raises:
            BadInput: a number of the device is out of range.
        """
        self.world, self.device, self.name = world, device or CueProperties(), world.names[0]
        attach_launcher(world.spec, self.name, world.model.ball, self.device)
        world.spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        world.weigh(self.name)
        world.recompile(LAUNCHER_STEP_S)
        self.azimuth = 0.0

    @property
    def model(self) -> mujoco.MjModel:
        """The world's model."""
        return self.world.mj_model

    def aim(self, data: Any, azimuth: float) -> None:
        """Put the stand behind the first ball where it lies in `data`, turned to azimuth [rad].

        The stand is a part of the model: it moves for all data of it.
        """
        if not np.isfinite(azimuth):
            raise BadInput(f"azimuth is {azimuth}; give radians")
        data = getattr(data, "ptr", data)
        at = data.joint(self.name).qpos[:3]
        stand = self.model.body(f"{NAME_PREFIX}stand")
        half = azimuth / 2
        stand.pos[:], stand.quat[:] = at, [np.cos(half), 0, 0, np.sin(half)]
        self.azimuth = float(azimuth)
        mujoco.mj_forward(self.model, data)

    def strike(
        self, data: Any, cue_speed: float, side: float = 0.0, height: float = 0.0, *, run_up: bool = True,
        follow_through: bool = False, session: Session = UNKNOWN_SESSION, row: int = 0,
    ) -> SimulatedStroke:  # fmt: skip
        """Strike the ball, until the tip has left it.

        Args:
            data: the balls; the machine is put to its start.
            cue_speed: wanted at the hit [m/s], 0.2 to 3.2.
            side: of the cue axis from the ball's centre, to the right (x'0) [m], within +-25 mm.
            height: the same, up (y'0) [m].
            run_up: begin at rest; otherwise at speed, a little before the ball.
            follow_through: go on until the rack has stopped, for the peaks of the drive.
            session: when and under what the shot is played.
            row: the set of parameters of the world's model.

        Raises:
            BadInput: the speed or an offset is out of range, or the cue misses the ball.
        """
        data = getattr(data, "ptr", data)
        _check(cue_speed, side, height, self.world.model.ball.radius)
        data.userdata[:] = memory(row, data.time, 0.0, session, len(data.userdata))
        machine = _Machine(self, copy.copy(self.model), data, side, height)
        if run_up:
            machine.run_up(cue_speed)
        else:
            machine.begin(cue_speed)
        hit = machine.hit(cue_speed)
        data.userdata[mem.LONGEST] = 0.0
        if not hit.steps:
            raise _missing(side, height, self.world.model.ball.radius)
        since = data.time - hit.touched
        travel = machine.follow_through(cue_speed) if follow_through else np.nan
        data.userdata[mem.LAUNCH] = np.hypot(*hit.state[:2])
        data.ctrl[machine.servo] = 0.0
        spin = np.zeros(3)
        mujoco.mju_rotVecQuat(spin, hit.state[3:6], hit.state[6:10])  # a free joint turns about its own axes
        away = np.arctan2(hit.state[1], hit.state[0]) - self.azimuth
        return SimulatedStroke(
            cue_speed=hit.cue_speed,
            cue_left=hit.cue_left,
            velocity=hit.state[:3].copy(),
            spin=spin,
            squirt=float(np.arctan2(np.sin(away), np.cos(away))),
            contact_time=hit.time,
            since=since,
            tip_force=hit.peak,
            slip=hit.slip,
            miscue=hit.slipping > MISCUE_SHARE * hit.pushed,
            torque=float(machine.torque),
            power=float(machine.power),
            motor_speed=float(machine.speed),
            rack_force=machine.force,
            travel=travel,
        )

    def strike_all(
        self, places: Mapping[str, ArrayLike], azimuth: float, strokes: Iterable[tuple[float, float, float]], *,
        threads: int = 2,
    ) -> list[SimulatedStroke]:  # fmt: skip
        """Strokes (cue_speed, side, height) at balls in the same places; the same whatever the number of threads."""
        self.aim(self.world.place(places), azimuth)

        def one(stroke: tuple[float, float, float]) -> SimulatedStroke:
            return self.strike(self.world.place(places), *stroke)

        with ThreadPoolExecutor(threads) as pool:
            return list(pool.map(one, strokes))


def _check(cue_speed: float, side: float, height: float, radius: float) -> None:
    """A stroke that the machine can play."""
    if not CUE_SPEED_RANGE[0] <= cue_speed <= CUE_SPEED_RANGE[1]:
        raise BadInput(f"cue_speed is {cue_speed} m/s; the drive allows {CUE_SPEED_RANGE[0]} to {CUE_SPEED_RANGE[1]}")
    for name, value, most in (("side", side, STAGE_TRAVEL_M), ("height", height, STAGE_TRAVEL_M * np.cos(CUE_TILT))):
        if not abs(value) <= most:
            raise BadInput(f"{name} is {value} m; the stage travels +-{most:.4f} m")
    if np.hypot(side, height) >= radius + TIP_RADIUS:
        raise _missing(side, height, radius)


def _missing(side: float, height: float, radius: float) -> BadInput:
    return BadInput(f"side {side} m, height {height} m miss the ball; stay within {radius} m")


@dataclass
class _Hit:
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


class _Machine:
    """One stroke under way."""

    def __init__(self, launcher: Launcher, model: Any, data: Any, side: float, height: float) -> None:
        self.model, self.data, self.name = model, data, launcher.name  # a copy of the model: its step changes
        self.friction = launcher.device.tip_friction
        self.ball = model.geom(f"ball {launcher.name}").id
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

    def hit(self, cue_speed: float) -> _Hit:
        """Go on in fine steps until the tip has left the ball, or has not touched it in HIT_TIME_S."""
        data, hit = self.data, _Hit(self.cue_speed(), self.cue_speed())
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
