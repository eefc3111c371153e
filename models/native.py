"""MuJoCo's own contact, tuned as far as its terms allow: what acts where no effect takes a contact over.

Cloth: one condim-6 contact with slide mu_s, torsional (2/5) R^2 alpha / g and rolling (7/5) mu_r R [m]. Each is right
on its own, but all of them share ONE elliptic cone, so a spinning ball slides with too little friction.
Impacts: a spring and damper along the normal, solref = (-k, -b), whose contact ends at zero force after T_c:
e = exp(-z / sqrt(1 - z^2) (pi - atan2(2 z sqrt(1 - z^2), 1 - 2 z^2))), k = (pi / T_c)^2 / (1 - z^2), b = 2 z sqrt(k),
z the damping ratio. Friction at impacts is MuJoCo's convex approximation and comes out too small.
`python -m models.native` measures how far off all this is.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import mujoco
import numpy as np
from scipy.optimize import brentq

from models.effect import Effect, param
from models.shot import Ball

GRAVITY = 9.81  # [m/s^2]
CONTACT_TIME = 2e-3  # of an impact [s]: 20 steps of the MJCF; real balls 0.2 to 0.3 ms, cushions some 8 ms


@lru_cache(maxsize=4096)
def solref(restitution: float) -> tuple[float, float]:
    """MuJoCo's direct solref (-stiffness, -damping) for a restitution between 0 and 1."""

    def rebound(z: float) -> float:
        s = np.sqrt(1 - z * z)
        return float(np.exp(-z / s * (np.pi - np.arctan2(2 * z * s, 1 - 2 * z * z))))

    z = brentq(lambda z: rebound(z) - np.clip(restitution, 0.05, 0.9999), 1e-7, 0.999)
    k = (np.pi / CONTACT_TIME) ** 2 / (1 - z * z)
    return -k, -2 * z * np.sqrt(k)


@dataclass(frozen=True)
class Native(Effect):
    """The terms of the MJCF's contacts."""

    slide: float = param(
        0.2, off=0.0, unit="1", bounds=(0.05, 0.6), source="Mathavan 2009: 0.178 to 0.245 on a snooker table"
    )
    roll: float = param(0.0127, off=0.0, unit="1", bounds=(0.001, 0.05), source="Mathavan 2009: 0.0126 to 0.0128")
    spin: float = param(
        22.0, off=0.0, unit="rad/s^2", bounds=(1.0, 80.0), source="Robotic Billiards (2015), sidespin deceleration"
    )
    ball_restitution: float = param(
        0.92, off=0.0, unit="1", bounds=(0.5, 0.999), source="Mathavan 2014: 0.89; pool 0.92-0.98"
    )
    ball_friction: float = param(0.05, off=0.0, unit="1", bounds=(0.0, 0.5), source="Mathavan 2014")
    cushion_restitution: float = param(
        0.9, off=0.0, unit="1", bounds=(0.3, 0.999), source="Mathavan 2010: 0.98 energetic"
    )
    cushion_friction: float = param(0.14, off=0.0, unit="1", bounds=(0.0, 0.43), source="Mathavan 2010")

    slot: ClassVar[str] = "native"

    def is_off(self) -> bool:
        """Never: this is the MJCF itself."""
        return False

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Write friction and restitution into the pairs, by class."""
        radius = spec.geom(spec.pairs[0].geomname1).size[0]
        cloth = [self.slide, self.slide, 0.4 * radius**2 * self.spin / GRAVITY, *2 * [1.4 * self.roll * radius]]
        hits = {
            "ball_ball": (self.ball_friction, self.ball_restitution),
            "ball_cushion": (self.cushion_friction, self.cushion_restitution),
        }
        for pair in spec.pairs:
            kind = pair.classname.name
            if kind == "ball_bed":
                pair.friction = cloth
            else:
                friction, restitution = hits[kind]
                pair.friction = [friction, friction, 0, 0, 0]
                pair.solref = solref(float(restitution))


def main() -> None:
    """Print how far native contact ends from the exact effects, shot by shot."""
    from models.model_file import Model, full_model
    from models.shot import Shot, Table
    from models.simulate import simulate

    ball, wide = Ball(0.0525, 0.1406), Table(40.0, 40.0, pockets=False)
    slide, roll, spin = 0.2, 0.0135, 22.0
    exact = full_model(wide, ball).with_values(
        {"decoupled_cloth.slide": slide, "decoupled_cloth.roll": roll, "decoupled_cloth.spin": spin}
    )
    native = Model(wide, ball, Native(slide=slide, roll=roll, spin=spin))
    times = np.linspace(0, 3, 301)
    print("cloth, 3 s: largest distance between native contact and the decoupled law [mm]")
    for name, speed, w in (
        ("stun 2 m/s", 2.0, (0.0, 0.0, 0.0)),
        ("2 m/s, side 60 rad/s", 2.0, (0.0, 0.0, 60.0)),
        ("rolling 1 m/s", 1.0, (0.0, 1.0 / ball.radius, 0.0)),
        ("swerve 2 m/s, (30, 0, 60) rad/s", 2.0, (30.0, 0.0, 60.0)),
    ):
        shot = Shot(("white",), np.zeros((1, 2)), np.array([[speed, 0.0]]), np.array([w]), times)
        far = simulate(native, [shot])[0].position - simulate(exact, [shot])[0].position
        print(f"  {name:32} {1e3 * np.max(np.linalg.norm(far, axis=-1)):6.1f}")
    table = Table(2.0, 2.0, pockets=False)
    print("impacts at 1 m/s: velocity (x, y) after, native and by impulse [m/s]")
    half = np.radians(30)
    cue = -ball.diameter * np.array([np.cos(half), np.sin(half)])
    reach = float(table.reach(ball)[0])
    for name, places, v, spun in (
        ("30 degree cut, stun: object ball", [cue - [5e-4, 0], [0, 0]], [1, 0], [0, 0, 0]),
        ("cushion at 90 degrees, rolling", [[reach - 5e-4, 0]], [1, 0], [0, 1, 0]),
        ("cushion at 45 degrees, rolling", [[reach - 5e-4, 0]], [np.sqrt(0.5)] * 2, [-np.sqrt(0.5), np.sqrt(0.5), 0]),
    ):
        n = len(places)
        velocity, turn = np.zeros((n, 2)), np.zeros((n, 3))
        velocity[0], turn[0] = v, np.array(spun) / ball.radius
        shot = Shot(("white", "red")[:n], np.array(places, float), velocity, turn, np.array([0.0, 0.005]))
        full = full_model(table, ball).with_values(
            {"ball_impact.restitution": 0.89, "cushion_impact.restitution": 0.98}
        )
        contact = Model(table, ball, Native(ball_restitution=0.89, cushion_restitution=0.98))
        after = [simulate(model, [shot])[0].velocity[1, -1] for model in (contact, full)]
        print(f"  {name:32} ({after[0][0]:.3f}, {after[0][1]:.3f})  ({after[1][0]:.3f}, {after[1][1]:.3f})")


if __name__ == "__main__":
    main()
