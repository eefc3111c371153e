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

from models.shot import Ball, Track

Array = NDArray[np.float64]
CLIMB = 0.43  # friction of a cushion above which a ball would climb its nose (tan of the nose's elevation: 0.436)
STILL = 1e-6  # speed or slip below which there is none [m/s]


def param(default: float, *, off: float | None, unit: str, bounds: tuple[float, float], source: str) -> Any:
    """Declare a parameter: its usual value, the value at which it vanishes, its unit, bounds and source.

    A parameter that only shapes the effect, and vanishes at no value of its own, has `off` None.
    """
    return dataclasses.field(default=default, metadata={"off": off, "unit": unit, "bounds": bounds, "source": source})


@dataclass
class Balls:
    """The balls of every simulation, as the `forces` door sees them; force and torque sum up what acts so far.

    The factors are on the cloth's friction, 1 but for what effects make of them.
    """

    ball: Ball
    position: Array  # (nsim, nball, 3) [m]
    velocity: Array  # (nsim, nball, 3) [m/s]
    spin: Array  # (nsim, nball, 3) [rad/s], table frame
    normal: Array  # (nsim, nball) [N], cloth on ball
    force: Array  # (nsim, nball, 3) [N]
    torque: Array  # (nsim, nball, 3) [N m]
    slide_factor: Array  # (nsim, nball) [1], on the friction of a sliding ball
    spin_factor: Array  # (nsim, nball) [1], on the sidespin's deceleration
    alive: NDArray[np.bool_]  # (nsim, nball), which are not potted
    rolled: Array  # (nsim, nball) [rad], turned about the horizontal while rolling, since t = 0
    time: Array  # (nsim,) [s], since t = 0
    launch: Array  # (nsim,) [m/s], speed of the struck ball, which is number 0, at t = 0; 0 if it was not struck then
    order: Array  # (nsim,), place of the shot in its session, 0 to 1

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
    friction: Array  # (n,), Coulomb, at a slip that is fast
    gain: Array  # (n,), what a slip that ends adds to that: gain exp(-decay slip), two balls only
    decay: Array  # (n,) [s/m], at the slip of every moment of the impact
    mass: Array  # (n, 2), of the two bodies over that of `ball`, the inertia with it; not used of a rail
    order: Array  # (n,), place of the shot in its session, 0 to 1

    @property
    def ratio(self) -> Array:
        """Mass of the first ball over that of the second: (n,)."""
        return self.mass[:, 0] / self.mass[:, 1]

    def hold(self) -> None:
        """Keep the coefficients where the impact models hold, after all effects have had their say."""
        np.clip(self.restitution, 0.0, 1.0, out=self.restitution)
        np.clip(self.friction, 0.0, CLIMB if self.kind == "cushion" else np.inf, out=self.friction)


@cache
def _parameters(kind: type[Effect]) -> dict[str, dict[str, Any]]:
    return {f.name: {**f.metadata, "default": f.default} for f in dataclasses.fields(kind)}


@dataclass(frozen=True)
class Effect:
    """Base of all effects: every door is open and does nothing."""

    slot: ClassVar[str] = ""  # effects of one slot replace each other; "" adds to the others
    first: ClassVar[bool] = False  # it says what the cloth carries, before the others push
    last: ClassVar[bool] = False  # its forces react to what the others apply
    varies: ClassVar[bool] = False  # its forces change along a step, and are followed by a curve; see `horizon`
    plain: ClassVar[bool] = False  # its edit of the MJCF is the same whatever its parameters
    resolves: ClassVar[str] = ""  # the kind of impact whose contact it takes over from MuJoCo: "ball" or "cushion"

    @classmethod
    def name(cls) -> str:
        """The class's name in snake case, as model files and commands use it."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @classmethod
    def parameters(cls) -> dict[str, dict[str, Any]]:
        """Metadata of every parameter: name -> off, unit, bounds, source, default."""
        return _parameters(cls)  # type: ignore[arg-type] # dataclasses hide that classes hash

    @classmethod
    def opens(cls, *doors: str) -> bool:
        """Whether it does something at any of these doors."""
        return any(getattr(cls, door) is not getattr(Effect, door) for door in doors)

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
        """Add forces and torques to `balls.force` and `balls.torque`, or change the factors on the cloth's friction.

        Where they change along a step (`varies`), they must do so smoothly but where `horizon` says.
        """

    def horizon(self, balls: Balls) -> Array | float:
        """How long until these forces switch: (nsim,) or (nsim, nball) [s]. What varies smoothly needs none."""
        return np.inf

    def impact(self, impact: Impact, rows: Any) -> None:
        """Change what `impact` says from `restitution` on; `rows` (n,) are the simulations the impacts belong to."""

    def strike(self, ball: Ball, velocity: Array, spin: Array) -> tuple[Array, Array]:
        """What the cue really delivers to the struck ball, the first of every shot, for what was commanded.

        Velocity (nsim, 2) [m/s] and spin (nsim, 3) [rad/s], in and out.
        """
        return velocity, spin

    def exposures(self, stamps: Array) -> Array:
        """When the camera really looked, for the time stamps that it reports: (n,) [s], of one simulation.

        Here and in `observe` every parameter is one number.
        """
        return stamps

    def observe(self, track: Track) -> Track:
        """What the camera reports of what happened in one simulation: the track with other positions.

        Its times are the true ones, its velocities are at hand, a potted ball is NaN.
        """
        return track


def of(value: Any, rows: Any) -> Any:
    """A parameter's values in some simulations: itself where it is one number."""
    return value[rows] if np.ndim(value) else value


def column(value: Any) -> Any:
    """A parameter shaped to multiply (nsim, nball) arrays."""
    return np.asarray(value)[:, None] if np.ndim(value) else value


def spread(value: Any, count: int) -> Array:
    """A parameter's values in `count` simulations: (count,)."""
    return np.full(count, value, float) if np.ndim(value) == 0 else np.asarray(value, float)
