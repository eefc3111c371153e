"""Two impacts by integration over the normal impulse: ball on ball, ball on cushion, with the cloth under them.

Both run in a local frame whose +x axis points from the ball into what it meets; the accumulated normal impulse is the
independent variable. At each contact Coulomb friction opposes the slip, and no friction increment may be larger than
what just stops its slip (stick). Restitution is energetic (Stronge): compression ends at approach speed 0, the impact
ends when e^2 of the work of compression is recovered; both ends are landed on exactly.
Sources: Mathavan, Jackson, Parkin, Sports Eng. 17, 227 (2014) (balls); Proc. IMechE C 224(9), 1863 (2010) (cushion).
Left out: vertical motion, and the deformation of what is met, which a nose of springs alone has (`springs`).
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Law = tuple[float, float, float]  # (a, b, c): friction mu(s) = a + b exp(-c s) at slip s [m/s]

NOSE_SINE: Final = 0.4  # nose at height 7R/5: sine of the contact point's elevation
INCREMENTS: Final = 4000  # of impulse in an impact
BALLS, NOSE = range(2)


@njit(cache=True)
def _stick(limit: float, slip: float, inverse_mass: float) -> float:
    """Size of a friction impulse [N s]: its Coulomb limit, or what just stops the slip, if that is less."""
    return min(limit, slip / inverse_mass)


@njit(cache=True)
def _friction(mu: Law, slip: float) -> float:
    """Friction at the slip of the moment, mu = a + b exp(-c s) (Alciatore, technical proof A.14)."""
    return mu[0] + mu[1] * np.exp(-mu[2] * slip)


@njit(cache=True)
def _cloth(b: Array, normal: float, mus: float, mass: float, radius: float) -> None:
    """Friction of the cloth on ball b = (vx, vy, wx, wy, wz), pressed on it by the impulse normal [N s]."""
    ux = b[0] - radius * b[3]
    uy = b[1] + radius * b[2]
    slip = np.hypot(ux, uy)
    if slip > 0.0 and normal > 0.0:
        g = _stick(mus * normal, slip, 3.5 / mass)
        b[0] -= g * ux / slip / mass
        b[1] -= g * uy / slip / mass
        lever = 2.5 / (mass * radius)
        b[2] -= lever * g * uy / slip
        b[3] += lever * g * ux / slip


@njit(cache=True)
def _press_balls(q: Array, dp: float, mu: Law, mus: float, mass: Array, radius: float) -> None:
    """Increment dp [N s] of the normal impulse between q[0] and q[1], with what follows from it.

    Slip s = v_0 - v_1 + R (omega_0 + omega_1) x x^. Only the ball that friction pushes down is pressed on the cloth.
    """
    sy = q[0, 1] - q[1, 1] + radius * (q[0, 4] + q[1, 4])
    sz = -radius * (q[0, 3] + q[1, 3])
    slip = np.hypot(sy, sz)
    fy, fz = 0.0, 0.0
    if slip > 0.0:
        f = _stick(_friction(mu, slip) * dp, slip, 3.5 * (1.0 / mass[0] + 1.0 / mass[1]))
        fy, fz = -f * sy / slip, -f * sz / slip
    _cloth(q[0], -fz, mus, mass[0], radius)
    _cloth(q[1], fz, mus, mass[1], radius)
    for k in range(2):
        sign = 1.0 - 2.0 * k
        q[k, 0] -= sign * dp / mass[k]
        q[k, 1] += sign * fy / mass[k]
        lever = 2.5 / (mass[k] * radius)
        q[k, 3] -= lever * fz
        q[k, 4] += lever * fy


@njit(cache=True)
def _press_nose(q: Array, dp: float, mu: Law, mus: float, mass: Array, radius: float, sine: float, bed: float) -> None:
    """Increment dp [N s] of the impulse along the contact normal between q[0] and the cushion's nose.

    Contact point R (cos, 0, sin); friction along y and up the face e = (-sin, 0, cos). The cloth carries what the
    nose presses down: N = dp sin - f_e cos. Of that a soft bed lets the share `bed` move the ball, whose vertical speed
    is kept in q[1, 0] while the impact lasts.
    """
    b, m, cosine = q[0], mass[0], np.sqrt(1.0 - sine * sine)
    sy = b[1] + radius * (b[4] * cosine - b[2] * sine)
    se = -b[0] * sine - radius * b[3] + q[1, 0] * cosine
    slip = np.hypot(sy, se)
    fy, fe = 0.0, 0.0
    if slip > 0.0:
        f = _stick(_friction(mu, slip) * dp, slip, 3.5 / m)
        fy, fe = -f * sy / slip, -f * se / slip
    down = dp * sine - fe * cosine
    q[1, 0] -= bed * down / m
    _cloth(b, (1.0 - bed) * down, mus, m, radius)
    b[0] += (-dp * cosine - fe * sine) / m
    b[1] += fy / m
    lever = 2.5 / (m * radius)
    b[2] -= lever * sine * fy
    b[3] -= lever * fe
    b[4] += lever * cosine * fy


@njit(cache=True)
def _press(
    kind: int, q: Array, dp: float, mu: Law, mus: float, mass: Array, radius: float, sine: float, bed: float
) -> None:
    if kind == BALLS:
        _press_balls(q, dp, mu, mus, mass, radius)
    else:
        _press_nose(q, dp, mu, mus, mass, radius, sine, bed)


@njit(cache=True)
def _closing(kind: int, q: Array, sine: float) -> float:
    """How fast the bodies approach along their normal, over the cosine of its elevation."""
    if kind == BALLS:
        return float(q[0, 0] - q[1, 0])
    return float(q[0, 0] + q[1, 0] * sine / np.sqrt(1.0 - sine * sine))


@njit(cache=True)
def impact(
    kind: int,
    q: Array,
    e: float,
    mu: Law,
    mus: float,
    mass: Array,
    radius: float,
    n: int,
    sine: float = NOSE_SINE,
    bed: float = 0.0,
) -> Array:
    """State after an impact of the given kind, in the local frame.

    q: (2, 5) rows (vx, vy, wx, wy, wz) [m/s, rad/s], the second a resting dummy at a cushion; mass: (2,) [kg];
    e energetic restitution, mu friction law at the contact, mus on the cloth; n impulse increments; sine of the
    elevation at which a nose meets the ball; bed share of its push downwards that the slate does not return.
    """
    q = q.copy()
    closing = _closing(kind, q, sine)
    if closing <= 0.0:
        return q
    scale = 1.0 / (1.0 / mass[0] + 1.0 / mass[1]) if kind == BALLS else mass[0] / np.sqrt(1.0 - sine * sine)
    dp = (1.0 + e) * scale * closing / n
    stored, target, compressing = 0.0, 0.0, True
    for _ in range(20 * n):
        before = q.copy()
        _press(kind, q, dp, mu, mus, mass, radius, sine, bed)
        rest, now = _closing(kind, before, sine), _closing(kind, q, sine)
        work = 0.5 * dp * (rest + now)
        if (compressing and now > 0.0) or (not compressing and stored + work > target):
            stored += work
            continue
        low, high = 0.0, dp
        for _ in range(50):
            part = 0.5 * (low + high)
            q = before.copy()
            _press(kind, q, part, mu, mus, mass, radius, sine, bed)
            now = _closing(kind, q, sine)
            work = 0.5 * part * (rest + now)
            if (compressing and now > 0.0) or (not compressing and stored + work > target):
                low = part
            else:
                high = part
        if not compressing:
            break
        compressing = False
        stored += work
        target = stored * (1.0 - e * e)
    return q


STIFFNESS: Final = 2e4  # of a nose along its normal [N/m]; a ball is in contact for some 10 ms


@njit(cache=True)
def springs(
    q: Array,
    e: float,
    mu: float,
    mus: float,
    mass: float,
    radius: float,
    n: int,
    sine: float,
    compliance: float,
    bed: float = 0.0,
) -> Array:
    """State after a ball has met a nose that is two springs, one along the normal, one along its face, over time.

    The ball rubs on the foot of the second, which has no mass: it moves with the ball while the spring asks for less
    than mu times the normal force, and is dragged along by just that otherwise. Where the normal spring is released it
    is stiffer by 1 / e^2. Source: Stronge, Impact Mechanics (2000), chapter 5. Semi-implicit steps, n in each quarter
    of a period; q (2, 5) and the others as in `impact`.
    """
    q = q.copy()
    b, cosine = q[0], np.sqrt(1.0 - sine * sine)
    lever = 2.5 / (mass * radius)
    dt = 0.5 * np.pi * np.sqrt(mass / STIFFNESS) / n
    deep, most, loading, rise = 0.0, 0.0, True, 0.0  # rise: vertical speed on a soft bed
    wound_y, wound_e = 0.0, 0.0  # the spring along the face, horizontally and upwards [m]
    face = STIFFNESS / compliance
    while True:
        speed = b[0] * cosine + rise * sine  # into the nose, along its normal
        deep += speed * dt
        if loading and speed <= 0.0:
            loading, most = False, deep
        force = STIFFNESS * deep if loading else STIFFNESS * (most - (most - deep) / (e * e))
        if force <= 0.0:
            return q
        wound_y += dt * (b[1] + radius * (b[4] * cosine - b[2] * sine))
        wound_e += dt * (-b[0] * sine - radius * b[3] + rise * cosine)
        pull = face * np.hypot(wound_y, wound_e)
        if pull > mu * force:
            wound_y, wound_e = wound_y * mu * force / pull, wound_e * mu * force / pull
        jn, jy, je = force * dt, -face * wound_y * dt, -face * wound_e * dt
        b[0] += (-jn * cosine - je * sine) / mass
        b[1] += jy / mass
        b[2] -= lever * sine * jy
        b[3] -= lever * je
        b[4] += lever * cosine * jy
        rise -= bed * (jn * sine - je * cosine) / mass
        _cloth(b, (1.0 - bed) * (jn * sine - je * cosine), mus, mass, radius)
