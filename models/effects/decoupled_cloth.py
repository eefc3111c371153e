"""Slide, roll and sidespin on cloth, each with a friction of its own.

Sliding: force -mu_s N u/|u|, u the slip of the lowest point. Rolling: deceleration mu_r g of the ball and mu_r g / R
of its spin, so that it keeps rolling; what other effects push is shared by a reaction that keeps the slip at zero,
up to mu_s N. Sidespin: deceleration alpha, whatever the rest does. Source: Robotic Billiards (2015) section IV.B,
constants from Mathavan, Jackson, Parkin 2009. Other effects may change the friction by factors (Balls). Leaves out
that spin and slide share a finite contact patch (Contensou).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np
from numba import njit

from models.effect import Array, Balls, Effect, param, spread

STILL = 1e-8  # [m/s], below it a slip or a speed is none
STILL_SPIN = 1e-6  # [rad/s]
GRIP = 5e-5  # a slip that full friction ends in this time meets no less than that [s]
NEAR = 1e-6  # part of that slip within which it is reached
CREEP = 1e-3  # shortest step towards a stop under a push from the side [s]


@njit(cache=True)
def _forces(
    slide: Array, roll: Array, spin: Array, v: Array, w: Array, normal: Array, force: Array, torque: Array,
    slide_factor: Array, spin_factor: Array, m: float, r: float,
) -> None:  # fmt: skip
    inertia = 0.4 * m * r * r
    for s in range(v.shape[0]):
        for i in range(v.shape[1]):
            n = normal[s, i]
            fx, fy = force[s, i, 0], force[s, i, 1]
            x, y = v[s, i, 0] - r * w[s, i, 1], v[s, i, 1] + r * w[s, i, 0]
            slip = math.sqrt(x * x + y * y)
            speed = math.sqrt(v[s, i, 0] ** 2 + v[s, i, 1] ** 2)
            gx = gy = dx = dy = 0.0
            held = False
            if slip > STILL:
                friction = slide[s] * n
                # A slip that dies away would never end by itself: the last of it meets the full friction.
                if slip > 3.5 * friction / m * GRIP * (1.0 + NEAR):
                    friction *= slide_factor[s, i]
                gx, gy = -friction * x / slip, -friction * y / slip
            else:
                # Without friction the slip would change at push / M + torque x R / I; 2/7 M of that holds it at zero.
                hx = -2 / 7 * m * (fx / m - r / inertia * torque[s, i, 1])
                hy = -2 / 7 * m * (fy / m + r / inertia * torque[s, i, 0])
                need = math.sqrt(hx * hx + hy * hy)
                stick = min(1.0, slide[s] * n / need) if need > 0.0 else 1.0
                gx, gy = hx * stick, hy * stick
                if speed > STILL:
                    dx, dy = roll[s] * n * v[s, i, 0] / speed, roll[s] * n * v[s, i, 1] / speed
                elif math.sqrt((fx + gx) ** 2 + (fy + gy) ** 2) <= roll[s] * n:
                    # A ball at rest stays there until the push exceeds what rolling resistance can hold.
                    gx, gy, held = -fx, -fy, True
            force[s, i, 0] += gx - dx
            force[s, i, 1] += gy - dy
            if held:
                torque[s, i, 0] = torque[s, i, 1] = 0.0
            else:
                torque[s, i, 0] += r * gy + inertia / (m * r) * dy
                torque[s, i, 1] -= r * gx + inertia / (m * r) * dx
            if abs(w[s, i, 2]) > STILL_SPIN and n > 0.0:
                torque[s, i, 2] -= inertia * math.copysign(spin[s] * spin_factor[s, i], w[s, i, 2])


@njit(cache=True)
def _horizon(
    v: Array, w: Array, force: Array, torque: Array, slide: Array, slide_factor: Array, normal: Array, m: float,
    r: float,
) -> Array:  # fmt: skip
    inertia = 0.4 * m * r * r
    out = np.full(v.shape[:2], np.inf)
    for s in range(v.shape[0]):
        for i in range(v.shape[1]):
            ax, ay = force[s, i, 0] / m, force[s, i, 1] / m
            x, y = v[s, i, 0] - r * w[s, i, 1], v[s, i, 1] + r * w[s, i, 0]
            sliding = math.sqrt(x * x + y * y) > STILL
            if sliding:
                ax, ay = ax - r / inertia * torque[s, i, 1], ay + r / inertia * torque[s, i, 0]
            else:
                x, y = v[s, i, 0], v[s, i, 1]
            closing, size = -(x * ax + y * ay), x * x + y * y
            if size > STILL**2 and closing > 0.0:
                out[s, i] = size / closing
                if sliding and slide_factor[s, i] != 1.0:
                    slip = math.sqrt(size)
                    over = slip - 3.5 * slide[s] * normal[s, i] / m * GRIP
                    if over > NEAR * slip:
                        out[s, i] = over * slip / closing
                # A rolling ball pushed across its way never comes to an exact stop: steps do not shrink without end.
                if not sliding and abs(x * ay - y * ax) > 1e-6 * closing:
                    out[s, i] = max(out[s, i], CREEP)
            wz, dwz = w[s, i, 2], torque[s, i, 2] / inertia
            if abs(wz) > STILL_SPIN and wz * dwz < 0.0:
                out[s, i] = min(out[s, i], -wz / dwz)
    return out


@dataclass(frozen=True)
class DecoupledCloth(Effect):
    """Friction of the cloth, decoupled."""

    slide: float = param(
        0.2, off=0.0, unit="1", bounds=(0.05, 0.6), source="Mathavan 2009: 0.178 to 0.245 on a snooker table"
    )
    roll: float = param(0.0127, off=0.0, unit="1", bounds=(0.001, 0.05), source="Mathavan 2009: 0.0126 to 0.0128")
    spin: float = param(
        22.0, off=0.0, unit="rad/s^2", bounds=(1.0, 80.0), source="Robotic Billiards (2015), sidespin deceleration"
    )

    plain: ClassVar[bool] = True
    slot: ClassVar[str] = "cloth"
    last: ClassVar[bool] = True

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Leave MuJoCo the support alone."""
        for pair in spec.pairs:
            if pair.classname.name == "ball_bed":
                pair.condim = 1

    def forces(self, balls: Balls) -> None:
        """Friction force and torque of each regime."""
        _forces(
            *(spread(k, len(balls.normal)) for k in (self.slide, self.roll, self.spin)),
            balls.velocity, balls.spin, balls.normal, balls.force, balls.torque,
            balls.slide_factor, balls.spin_factor, balls.ball.mass, balls.ball.radius,
        )  # fmt: skip

    def horizon(self, balls: Balls) -> Array:
        """Time to the next switch: end of slide, of roll, of sidespin: (nsim, nball) [s]."""
        return _horizon(
            balls.velocity, balls.spin, balls.force, balls.torque, spread(self.slide, len(balls.normal)),
            balls.slide_factor, balls.normal, balls.ball.mass, balls.ball.radius,
        )  # fmt: skip
