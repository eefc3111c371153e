"""The effect: one physical idea, its parameters with unit, bounds and source, and the doors it uses.

An effect is a frozen dataclass in a file of its own in `models/effects/` (or in a user's folder). State arrays are
(nsim, nball, 3); a parameter is one number or an (nsim,) array, so that one batch runs many variants. Where all its
parameters are at their off values an effect is left out of the world, so that off is absence to the last bit.
"""

from __future__ import annotations

import dataclasses
import re
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from models.shot import Ball

Array = NDArray[np.float64]
STILL = 1e-6  # speed or slip below which there is none [m/s]


def param(default: float, *, off: float | None, unit: str, bounds: tuple[float, float], source: str) -> Any:
    """Declare a parameter: its usual value, the value at which it vanishes, its unit, bounds and source.

    A parameter that only shapes the effect, and vanishes at no value of its own, has `off` None.
    """
    return dataclasses.field(default=default, metadata={"off": off, "unit": unit, "bounds": bounds, "source": source})


@dataclass
class Balls:
    """The balls of every simulation, as the `forces` door sees them; force and torque sum up what acts so far."""

    ball: Ball
    position: Array  # (nsim, nball, 3) [m]
    velocity: Array  # (nsim, nball, 3) [m/s]
    spin: Array  # (nsim, nball, 3) [rad/s], table frame
    normal: Array  # (nsim, nball) [N], cloth on ball
    force: Array  # (nsim, nball, 3) [N]
    torque: Array  # (nsim, nball, 3) [N m]

    @property
    def slip(self) -> Array:
        """Velocity of each ball's lowest point over the cloth, v + omega x (-R z): (nsim, nball, 2) [m/s]."""
        r = self.ball.radius
        return self.velocity[..., :2] + r * np.stack([-self.spin[..., 1], self.spin[..., 0]], axis=-1)

    @property
    def rolling(self) -> NDArray[np.bool_]:
        """Which balls roll on the cloth, and move: (nsim, nball)."""
        slip, v = self.slip, self.velocity
        moving = np.hypot(v[..., 0], v[..., 1]) > STILL
        return (np.hypot(slip[..., 0], slip[..., 1]) < STILL) & moving & (self.normal > 0)

    def push_rolling(self, acceleration: Array) -> None:
        """Add a force that changes the velocity by (nsim, nball, 2) [m/s^2], and the torque that keeps it rolling."""
        m, r, inertia = self.ball.mass, self.ball.radius, self.ball.inertia
        self.force[..., :2] += m * acceleration
        self.torque[..., 0] -= inertia / r * acceleration[..., 1]
        self.torque[..., 1] += inertia / r * acceleration[..., 0]


@dataclass
class Impact:
    """Contacts about to happen, one row each; restitution and friction sum up what the effects say of them."""

    kind: str  # "ball" or "cushion"
    ball: Ball
    approach: Array  # (n,) [m/s], normal approach speed; for a cushion the horizontal one
    slip: Array  # (n,) [m/s], tangential slip speed at the contact
    position: Array  # (n, 2) [m], of the ball, or of the first of two
    velocity: Array  # (n, 2) [m/s], of the same ball
    first: NDArray[np.int64]  # (n,) number of that ball; 0 is the struck one
    second: NDArray[np.int64]  # (n,) number of the other ball, or of the rail: +x, -x, +y, -y
    restitution: Array  # (n,), energetic: square root of the work given back over the work done
    friction: Array  # (n,), Coulomb


@cache
def _parameters(kind: type[Effect]) -> dict[str, dict[str, Any]]:
    return {f.name: {**f.metadata, "default": f.default} for f in dataclasses.fields(kind)}


@dataclass(frozen=True)
class Effect:
    """Base of all effects: every door is open and does nothing."""

    slot: ClassVar[str] = ""  # effects of one slot replace each other; "" adds to the others
    last: ClassVar[bool] = False  # its forces react to what the others apply
    varies: ClassVar[bool] = False  # its forces change along a step: they are taken at its middle; see `horizon`
    resolves: ClassVar[str] = ""  # the kind of impact whose contact it takes over from MuJoCo: "ball" or "cushion"

    @classmethod
    def name(cls) -> str:
        """The class's name in snake case, as model files and commands use it."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @classmethod
    def parameters(cls) -> dict[str, dict[str, Any]]:
        """Metadata of every parameter: name -> off, unit, bounds, source, default."""
        return _parameters(cls)  # type: ignore[arg-type] # dataclasses hide that classes hash

    def is_off(self) -> bool:
        """True where every parameter that has an off value stands at it in every simulation."""
        known = {k: m["off"] for k, m in self.parameters().items() if m["off"] is not None}
        return all(bool(np.all(getattr(self, k) == off)) for k, off in known.items())

    def select(self, index: Any) -> Effect:
        """The effect with per-simulation parameters narrowed to some simulations."""
        arrays = {k: v[index] for k in self.parameters() if np.ndim(v := getattr(self, k))}
        return dataclasses.replace(self, **arrays) if arrays else self

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Change the MJCF before it is compiled."""

    def forces(self, balls: Balls) -> None:
        """Add forces and torques to `balls.force` and `balls.torque`."""

    def horizon(self, balls: Balls) -> Array | float:
        """How long these forces stay as they are, or vary so little that the middle of a step stands for all of it.

        (nsim,) or (nsim, nball) [s].
        """
        return np.inf

    def impact(self, impact: Impact, rows: Any) -> None:
        """Change `impact.restitution` and `impact.friction`; `rows` (n,) are the simulations the impacts belong to."""

    def strike(self, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """What the cue really delivers, (n, 2) and (n, 3), for the velocity and spin commanded."""
        return velocity, spin

    def observe(self, times: Array, xy: Array) -> tuple[Array, Array]:
        """What the camera reports, (n,) and (n, nball, 2), for what happened."""
        return times, xy


def of(value: Any, rows: Any) -> Any:
    """A parameter's values in some simulations: itself where it is one number."""
    return value[rows] if np.ndim(value) else value


def column(value: Any) -> Any:
    """A parameter shaped to multiply (nsim, nball) arrays."""
    return np.asarray(value)[:, None] if np.ndim(value) else value


def spread(value: Any, count: int) -> Array:
    """A parameter's values in `count` simulations: (count,)."""
    return np.full(count, value, float) if np.ndim(value) == 0 else np.asarray(value, float)
