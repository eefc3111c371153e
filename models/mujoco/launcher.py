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
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from models.errors import BadInput
from models.mjcf.launcher import (
    CUE_SPEED_RANGE,
    NAME_PREFIX,
    STAGE_TRAVEL_M,
    TIP_RADIUS,
    CueProperties,
    attach_launcher,
)
from models.mjcf.stroke import CUE_TILT
from models.mujoco import memory as mem
from models.mujoco.drive import LAUNCHER_STEP_S, Stroke
from models.shot import UNKNOWN_SESSION, Array, Session

if TYPE_CHECKING:
    from models.mujoco.world import World

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
        data.userdata[:] = mem.at_strike(row, data.time, 0.0, session, len(data.userdata))
        machine = Stroke(self.name, self.device, copy.copy(self.model), data, side, height)
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
