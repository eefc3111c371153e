"""The ball's motion after a stroke, from one balance of impulses of cue, end of the shaft, ball and slate.

Axes: d along the cue, right and up across it. The tip's dome grips the ball at r = R (a right + b up - c d), with
(a, b) = offsets of the cue's axis over (R + r_t) and c^2 = 1 - a^2 - b^2. An impulse P of the tip moves the contact by
W P, ball and tip together:

    W = (1 + 5/2 (1 - n n)) / M + d d / M_C + (1 - d d) / m_e        n = r / R, M_C of the cue, m_e of its end

The end mass must follow the ball in both directions across the cue: that is squirt, and it costs spin (Cross 2008;
models/analytic/cueing.py has the part for side alone). Leather is a spring and a damper (Kelvin-Voigt), so a motion
of less inertia returns less: each eigenvector of W (eigenvalue l) has e^sqrt(l / l_0), l_0 = 1/M + 1/M_C that of a
centre hit. Hence W P + C J = V_C (1 + e(W)) d. J is the slate's impulse: the cue presses the ball down at
V sin(elevation) and the slate bears it meanwhile, N = -P_z, with Coulomb friction mu N against the slip of the lowest
point, which sticks where that is enough. C takes what the slate does to the contact, while the tip is still there and
makes up for most of it. While it is struck the ball turns by some omega T / 8 (half a sine of force, T long), and the
dome rolls outwards on it by R / (R + r_t) of that: (a, b) grow by a part 5/2 V c T / (8 (R + r_t)), more at speed.

Without end mass, slate and T this is V = (1 + e) V_C / (1 + M / M_C + 5/2 rho^2). Leaves out a slipping tip, bending
of the shaft beyond its end mass (its stiffness counts as some 2 % of it), and the hop after the hit. Constants of the
emulated launcher come back within a few per cent (tests/planner/test_cueing_map.py).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.effect import param
from models.shot import Ball

Array = NDArray[np.float64]
SLATE_ROUNDS = 14  # iterations of the slate's friction, see _with_slate
FULL_FRICTION_SLIP = 0.4  # slip that full friction removes, over the ball's speed: 7/2 sin(6.5 degrees)


@dataclass(frozen=True)
class Constants:
    """Constants of one launcher and one ball."""

    tip_restitution: float = param(
        0.75, off=0.0, unit="1", bounds=(0.3, 1.0), source="leather 0.71 to 0.75 (Alciatore)"
    )
    cue_mass: float = param(
        0.50, off=None, unit="kg", bounds=(0.2, 3.0), source="17 to 18 oz; a stiff drive adds to it"
    )
    end_mass: float = param(
        0.00703, off=1e-6, unit="kg", bounds=(1e-6, 0.05), source="M / m_e 12 to 30 (Alciatore TP B.1, Cross 2008)"
    )
    slate_friction: float = param(0.21, off=0.0, unit="1", bounds=(0.0, 0.8), source="Mathavan, Jackson, Parkin 2009")
    contact_time: float = param(
        8e-4, off=0.0, unit="s", bounds=(0.0, 3e-3), source="about 1 ms (Shepard 2001); 0.7 to 0.8 acts at e = 0.75"
    )
    side_zero: float = param(
        0.0, off=0.0, unit="m", bounds=(-5e-3, 5e-3), source="true less commanded; how it was zeroed"
    )
    height_zero: float = param(
        0.0, off=0.0, unit="m", bounds=(-5e-3, 5e-3), source="true less commanded; how it was zeroed"
    )
    aim_zero: float = param(0.0, off=0.0, unit="rad", bounds=(-0.1, 0.1), source="true less commanded, to the left")


CONSTANT_NAMES = tuple(f.name for f in dataclasses.fields(Constants))


@dataclass(frozen=True)
class Geometry:
    """The known sizes and masses of tip, cue and ball."""

    ball: Ball
    tip_radius: float = 0.010  # of the dome [m]; Robotic Billiards 2015
    elevation: float = float(np.radians(6.5))  # [rad]; Robotic Billiards 2015

    @property
    def lever(self) -> float:
        """Contact point over offset of the cue's axis [1]."""
        return self.ball.radius / (self.ball.radius + self.tip_radius)


def launch(
    constants: Constants, geometry: Geometry, cue_speed: Array, side: Array, height: Array
) -> tuple[Array, Array]:
    """Velocity and spin of the ball as the tip leaves it.

    Args:
        constants: of the launcher; its zeros count for offsets and aim.
        geometry: of tip and ball.
        cue_speed: along its axis as it hits (n,) [m/s].
        side: of the cue's axis as commanded to the stage, to the right (n,) [m].
        height: the same, up (n,) [m].

    Returns:
        Velocity (n, 3) [m/s] and spin (n, 3) [rad/s]: x along the commanded aim, y to its left, z up.
    """
    ball, el = geometry.ball, geometry.elevation
    mass, radius = ball.mass, ball.radius
    along, across = (
        np.array([np.cos(el), 0.0, -np.sin(el)]),
        np.array([[0.0, -1.0, 0.0], [np.sin(el), 0.0, np.cos(el)]]),
    )
    offset = (np.stack([side + constants.side_zero, height + constants.height_zero], axis=-1)) * geometry.lever / radius
    rho2 = np.sum(offset**2, axis=-1)
    c = np.sqrt(np.maximum(1.0 - rho2, 0.0))
    speed = (1 + constants.tip_restitution) * cue_speed / (1 + mass / constants.cue_mass + 2.5 * rho2)
    grown = 1.0 + 2.5 * speed * c * constants.contact_time * geometry.lever / (8.0 * radius)
    offset = offset * grown[:, None]
    c = np.sqrt(np.maximum(1.0 - np.sum(offset**2, axis=-1), 0.0))
    normal = offset @ across - c[:, None] * along
    eye, axis = np.eye(3), np.outer(along, along)
    inverse_mass = (eye + 2.5 * (eye - normal[:, :, None] * normal[:, None, :])) / mass
    inverse_mass = inverse_mass + axis / constants.cue_mass + (eye - axis) / constants.end_mass
    values, vectors = np.linalg.eigh(inverse_mass)
    back = constants.tip_restitution ** np.sqrt(values / (1 / mass + 1 / constants.cue_mass))
    driven = cue_speed[:, None] * np.einsum("nik,nk,njk,j->ni", vectors, 1.0 + back, vectors, along)
    free = np.einsum("nik,nk,njk,nj->ni", vectors, 1.0 / values, vectors, driven)
    tip, slate = _with_slate(free, vectors, values, normal, mass, constants.slate_friction)
    velocity = (tip + slate) / mass
    spin = (np.cross(normal, tip) + np.cross([0.0, 0.0, -1.0], slate)) / (0.4 * mass * radius)
    turn, away = np.cos(constants.aim_zero), np.sin(constants.aim_zero)
    about = np.array([[turn, -away, 0.0], [away, turn, 0.0], [0.0, 0.0, 1.0]])
    return velocity @ about.T, spin @ about.T


def _with_slate(
    free: Array, vectors: Array, values: Array, normal: Array, mass: float, friction: float
) -> tuple[Array, Array]:
    """Impulses of tip and slate (n, 3) [N s], from the tip's without a slate.

    The slate's is N (z + f), |f| <= mu, against the slip or such that there is none. Each round moves f along the slip
    and back into its circle, which comes to rest at either.
    """
    down, up = np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0])
    held = np.maximum(-free[:, 2], 0.0) > 0
    push = np.zeros((len(free), 3))
    pace = np.maximum(np.linalg.norm(free, axis=-1), 1e-12) / mass
    tip, slate = free, np.zeros_like(free)
    for _ in range(SLATE_ROUNDS):
        q = (up + push) * held[:, None]
        # At the contact: q / M + (down x q) x n * 5/2 / M; the rank-one term of N = -P_z by Sherman and Morrison.
        felt = (q + 2.5 * (q * (normal @ down)[:, None] - down * np.sum(q * normal, axis=-1, keepdims=True))) / mass
        answer = np.einsum("nik,nk,njk,nj->ni", vectors, 1.0 / values, vectors, felt)
        tip = free + answer * (free[:, 2] / (1.0 - answer[:, 2]))[:, None]
        slate = -tip[:, 2:] * q
        if friction <= 0.0:
            break
        slip = (tip + slate) / mass + 2.5 / mass * np.cross(np.cross(normal, tip) + np.cross(down, slate), down)
        push[:, :2] -= slip[:, :2] / (FULL_FRICTION_SLIP * pace[:, None])
        push *= np.minimum(1.0, friction / np.maximum(np.linalg.norm(push, axis=-1, keepdims=True), 1e-12))
    return tip, slate


def ball_speed_and_squirt(
    constants: Constants, geometry: Geometry, cue_speed: Array, side: Array, height: Array
) -> tuple[Array, Array]:
    """Horizontal speed of the ball (n,) [m/s] and its direction against the aim, > 0 to the left (n,) [rad]."""
    velocity, _ = launch(constants, geometry, cue_speed, side, height)
    return np.hypot(velocity[:, 0], velocity[:, 1]), np.arctan2(velocity[:, 1], velocity[:, 0])
