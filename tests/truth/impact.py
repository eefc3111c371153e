"""Two impacts by integration over the normal impulse: ball on ball, ball on cushion, with the cloth under them.

Both run in a local frame whose +x axis points from the ball into what it meets; the accumulated normal impulse is the
independent variable. At each contact Coulomb friction opposes the slip, and no friction increment may be larger than
what just stops its slip (stick). Restitution is energetic (Stronge): compression ends at approach speed 0, the impact
ends when e^2 of the work of compression is recovered; both ends are landed on exactly.
Sources: Mathavan, Jackson, Parkin, Sports Eng. 17, 227 (2014) (balls); Proc. IMechE C 224(9), 1863 (2010) (cushion).
Left out: vertical motion, and the deformation of what is met.
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
def _press_nose(q: Array, dp: float, mu: Law, mus: float, mass: Array, radius: float, sine: float) -> None:
    """Increment dp [N s] of the impulse along the contact normal between q[0] and the cushion's nose.

    Contact point R (cos, 0, sin); friction along y and up the face e = (-sin, 0, cos). The cloth carries what the
    nose presses down: N = dp sin - f_e cos.
    """
    b, m, cosine = q[0], mass[0], np.sqrt(1.0 - sine * sine)
    sy = b[1] + radius * (b[4] * cosine - b[2] * sine)
    se = -b[0] * sine - radius * b[3]
    slip = np.hypot(sy, se)
    fy, fe = 0.0, 0.0
    if slip > 0.0:
        f = _stick(_friction(mu, slip) * dp, slip, 3.5 / m)
        fy, fe = -f * sy / slip, -f * se / slip
    _cloth(b, dp * sine - fe * cosine, mus, m, radius)
    b[0] += (-dp * cosine - fe * sine) / m
    b[1] += fy / m
    lever = 2.5 / (m * radius)
    b[2] -= lever * sine * fy
    b[3] -= lever * fe
    b[4] += lever * cosine * fy


@njit(cache=True)
def _press(kind: int, q: Array, dp: float, mu: Law, mus: float, mass: Array, radius: float, sine: float) -> None:
    if kind == BALLS:
        _press_balls(q, dp, mu, mus, mass, radius)
    else:
        _press_nose(q, dp, mu, mus, mass, radius, sine)


@njit(cache=True)
def impact(
    kind: int, q: Array, e: float, mu: Law, mus: float, mass: Array, radius: float, n: int, sine: float = NOSE_SINE
) -> Array:
    """State after an impact of the given kind, in the local frame.

    q: (2, 5) rows (vx, vy, wx, wy, wz) [m/s, rad/s], the second a resting dummy at a cushion; mass: (2,) [kg];
    e energetic restitution, mu friction law at the contact, mus on the cloth; n impulse increments; sine of the
    elevation at which a nose meets the ball.
    """
    q = q.copy()
    closing = q[0, 0] - q[1, 0]
    if closing <= 0.0:
        return q
    scale = 1.0 / (1.0 / mass[0] + 1.0 / mass[1]) if kind == BALLS else mass[0] / np.sqrt(1.0 - sine * sine)
    dp = (1.0 + e) * scale * closing / n
    stored, target, compressing = 0.0, 0.0, True
    for _ in range(20 * n):
        before = q.copy()
        _press(kind, q, dp, mu, mus, mass, radius, sine)
        rest, now = before[0, 0] - before[1, 0], q[0, 0] - q[1, 0]
        work = 0.5 * dp * (rest + now)
        if (compressing and now > 0.0) or (not compressing and stored + work > target):
            stored += work
            continue
        low, high = 0.0, dp
        for _ in range(50):
            part = 0.5 * (low + high)
            q = before.copy()
            _press(kind, q, part, mu, mus, mass, radius, sine)
            now = q[0, 0] - q[1, 0]
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
