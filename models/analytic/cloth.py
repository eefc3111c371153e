"""A ball on the cloth, in closed form: it slides, then rolls, then rests; sidespin dies away on its own.

With slip u = v + omega x (-R z) of the lowest point, sliding: force -mu_s M g u/|u|; u keeps its direction and ends
after 2 |u| / (7 mu_s g), the path is a parabola, and the ball then rolls at v - 2/7 u. Rolling: deceleration mu_r g.
Sidespin: deceleration alpha, clamped at zero. Source: Robotic Billiards (2015) section IV.B, figures from Mathavan,
Jackson, Parkin 2009. Leaves out that spin and slide share a finite contact patch (Contensou), drag, nap and slope.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models import record as rec
from models.compiled import compiled, compiled_in_place
from models.shot import GRAVITY

Array = NDArray[np.float64]
STILL_SPEED = 1e-8  # slip or speed below which there is none [m/s]
STILL_SPIN = 1e-6  # sidespin below which there is none [rad/s]
SLIDING, ROLLING, RESTING = 1, 2, 0
LAST_SLIP_S = 5e-5  # time in which full friction ends a slip that is no longer reduced [s]
LAST_SLIP_MARGIN = 1e-6  # part of that slip within which it counts as attained


class ClothPhase(NamedTuple):
    """What a ball does on the cloth, and where it slips and goes; unit vectors are 0 where there is no motion."""

    mode: int  # SLIDING, ROLLING or RESTING
    slip: float  # size of the slip [m/s]
    slip_x: float  # unit vector of the slip
    slip_y: float
    speed: float  # [m/s]
    x: float  # unit vector of the velocity
    y: float
    spin: float  # sidespin [rad/s]


@compiled_in_place
def rolling_resistance(r, roll):  # type: ignore[no-untyped-def]
    """Deceleration of a rolling ball with the factors of the effects, at least 0 [m/s^2]."""
    return roll * r[rec.ROLL_FACTOR] * r[rec.WEIGHT] * GRAVITY + r[rec.DRAG]


@compiled_in_place
def add_cloth(r, phase, cloth):  # type: ignore[no-untyped-def]
    """Add the cloth's friction to what pushes and turns a ball in its record r (models/hooks.py), in a `ClothPhase`.

    `cloth` (3,): friction of sliding and of rolling, deceleration of sidespin [rad/s^2].
    Sliding friction acts against the slip, rolling friction against the velocity, that of sidespin against its sign.
    What it does across the way of a sliding ball is friction, too: as it is no larger than the friction against the
    slip, the two together never drive the slip, and take energy whatever an effect says.
    A rolling or resting ball is held at no slip by a reaction to the pushes, up to the friction of a sliding one.
    """
    mode, slip, ux, uy, _, vx, vy, wz = phase
    slide, roll, spin = cloth[0], cloth[1], cloth[2]
    n, radius, held = r[rec.WEIGHT] * GRAVITY, r[rec.RADIUS], False
    per = 1.0 / radius
    gx = gy = dx = dy = 0.0
    if mode == SLIDING:
        friction = slide * n
        # A slip that dies away would never end by itself: the last of it meets the full friction.
        if slip > 3.5 * friction * LAST_SLIP_S * (1.0 + LAST_SLIP_MARGIN):
            friction *= r[rec.SLIDE_FACTOR]
        gx, gy = -friction * ux, -friction * uy
        speed = math.sqrt(r[rec.VX] * r[rec.VX] + r[rec.VY] * r[rec.VY])
        if r[rec.ACROSS] != 0.0 and speed > 0.0:
            left = min(max(r[rec.ACROSS], -friction), friction) / speed
            gx, gy = gx - left * r[rec.VY], gy + left * r[rec.VX]
    else:
        # Without friction the slip would change at push + torque x R / I; 2/7 of that holds it at zero.
        gx = -2 / 7 * (r[rec.AX] - radius * r[rec.BY])
        gy = -2 / 7 * (r[rec.AY] + radius * r[rec.BX])
        most, need = slide * n, gx * gx + gy * gy
        slips = need > most * most
        if slips:
            need = most / math.sqrt(need)
            gx, gy = gx * need, gy * need
        resistance = max(rolling_resistance(r, roll), 0.0)
        if mode == ROLLING:
            dx, dy = resistance * vx, resistance * vy
        else:
            # A ball at rest stays there until the push exceeds what rolling resistance can hold.
            px, py = r[rec.AX] + gx, r[rec.AY] + gy
            force = math.sqrt(px * px + py * py)
            held = force <= resistance
            if not held and not slips:
                dx, dy = resistance * px / force, resistance * py / force
    if held:
        r[rec.AX] = r[rec.AY] = r[rec.BX] = r[rec.BY] = 0.0
    else:
        r[rec.AX] += gx - dx
        r[rec.AY] += gy - dy
        r[rec.BX] += (2.5 * gy + dy) * per
        r[rec.BY] -= (2.5 * gx + dx) * per
    if abs(wz) > STILL_SPIN and n > 0.0:
        r[rec.BZ] -= math.copysign(spin * r[rec.SPIN_FACTOR], wz)


@compiled
def turned(wz: float, alpha: float, t: float) -> tuple[float, float]:
    """Angle turned about the vertical in a time, and the sidespin left: [rad], [rad/s]."""
    size = abs(wz)
    if alpha > 0.0 and size <= alpha * t:
        return 0.5 * wz * size / alpha, 0.0
    return (wz - 0.5 * math.copysign(alpha, wz) * t) * t, wz - math.copysign(alpha * t, wz)


@compiled_in_place
def flow(b: Array, t: float, radius: float, slide: float, roll: float, alpha: float) -> None:
    """Carry one ball (x, y, vx, vy, wx, wy, wz, theta) through a time on open cloth, in place."""
    b7, b[6] = turned(b[6], alpha, t)
    b[7] += b7
    ux, uy = b[2] - radius * b[5], b[3] + radius * b[4]
    u = math.sqrt(ux * ux + uy * uy)
    if u > STILL_SPEED:
        rate = 3.5 * slide * GRAVITY
        s = min(t, u / rate) if rate > 0.0 else t
        ax, ay = -slide * GRAVITY * ux / u, -slide * GRAVITY * uy / u
        b[0] += (b[2] + 0.5 * ax * s) * s
        b[1] += (b[3] + 0.5 * ay * s) * s
        b[2] += ax * s
        b[3] += ay * s
        b[4] += 2.5 * ay * s / radius
        b[5] -= 2.5 * ax * s / radius
        if s == t:
            return
        t -= s
    v = math.sqrt(b[2] * b[2] + b[3] * b[3])
    rate = roll * GRAVITY
    s, left = t, 1.0
    if rate > 0.0:
        s = min(t, v / rate)
        left = 1.0 - s * rate / v if s < v / rate else 0.0
    b[0] += 0.5 * (1.0 + left) * s * b[2]
    b[1] += 0.5 * (1.0 + left) * s * b[3]
    b[2] *= left
    b[3] *= left
    b[4], b[5] = -b[3] / radius, b[2] / radius


@compiled
def _flow_rows(rows: Array, times: Array, radius: float, slide: float, roll: float, alpha: float) -> None:
    for k in range(rows.shape[0]):
        flow(rows[k], times[k], radius, slide, roll, alpha)


def slip(velocity: ArrayLike, spin: ArrayLike, radius: float) -> Array:
    """Velocity of the lowest point over the cloth: (..., 2) [m/s]; velocity (..., 2) [m/s], spin (..., 3) [rad/s]."""
    v, w = np.asarray(velocity, float), np.asarray(spin, float)
    return v[..., :2] + radius * np.stack([-w[..., 1], w[..., 0]], axis=-1)


def rolling_velocity(velocity: ArrayLike, spin: ArrayLike, radius: float) -> Array:
    """Velocity at which the ball begins to roll, whatever the friction: (..., 2) [m/s]."""
    return np.asarray(velocity, float)[..., :2] - 2.0 / 7.0 * slip(velocity, spin, radius)


def state_at(
    time: ArrayLike, position: ArrayLike, velocity: ArrayLike, spin: ArrayLike, radius: float, slide: float,
    roll: float, alpha: float,
) -> tuple[Array, Array, Array]:  # fmt: skip
    """Position (..., 2) [m], velocity (..., 2) [m/s] and spin (..., 3) [rad/s] after times (...) [s] on open cloth.

    Friction `slide` and `roll` [1], deceleration `alpha` of sidespin [rad/s^2]. All arrays broadcast.
    """
    t = np.asarray(time, float)
    parts = [np.asarray(x, float) for x in (position, velocity, spin)]
    shape = np.broadcast_shapes(t.shape, *(x.shape[:-1] for x in parts))
    rows = np.zeros((*shape, 8))
    rows[..., 0:2], rows[..., 2:4], rows[..., 4:7] = parts
    _flow_rows(rows.reshape(-1, 8), np.broadcast_to(t, shape).reshape(-1), radius, slide, roll, alpha)
    return rows[..., 0:2], rows[..., 2:4], rows[..., 4:7]
