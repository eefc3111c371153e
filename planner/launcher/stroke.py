"""Strokes in physical terms, and the launcher's commands for them.

In: strokes q = (speed, azimuth, side, height): horizontal ball speed [m/s], aim [rad], contact point [m]; several are
(n, 4). Out: the cue ball's velocity and spin, the launcher's command, and the strokes that it can play.

The ball starts with velocity v along the aim and spin omega = 5 v / (2 R^2) (swerve along the aim, height to the left
of it, side upwards). The swerve is side sin(el), as in the cue commands of clips
(sysid/estimation/states/start_values.py), where a cueing map does not say more. A fitted squirt effect then acts on
this in the model.

The axis of the cue lies (R + r_t) / R farther out than the contact; the cue's speed is V_C = v (1 + M / M_C + 5/2
rho^2) / ((1 + e) cos(el)); the speed string NNN commands V_C = 2.75 - 0.012312 (NNN - 1) m/s, the line through the
paper's two figures ('001p' 2.75, '200p' 0.30 m/s). If the model has no squirt effect, the cue is turned against the
squirt of models/analytic/cueing.py. Sources: Robotic Billiards (2015), Alciatore TP A.31. Left out: the loss of some
4 % of the speed to the slate, which a cueing map contains (planner/launcher/mapped.py).
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.analytic import cueing
from models.model_file import Model
from models.shot import Ball

Array = NDArray[np.float64]
SPEED, AZIMUTH, SIDE, HEIGHT = range(4)


@dataclass(frozen=True)
class LauncherModel:
    """The planner's model of the launcher: bounds and resolution of strokes, gain of the cue."""

    cue: cueing.CueStick = field(default_factory=cueing.CueStick)
    slowest: float = 0.3  # least cue speed [m/s]; that of '200p' (Robotic Billiards 2015)
    fastest: float = 2.2  # greatest cue speed [m/s]; the paper's bound on planned shots, its launcher goes up to 2.75
    first: float = 2.75  # cue speed of string '001p' [m/s]
    last: float = 0.30  # cue speed of string '200p' [m/s]
    offset: float = cueing.SEED_LIMIT  # greatest contact offset over the ball's radius; beyond it the tip slips
    step: float = 1e-4  # resolution of the stage [m]

    @property
    def elevation(self) -> float:
        """Elevation of the cue [rad]."""
        return self.cue.elevation

    def max_offset(self, ball: Ball) -> float:
        """Greatest contact offset from the ball's centre [m]."""
        return self.offset * ball.radius

    def gain(self, q: Array, ball: Ball) -> Array:
        """Ball speed, horizontal, over cue speed: (n,)."""
        rho2 = (q[:, SIDE] ** 2 + q[:, HEIGHT] ** 2) / ball.radius**2
        top = (1.0 + self.cue.tip_restitution) * math.cos(self.elevation)
        return np.asarray(top / (1.0 + ball.mass / self.cue.mass + 2.5 * rho2))

    def swerve(self, q: Array) -> Array:
        """Offset that stands for the spin about the aim, which bends the ball's path: (n,) [m]."""
        return np.asarray(q[:, SIDE] * math.sin(self.elevation))

    def launch(self, q: Array, ball: Ball) -> tuple[Array, Array]:
        """Velocity (n, 2) [m/s] and spin (n, 3) [rad/s] of the cue ball just after strokes (n, 4)."""
        return launch(q, self.swerve(q), ball)

    def allowed(self, q: Array, ball: Ball, room: float = 0.0) -> NDArray[np.bool_]:
        """Which strokes are within the bounds of cue speed, and `room` [m] or more within that of the offset: (n,)."""
        cue_speed = q[:, SPEED] / self.gain(q, ball)
        offset = np.hypot(q[:, SIDE], q[:, HEIGHT])
        slack = 1e-9
        no_miscue = offset <= self.offset * ball.radius - room + slack
        return np.asarray(no_miscue & (cue_speed >= self.slowest - slack) & (cue_speed <= self.fastest + slack))

    def string(self, cue_speed: float) -> int:
        """Number of the speed string that is nearest to a cue speed [m/s], within the bounds of cue speed."""
        slope = (self.first - self.last) / 199
        lowest, highest = (math.ceil((self.first - v) / slope - 1e-9) + 1 for v in (self.fastest, self.slowest))
        return min(max(round((self.first - cue_speed) / slope) + 1, lowest, 1), highest, 200)

    def cue_speed(self, string: int) -> float:
        """Cue speed of a string's number [m/s]."""
        return self.first - (self.first - self.last) / 199 * (string - 1)

    def playable(self, q: Array, ball: Ball) -> Array:
        """The nearest strokes that speed strings and stage steps can play: (n, 4)."""
        out = np.array(q, float)
        lever = ball.radius / (ball.radius + self.cue.tip_radius)
        offsets = [SIDE, HEIGHT]
        out[:, offsets] = np.round(q[:, offsets] / lever / self.step) * self.step * lever
        beyond = np.hypot(out[:, SIDE], out[:, HEIGHT]) > self.offset * ball.radius
        inward = np.trunc(q[:, offsets] / lever / self.step) * self.step * lever
        out[:, offsets] = np.where(beyond[:, None], inward, out[:, offsets])
        gain = self.gain(out, ball)
        out[:, SPEED] = gain * [self.cue_speed(self.string(float(v))) for v in q[:, SPEED] / gain]
        return out

    def command(self, model: Model, q: Array) -> dict[str, Any]:
        """The launcher's command for one stroke (4,), as entries of a plan file."""
        ball = model.ball
        cue_speed = float(q[SPEED] / self.gain(q[None], ball)[0])
        in_model = any(effect.slot == "squirt" or effect.name() == "squirt" for effect in model.effects)
        a, b = q[SIDE] / ball.radius, q[HEIGHT] / ball.radius
        squirt = 0.0 if in_model else cueing.squirt(float(a), float(b), ball.mass / self.cue.end_mass)
        axis = (ball.radius + self.cue.tip_radius) / ball.radius
        return self.plan_entries(q, cue_speed, float(axis * q[SIDE]), float(axis * q[HEIGHT]), squirt)

    def plan_entries(self, q: Array, cue_speed: float, x0: float, y0: float, squirt: float) -> dict[str, Any]:
        """The entries of a plan file for a stroke (4,), from cue speed [m/s], stage [m] and the ball's squirt [rad]."""
        theta = math.remainder(float(q[AZIMUTH]) - squirt, 2 * math.pi)
        return {
            "string": f"{self.string(cue_speed):03d}p", "x0_mm": round(1e3 * x0, 3) + 0.0,
            "y0_mm": round(1e3 * y0, 3) + 0.0, "theta": theta, "theta_deg": round(math.degrees(theta), 3),
            "cue_speed": cue_speed, "squirt": squirt, "swerve": float(self.swerve(q[None])[0]),
        }  # fmt: skip


def launch(q: Array, swerve: Array, ball: Ball) -> tuple[Array, Array]:
    """Velocity (n, 2) [m/s] and spin (n, 3) [rad/s] of the cue ball just after strokes (n, 4) of a swerve (n,) [m]."""
    aim = np.stack([np.cos(q[:, AZIMUTH]), np.sin(q[:, AZIMUTH])], axis=-1)
    left = np.stack([-aim[:, 1], aim[:, 0]], axis=-1)
    lever = 2.5 * q[:, SPEED] / ball.radius**2
    flat = (lever * swerve)[:, None] * aim + (lever * q[:, HEIGHT])[:, None] * left
    return q[:, SPEED, None] * aim, np.concatenate([flat, (lever * q[:, SIDE])[:, None]], axis=-1)


def stroke_terms(launcher: LauncherModel, q: Array) -> dict[str, float]:
    """The entries of one stroke (4,) in a plan file."""
    names = ("speed", "azimuth", "side", "height")
    out = {name: float(value) for name, value in zip(names, q, strict=True)}
    out["azimuth"] = math.remainder(out["azimuth"], 2 * math.pi)
    return out | {"elevation": launcher.elevation}


def with_speeds(launcher: LauncherModel, slowest: float, fastest: float) -> LauncherModel:
    """The launcher with other bounds on its cue's speed [m/s]."""
    return dataclasses.replace(launcher, slowest=slowest, fastest=fastest)
