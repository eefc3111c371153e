"""Slide, roll and sidespin on cloth, each with a friction of its own.

Sliding: force -mu_s N u/|u|, u the slip of the lowest point. Rolling: deceleration mu_r g of the ball and mu_r g / R
of its spin, so that it keeps rolling; what other effects push is shared by a reaction that keeps the slip at zero,
up to mu_s N. Sidespin: deceleration alpha, whatever the rest does. Source: Robotic Billiards (2015) section IV.B,
constants from Mathavan, Jackson, Parkin 2009. Leaves out that spin and slide share a finite contact patch (Contensou).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import mujoco
import numpy as np

from models.effect import Array, Balls, Effect, column, param

STILL = 1e-8  # [m/s], below it a slip or a speed is none
STILL_SPIN = 1e-6  # [rad/s]
CREEP = 1e-3  # shortest step towards a stop under a push from the side [s]


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

    slot: ClassVar[str] = "cloth"
    last: ClassVar[bool] = True

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Leave MuJoCo the support alone."""
        for pair in spec.pairs:
            if pair.classname.name == "ball_bed":
                pair.condim = 1

    def forces(self, balls: Balls) -> None:
        """Friction force and torque of each regime."""
        m, r, inertia = balls.ball.mass, balls.ball.radius, balls.ball.inertia
        grip = column(self.slide) * balls.normal
        slip = balls.slip
        slip_speed = np.hypot(slip[..., 0], slip[..., 1])
        sliding = slip_speed > STILL
        # Without friction the slip would change at push / M + torque x R / I; 2/7 M of that holds it at zero.
        drift = balls.force[..., :2] / m
        drift = drift + r / inertia * np.stack([-balls.torque[..., 1], balls.torque[..., 0]], axis=-1)
        hold = -2 / 7 * m * drift
        need = np.hypot(hold[..., 0], hold[..., 1])
        rub = slip / np.where(sliding, slip_speed, 1.0)[..., None]
        stick = np.minimum(1.0, grip / np.where(need > 0, need, 1.0))
        friction = np.where(sliding[..., None], -grip[..., None] * rub, hold * stick[..., None])

        speed = np.hypot(balls.velocity[..., 0], balls.velocity[..., 1])
        rolling = ~sliding & (speed > STILL)
        heading = balls.velocity[..., :2] / np.where(rolling, speed, 1.0)[..., None]
        drag = np.where(rolling, column(self.roll) * balls.normal, 0.0)[..., None] * heading

        # A ball at rest stays there until the push exceeds what rolling resistance can hold.
        push = np.hypot(*np.moveaxis(balls.force[..., :2] + friction, -1, 0))
        held = ~sliding & ~rolling & (push <= column(self.roll) * balls.normal)
        friction = np.where(held[..., None], -balls.force[..., :2], friction)

        wz = balls.spin[..., 2]
        turn = np.where(np.abs(wz) > STILL_SPIN, -np.sign(wz), 0.0) * column(self.spin) * (balls.normal > 0)
        balls.force[..., :2] += friction - drag
        balls.torque[..., 0] += r * friction[..., 1] + inertia / (m * r) * drag[..., 1]
        balls.torque[..., 1] += -r * friction[..., 0] - inertia / (m * r) * drag[..., 0]
        balls.torque[..., :2] = np.where(held[..., None], 0.0, balls.torque[..., :2])
        balls.torque[..., 2] += inertia * turn

    def horizon(self, balls: Balls) -> Array:
        """Time to the next switch: end of slide, of roll, of sidespin: (nsim, nball) [s]."""
        m, r, inertia = balls.ball.mass, balls.ball.radius, balls.ball.inertia
        slip = balls.slip
        a = balls.force[..., :2] / m
        du = a + r / inertia * np.stack([-balls.torque[..., 1], balls.torque[..., 0]], axis=-1)
        sliding = np.hypot(slip[..., 0], slip[..., 1]) > STILL
        v = balls.velocity[..., :2]
        value = np.where(sliding[..., None], slip, v)
        rate = np.where(sliding[..., None], du, a)
        closing = -np.sum(value * rate, axis=-1)
        size = np.sum(value * value, axis=-1)
        moving = (size > STILL**2) & (closing > 0)
        end = np.where(moving, size / np.where(moving, closing, 1.0), np.inf)
        # A rolling ball pushed across its way never comes to an exact stop: steps do not shrink without end.
        across = np.abs(value[..., 0] * rate[..., 1] - value[..., 1] * rate[..., 0])
        bent = ~sliding & (across > 1e-6 * closing)
        end = np.where(bent, np.maximum(end, CREEP), end)
        wz, dwz = balls.spin[..., 2], balls.torque[..., 2] / inertia
        spinning = (np.abs(wz) > STILL_SPIN) & (wz * dwz < 0)
        return np.minimum(end, np.where(spinning, -wz / np.where(spinning, dwz, 1.0), np.inf))
