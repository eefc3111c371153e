"""The cue launcher at the table: device and world in one MjModel, and a whole stroke simulated in it.

`launcher.xml` is the device of Robotic Billiards (2015), section V: a regular cue on a rack, driven by a 200 W servo
through a 3:1 gearbox and a pinion, tilted by 6.5 degrees, on a two-axis stage; its azimuth is set by hand. Here it is
attached to the world of `mjcf/world.py`, aimed at the centre of a ball, and let strike: the servo spins up, holds its
speed, the tip hits, and the ball's state is read as the tip leaves it.

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

import copy
import sys
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from models.mjcf.gl import choose_backend

if __name__ == "__main__":
    choose_backend(render="--picture" in " ".join(sys.argv))  # before MuJoCo is imported

import mujoco
import numpy as np

from models.errors import BadInput
from models.mjcf.native import Native
from models.mjcf.world import build_spec
from models.shot import Array, Ball, Table

DEVICE_FILE = Path(__file__).with_name("launcher.xml")
NAME_PREFIX = "launcher/"
CUE_TILT = np.radians(6.5)  # of the cue (Robotic Billiards 2015) [rad]
TIP_RADIUS = 0.010  # of the dome (Robotic Billiards 2015) [m]
TIP_FRICTION = 0.6  # chalked leather (Alciatore, Cross 2008: about 0.6)
TIP_RESTITUTION = 0.75  # leather (Alciatore: 0.71 to 0.75)
CUE_MASS = 0.5  # a regular cue, 17 to 18 oz [kg]
END_MASS = 0.00703  # of the shaft, 1/20 of a snooker ball [kg]
GEAR_RATIO, PINION_RADIUS_M = 3.0, 0.028  # motor turns a pinion turn (Robotic Billiards 2015); pitch radius [m]
STAGE_TRAVEL_M = 0.025  # of the stage, each way [m]
CUE_SPEED_RANGE = (0.2, 3.2)  # of the cue [m/s]; the paper's strings give 0.3 to 2.75
RUN_UP = 0.16  # over which a fast cue accelerates [m]; some 70 mm at constant speed follow
MIN_ACCELERATION = 5.0  # of a slow cue [m/s^2]
BRAKING_DECELERATION = 45.0  # after the hit [m/s^2]
COARSE_STEP_S, FINE_STEP_S = 1e-4, 1e-5  # steps of the stroke and of the hit [s]
CONTROL_STEPS = 2  # coarse steps a change of the speed command
RELEASE_STEPS = 20  # fine steps without contact until the tip counts as gone
SLATE_IMPEDANCE = (0.999, 0.9999, 0.001, 0.5, 2)  # stiff: the world's softer bed kicks the ball up by 0.08 m/s
MISCUE_SHARE = 0.2  # part of the impulse that the tip passes on while it slips, above which it is called a miscue


@dataclass(frozen=True)
class LauncherScene:
    """A table with a launcher that is aimed at a ball."""

    model: mujoco.MjModel
    ball: Ball
    name: str  # of the ball
    azimuth: float  # of the aim [rad], counter-clockwise from +x
    tip_friction: float
    spec: mujoco.MjSpec


@dataclass(frozen=True)
class SimulatedStroke:
    """What came of a stroke: the ball as the tip leaves it, and what it took."""

    cue_speed: float  # along its axis, just before it hits [m/s]
    cue_left: float  # the same, as the tip leaves [m/s]
    velocity: Array  # of the ball: (3,) [m/s], table frame
    spin: Array  # of the ball: (3,) [rad/s], table frame
    squirt: float  # direction of the ball against the aim [rad], > 0 to the left
    contact_time: float  # [s]
    tip_force: float  # peak [N]
    slip: float  # of the tip over the ball [m]
    miscue: bool  # the tip slipped during more than a fifth of the impulse
    torque: float  # of the motor, peak [N m]
    power: float  # of the motor, peak [W]
    motor_speed: float  # peak [rad/s]
    rack_force: float  # between pinion and rack, peak [N]
    travel: float  # of the rack in all [m]; nan unless it was followed to its stop


def attach_launcher(spec: mujoco.MjSpec, aim: Array, azimuth: float) -> None:
    """Attach a launcher to a world, its names prefixed "launcher/"; aim: (3,) [m], azimuth [rad], table frame."""
    device = mujoco.MjSpec.from_file(str(DEVICE_FILE))
    half = azimuth / 2
    frame = spec.worldbody.add_frame(pos=aim, quat=[np.cos(half), 0, 0, np.sin(half)])
    spec.attach(device, frame=frame, prefix=NAME_PREFIX)


def _checked_places(table: Table, ball: Ball, names: Sequence[str], position: Array, others: Array | None) -> Array:
    """Places of all balls, the struck one first: (n, 2) [m]; BadInput where one does not lie on the table."""
    rest = np.zeros((0, 2)) if others is None else np.asarray(others, float)
    if not names or rest.shape != (len(names) - 1, 2):
        raise BadInput(f"others has shape {rest.shape}; {len(names)} balls need ({max(len(names) - 1, 0)}, 2)")
    places = np.vstack([np.asarray(position, float).reshape(1, 2), rest])
    for name, xy in zip(names, places, strict=True):
        if not np.all(np.abs(xy) <= table.centre_limits(ball)):
            raise BadInput(
                f"ball {name!r} is at {xy.tolist()}; keep it within +-{table.centre_limits(ball).tolist()} m"
            )
    return places


def build_scene(
    table: Table,
    ball: Ball,
    names: Sequence[str],
    position: Array,
    azimuth: float,
    *,
    others: Array | None = None,
    end_mass: float = END_MASS,
    tip_friction: float = TIP_FRICTION,
    slate: bool = True,
    native: Native | None = None,
    furnished: bool = False,
) -> LauncherScene:
    """A launcher at a table, aimed at the first ball.

    Args:
        table: the table, with native contacts (`models/mjcf/native.py`).
        ball: all balls.
        names: of the balls; the launcher strikes the first.
        position: of the first ball (2,) [m], table frame.
        azimuth: of the cue [rad], counter-clockwise from +x.
        others: of the other balls (n - 1, 2) [m].
        end_mass: what of the shaft moves sideways with the ball [kg].
        tip_friction: of the tip on the ball.
        slate: False lets the ball float, so that nothing but the tip acts on it.
        native: terms of the table's contacts; the shipped ones without.
        furnished: with what is only seen.

    Raises:
        BadInput: the ball or another is not on the table, or a number is out of range.
    """
    places = _checked_places(table, ball, names, position, others)
    if not np.isfinite(azimuth):
        raise BadInput(f"azimuth is {azimuth}; give radians")
    if not 0.002 <= end_mass <= 0.1:
        raise BadInput(f"end_mass is {end_mass} kg; give 0.002 to 0.1")
    if not 0 < tip_friction <= 2:
        raise BadInput(f"tip_friction is {tip_friction}; give a number above 0 and up to 2")
    spec = build_spec(table, ball, names, (native or Native(),), furnished=furnished)
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST  # the servo's and the leather's damping
    attach_launcher(spec, np.append(places[0], ball.radius), azimuth)
    end, cue = spec.body(f"{NAME_PREFIX}shaft end"), spec.body(f"{NAME_PREFIX}cue")
    leather = spec.body(f"{NAME_PREFIX}tip").mass
    end.mass, cue.mass = end_mass - leather, CUE_MASS - end_mass
    pair = spec.add_pair(
        spec.find_default(f"{NAME_PREFIX}tip_ball"),
        name=f"{NAME_PREFIX}tip",
        geomname1=f"{NAME_PREFIX}tip",
        geomname2=f"ball {names[0]}",
    )
    pair.friction = [tip_friction, tip_friction, 0, 0, 0]
    for name, xy in zip(names, places, strict=True):
        spec.body(name).pos[:2] = xy
    bed = next(p for p in spec.pairs if {p.geomname1, p.geomname2} == {f"ball {names[0]}", "bed"})
    bed.solimp = SLATE_IMPEDANCE
    if not slate:
        spec.body(names[0]).gravcomp = 1
        spec.delete(bed)
    return LauncherScene(spec.compile(), ball, names[0], float(azimuth), tip_friction, spec)


@dataclass
class _Hit:
    """The contact of tip and ball, summed up over its fine steps."""

    cue_speed: float  # along its axis, just before the tip touches [m/s]
    cue_left: float  # the same, as the tip leaves [m/s]
    steps: int = 0  # with contact
    peak: float = 0.0  # of the normal force [N]
    slip: float = 0.0  # of the tip over the ball [m]
    pushed: float = 0.0  # sum of the normal force over the steps [N]
    slipping: float = 0.0  # part of that sum during which the tip slipped [N]
    state: Array = field(default_factory=lambda: np.zeros(0))  # of the ball as the tip leaves: qvel (6,), quaternion


class _Machine:
    """One stroke under way."""

    def __init__(self, scene: LauncherScene, side: float, height: float) -> None:
        self.model = copy.copy(scene.model)  # the step changes
        self.data = mujoco.MjData(self.model)
        self.ball = self.model.geom(f"ball {scene.name}").id
        self.tip = self.model.geom(f"{NAME_PREFIX}tip").id
        self.mesh = self.model.equality(f"{NAME_PREFIX}mesh").id
        self.servo = self.model.actuator(f"{NAME_PREFIX}servo").id
        self.dof = {
            name: self.model.joint(f"{NAME_PREFIX}{name}").dofadr[0] for name in ("motor", "rack", "grip slide")
        }
        self.torque = self.power = self.speed = self.force = 0.0
        for name, value in (("stage x", side), ("stage y", height / np.cos(CUE_TILT))):
            self.data.joint(f"{NAME_PREFIX}{name}").qpos = value  # the stage has moved before the stroke
            self.data.actuator(f"{NAME_PREFIX}{name}").ctrl = value
        mujoco.mj_forward(self.model, self.data)

    def step(self, cue_speed: float, timestep: float, count: int = 1) -> None:
        """Go on with the servo at this speed of the cue [m/s]; notes the drive's peaks."""
        data = self.data
        option = self.model.opt
        option.timestep = timestep
        if timestep < COARSE_STEP_S:
            # Implicit damping is left out of MuJoCo's contact solver: with it, the leather's damping would soften the
            # contact, and the tip chatter on the ball. At fine steps everything may be explicit.
            option.integrator = mujoco.mjtIntegrator.mjINT_EULER
            option.disableflags |= mujoco.mjtDisableBit.mjDSBL_EULERDAMP
        else:
            option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        data.ctrl[self.servo] = cue_speed * GEAR_RATIO / PINION_RADIUS_M
        mujoco.mj_step(self.model, data, count)
        torque, turn = abs(data.actuator_force[self.servo]), abs(data.qvel[self.dof["motor"]])
        self.torque, self.speed = max(self.torque, torque), max(self.speed, turn)
        self.power = max(self.power, torque * turn)
        gear = (data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY) & (data.efc_id == self.mesh)
        self.force = max(self.force, float(np.abs(data.efc_force[gear]).max(initial=0.0)))

    def cue_speed(self) -> float:
        """Of the cue along its axis [m/s]."""
        return float(self.data.qvel[self.dof["rack"]] + self.data.qvel[self.dof["grip slide"]])

    def gap(self) -> float:
        """Between the surfaces of tip and ball [m]."""
        apart = np.linalg.norm(self.data.geom_xpos[self.tip] - self.data.geom_xpos[self.ball])
        return float(apart - self.model.geom_size[self.tip, 0] - self.model.geom_size[self.ball, 0])

    def touch(self) -> tuple[float, float, float] | None:
        """Of the tip on the ball in the last step: normal force, friction [N], slip speed [m/s]; None if apart."""
        data = self.data
        for k in range(data.ncon):
            contact = data.contact[k]
            if {contact.geom1, contact.geom2} == {self.tip, self.ball} and contact.efc_address >= 0:
                row = contact.efc_address
                force, slip = data.efc_force[row : row + 3], data.efc_vel[row + 1 : row + 3]
                return float(force[0]), float(np.hypot(force[1], force[2])), float(np.hypot(slip[0], slip[1]))
        return None

    def run_up(self, cue_speed: float) -> None:
        """Accelerate from rest until the tip is about to touch."""
        ramp = min(2 * RUN_UP / cue_speed, cue_speed / MIN_ACCELERATION)  # [s]
        while self.gap() > 3 * CONTROL_STEPS * COARSE_STEP_S * cue_speed:
            part = min(self.data.time / ramp, 1.0)
            self.step(cue_speed * (0.5 - 0.5 * np.cos(np.pi * part)), COARSE_STEP_S, CONTROL_STEPS)

    def hit(self, cue_speed: float, scene: LauncherScene) -> _Hit:
        """Go on in fine steps until the tip has left the ball, or has not touched it in 20 ms."""
        data, hit = self.data, _Hit(self.cue_speed(), self.cue_speed())
        alone, deadline = 0, data.time + 0.02
        while alone < RELEASE_STEPS and data.time < deadline:
            self.step(cue_speed, FINE_STEP_S)
            touch = self.touch()
            if touch is not None:
                normal, friction, sliding = touch
                hit.peak, hit.slip, hit.pushed = (
                    max(hit.peak, normal), hit.slip + sliding * FINE_STEP_S, hit.pushed + normal
                )  # fmt: skip
                hit.slipping += normal if friction > 0.98 * scene.tip_friction * normal else 0.0
                hit.steps, alone = hit.steps + 1, 0
            elif hit.steps:
                if alone == 0:
                    joint = data.joint(scene.name)
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
        return float(self.data.joint(f"{NAME_PREFIX}rack").qpos[0])


def strike(
    scene: LauncherScene, cue_speed: float, side: float = 0.0, height: float = 0.0, *, follow_through: bool = False
) -> SimulatedStroke:
    """Simulate a stroke from rest until the tip has left the ball.

    Args:
        scene: from `build_scene`; it is not changed.
        cue_speed: wanted at the hit [m/s], 0.2 to 3.2.
        side: of the cue axis from the ball's centre, to the right (x'0) [m], within +-25 mm.
        height: the same, up (y'0) [m].
        follow_through: go on until the rack has stopped, for the peaks of the drive.

    Raises:
        BadInput: the speed or an offset is out of range, or the cue misses the ball.
    """
    if not CUE_SPEED_RANGE[0] <= cue_speed <= CUE_SPEED_RANGE[1]:
        raise BadInput(f"cue_speed is {cue_speed} m/s; the drive allows {CUE_SPEED_RANGE[0]} to {CUE_SPEED_RANGE[1]}")
    for name, value, most in (("side", side, STAGE_TRAVEL_M), ("height", height, STAGE_TRAVEL_M * np.cos(CUE_TILT))):
        if not abs(value) <= most:
            raise BadInput(f"{name} is {value} m; the stage travels +-{most:.4f} m")
    if np.hypot(side, height) >= scene.ball.radius + TIP_RADIUS:
        raise BadInput(f"side {side} m, height {height} m miss the ball; stay within {scene.ball.radius} m")
    machine = _Machine(scene, side, height)
    machine.run_up(cue_speed)
    hit = machine.hit(cue_speed, scene)
    if not hit.steps:
        raise BadInput(f"side {side} m, height {height} m miss the ball; stay within {scene.ball.radius} m")
    travel = machine.follow_through(cue_speed) if follow_through else np.nan
    spin = np.zeros(3)
    mujoco.mju_rotVecQuat(spin, hit.state[3:6], hit.state[6:10])  # a free joint turns about its own axes
    away = np.arctan2(hit.state[1], hit.state[0]) - scene.azimuth
    return SimulatedStroke(
        cue_speed=hit.cue_speed,
        cue_left=hit.cue_left,
        velocity=hit.state[:3].copy(),
        spin=spin,
        squirt=float(np.arctan2(np.sin(away), np.cos(away))),
        contact_time=hit.steps * FINE_STEP_S,
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
    scene: LauncherScene, shots: Iterable[tuple[float, float, float]], *, threads: int = 2
) -> list[SimulatedStroke]:
    """Many strokes, each (cue_speed, side, height) as in `strike`; the same whatever the number of threads."""
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(lambda shot: strike(scene, *shot), shots))
