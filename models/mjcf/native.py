"""MuJoCo's own contacts, tuned as far as their terms allow, for contacts that no effect replaces.

Cloth: one condim-6 contact with slide mu_s, torsional (2/5) R^2 alpha / g and rolling (7/5) mu_r R [m]. Each is right
alone, but all of them share ONE elliptic cone, so a spinning ball slides with too little friction.
Impacts: a spring and damper along the normal, solref = (-k, -b), whose contact ends at zero force after T_c:
e = exp(-z / sqrt(1 - z^2) (pi - atan2(2 z sqrt(1 - z^2), 1 - 2 z^2))), k = (pi / T_c)^2 / (1 - z^2), b = 2 z sqrt(k),
z the damping ratio. Friction at impacts is MuJoCo's convex approximation: it takes the slip away over a time constant
of its own (`grip`), and sliding pushes the bodies apart.
`sysid match` measures the errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import ClassVar

import mujoco
import numpy as np
from scipy.optimize import brentq

from models.effect import Effect, param
from models.shot import GRAVITY

TUNING_SOURCE = "sysid match --tune: nearest to the analytic models at the constants of Mathavan 2009, 2010, 2014"
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

    slide: float = param(0.2211, off=0.0, unit="1", bounds=(0.05, 0.6), source=TUNING_SOURCE)
    roll: float = param(0.01481, off=0.0, unit="1", bounds=(0.001, 0.05), source=TUNING_SOURCE)
    spin: float = param(31.33, off=0.0, unit="rad/s^2", bounds=(1.0, 80.0), source=TUNING_SOURCE)
    ball_restitution: float = param(0.8941, off=0.0, unit="1", bounds=(0.5, 0.999), source=TUNING_SOURCE)
    ball_friction: float = param(0.05263, off=0.0, unit="1", bounds=(0.0, 0.5), source=TUNING_SOURCE)
    cushion_restitution: float = param(0.8981, off=0.0, unit="1", bounds=(0.3, 0.999), source=TUNING_SOURCE)
    cushion_friction: float = param(0.1751, off=0.0, unit="1", bounds=(0.0, 0.43), source=TUNING_SOURCE)
    ball_grip: float = param(0.001965, off=0.02, unit="s", bounds=(2e-4, 0.05), source=TUNING_SOURCE)
    cushion_grip: float = param(0.001575, off=0.02, unit="s", bounds=(2e-4, 0.05), source=TUNING_SOURCE)

    slot: ClassVar[str] = "native"

    def is_off(self) -> bool:
        """False: this is the MJCF itself."""
        return False

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Write friction and restitution into the pairs, by class."""
        radius = spec.geom(spec.pairs[0].geomname1).size[0]
        cloth = [self.slide, self.slide, 0.4 * radius**2 * self.spin / GRAVITY, *2 * [1.4 * self.roll * radius]]
        hits = {
            "ball_ball": (self.ball_friction, self.ball_restitution, self.ball_grip),
            "ball_cushion": (self.cushion_friction, self.cushion_restitution, self.cushion_grip),
        }
        for pair in spec.pairs:
            kind = pair.classname.name
            if kind == "ball_bed":
                pair.friction = cloth
            else:
                friction, restitution, grip = hits[kind]
                pair.friction = [friction, friction, 0, 0, 0]
                pair.solref = solref(float(restitution))
                pair.solreffriction = [grip, 1.0]
