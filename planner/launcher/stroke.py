"""Strokes, and what the launcher must be told to play them.

A stroke is q = (speed, azimuth, side, height): horizontal ball speed [m/s], aim [rad], contact point [m]; several are
(n, 4). The ball starts with velocity v along the aim and spin omega = 5 v / (2 R^2) (side sin(el) along the aim, height
to the left of it, side upwards), as the clips' cue commands are read (sysid/estimation/start_values.py); what a
fitted squirt makes of it is the model's affair.

In launcher terms: the axis of the cue lies (R + r_t) / R farther out than the contact; its speed is
V_C = v (1 + M / M_C + 5/2 rho^2) / ((1 + e) cos(el)); the string NNN asks for V_C = 2.75 - 0.012312 (NNN - 1) m/s, the
linear law through the paper's two figures ('001p' 2.75, '200p' 0.30 m/s). Where the model knows no squirt, the cue is
turned against the one of models/analytic/cueing.py. Sources: Robotic Billiards (2015), Alciatore TP A.31. Leaves out
what the slate takes, some 4 % of the speed: a cueing map knows it (planner/launcher/mapped.py).
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
class Launcher:
    """What strokes a launcher can play."""

    cue: cueing.CueStick = field(default_factory=cueing.CueStick)
    slowest: float = 0.3  # of the cue [m/s]; '200p' (Robotic Billiards 2015)
    fastest: float = 2.2  # of the cue [m/s]; the paper's bound on planned shots, its launcher reaches 2.75
    first: float = 2.75  # cue speed of '001p' [m/s]
    last: float = 0.30  # of '200p' [m/s]
    offset: float = cueing.SEED_LIMIT  # contact point over radius
    step: float = 1e-4  # of the stage [m]

    @property
    def elevation(self) -> float:
        """Of the cue [rad]."""
        return self.cue.elevation

    def gain(self, q: Array, ball: Ball) -> Array:
        """Ball speed, horizontal, over cue speed: (n,)."""
        rho2 = (q[:, SIDE] ** 2 + q[:, HEIGHT] ** 2) / ball.radius**2
        top = (1.0 + self.cue.tip_restitution) * math.cos(self.elevation)
        return np.asarray(top / (1.0 + ball.mass / self.cue.mass + 2.5 * rho2))

    def allowed(self, q: Array, ball: Ball, room: float = 0.0) -> NDArray[np.bool_]:
        """Which strokes are within its speeds, and `room` [m] or more within the offset that holds the tip: (n,)."""
        cue_speed = q[:, SPEED] / self.gain(q, ball)
        off = np.hypot(q[:, SIDE], q[:, HEIGHT])
        slack = 1e-9
        held = off <= self.offset * ball.radius - room + slack
        return np.asarray(held & (cue_speed >= self.slowest - slack) & (cue_speed <= self.fastest + slack))

    def string(self, cue_speed: float) -> int:
        """Number of the speed string that is nearest to a cue speed [m/s], within this launcher's range."""
        slope = (self.first - self.last) / 199
        least, most = (math.ceil((self.first - v) / slope - 1e-9) + 1 for v in (self.fastest, self.slowest))
        return min(max(round((self.first - cue_speed) / slope) + 1, least, 1), most, 200)

    def cue_speed(self, string: int) -> float:
        """Cue speed of a string's number [m/s]."""
        return self.first - (self.first - self.last) / 199 * (string - 1)

    def playable(self, q: Array, ball: Ball) -> Array:
        """The nearest strokes that strings and stage steps can ask for: (n, 4)."""
        out = np.array(q, float)
        lever = ball.radius / (ball.radius + self.cue.tip_radius)
        for k in (SIDE, HEIGHT):
            out[:, k] = np.round(q[:, k] / lever / self.step) * self.step * lever
        far = np.hypot(out[:, SIDE], out[:, HEIGHT]) > self.offset * ball.radius
        for k in (SIDE, HEIGHT):
            out[far, k] = np.trunc(q[far, k] / lever / self.step) * self.step * lever
        gain = self.gain(out, ball)
        asked = q[:, SPEED] / gain
        out[:, SPEED] = gain * [self.cue_speed(self.string(float(v))) for v in asked]
        return out

    def terms(self, model: Model, q: Array) -> dict[str, Any]:
        """What to tell the launcher for one stroke (4,)."""
        ball = model.ball
        cue_speed = float(q[SPEED] / self.gain(q[None], ball)[0])
        knows = any(effect.slot == "squirt" or effect.name() == "squirt" for effect in model.effects)
        a, b = q[SIDE] / ball.radius, q[HEIGHT] / ball.radius
        squirt = 0.0 if knows else cueing.squirt(float(a), float(b), ball.mass / self.cue.end_mass)
        axis = (ball.radius + self.cue.tip_radius) / ball.radius
        return self.told(cue_speed, float(axis * q[SIDE]), float(axis * q[HEIGHT]), float(q[AZIMUTH]), squirt)

    def told(self, cue_speed: float, x0: float, y0: float, azimuth: float, squirt: float) -> dict[str, Any]:
        """The entries of a plan file, from cue speed [m/s], stage [m], the ball's azimuth and its squirt [rad]."""
        theta = math.remainder(azimuth - squirt, 2 * math.pi)
        return {
            "string": f"{self.string(cue_speed):03d}p", "x0_mm": round(1e3 * x0, 3) + 0.0,
            "y0_mm": round(1e3 * y0, 3) + 0.0, "theta": theta, "theta_deg": round(math.degrees(theta), 3),
            "cue_speed": cue_speed, "squirt": squirt,
        }  # fmt: skip


def launch(q: Array, elevation: float, ball: Ball) -> tuple[Array, Array]:
    """Velocity (n, 2) [m/s] and spin (n, 3) [rad/s] that strokes give the cue ball."""
    aim = np.stack([np.cos(q[:, AZIMUTH]), np.sin(q[:, AZIMUTH])], axis=-1)
    left = np.stack([-aim[:, 1], aim[:, 0]], axis=-1)
    lever = 2.5 * q[:, SPEED] / ball.radius**2
    flat = (lever * q[:, SIDE] * math.sin(elevation))[:, None] * aim + (lever * q[:, HEIGHT])[:, None] * left
    return q[:, SPEED, None] * aim, np.concatenate([flat, (lever * q[:, SIDE])[:, None]], axis=-1)


def stroke_terms(launcher: Launcher, q: Array) -> dict[str, float]:
    """One stroke (4,) by names."""
    names = ("speed", "azimuth", "side", "height")
    out = {name: float(value) for name, value in zip(names, q, strict=True)}
    out["azimuth"] = math.remainder(out["azimuth"], 2 * math.pi)
    return out | {"elevation": launcher.elevation}


def with_speeds(launcher: Launcher, slowest: float, fastest: float) -> Launcher:
    """The launcher with other bounds on its cue's speed [m/s]."""
    return dataclasses.replace(launcher, slowest=slowest, fastest=fastest)
