"""Rigid impacts with Coulomb friction and energetic restitution, integrated over the normal impulse.

Ball-ball: Mathavan, Jackson, Parkin 2014, the cloth pushing back only on the ball that is pressed down. Ball-cushion:
the same authors 2010, nose above the centre, friction at nose and cloth. Compression ends where the approach speed is
zero, restitution where the work given back is e^2 times the work of compression; both are landed on exactly. Friction
opposes the slip of the middle of a step (second order), or holds it at zero where that takes less. The cloth's slip is
that of the LOWEST point of a ball, v + w x (-R z). Leaves out that the line of centres turns during contact, and
vertical motion (v_z = 0).

A state is (va, vb, wa, wb, wz) a ball, in a right-handed frame (a, b, z): for two balls a is the line of centres from
the first to the second, for a cushion b points into it.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.shot import NOSE_COSINE, NOSE_SINE

Array = NDArray[np.float64]
STEPS = 120  # impulse steps of a whole impact, where no slip turns
SWEEPS = 12  # at most, over the friction of both contacts, which depend on each other
SETTLED = 1e-7  # change of the friction between sweeps over the normal impulse that ends them
TURN = 0.99  # cosine of the largest turn of a slip in a step; one that reverses or ends is stepped up to closely
FINEST = 2.0**-14  # shortest step of that kind over the usual one
STILL = 1e-7  # slip over approach speed that is none
LANDING = 8  # secant refinements of an end point


@njit(cache=True)
def _friction(
    limit: float, give: tuple[float, float], x0: float, y0: float, x1: float, y1: float, fx: float, fy: float
) -> tuple[float, float]:
    """Friction impulse for a slip from (x0, y0) to (x1, y1) without it; (fx, fy) is the last estimate of it.

    `give`: slip per unit of friction impulse, along each direction [1/kg].
    """
    hx, hy = -x1 / give[0], -y1 / give[1]
    if math.sqrt(hx * hx + hy * hy) <= limit:
        return hx, hy
    x, y = x0 + x1 + fx * give[0], y0 + y1 + fy * give[1]
    size = math.sqrt(x * x + y * y)
    if size == 0.0:
        return fx, fy
    return -limit * x / size, -limit * y / size


@njit(cache=True)
def _cushion_step(s: Array, dp: float, law: tuple[float, float, float, float], out: Array) -> None:
    """One step of normal impulse dp at the nose."""
    mu, mu_cloth, m, r = law
    k = 5.0 / (2.0 * m * r)
    nose, bed = (3.5 / m, (2.5 + NOSE_SINE**2) / m), (3.5 / m, 3.5 / m)  # v_z stays zero
    va, vb, wa, wb, wz = s[0], s[1] - dp * NOSE_COSINE / m, s[2], s[3], s[4]
    x0, y0 = s[0] + r * (wb * NOSE_SINE - wz * NOSE_COSINE), -s[1] * NOSE_SINE + r * wa
    c0, d0 = s[0] - r * wb, s[1] + r * wa
    fx = fy = ga = gb = 0.0
    for _ in range(SWEEPS):
        x1 = va + ga / m + r * ((wb - k * ga) * NOSE_SINE - wz * NOSE_COSINE)
        y1 = -(vb + gb / m) * NOSE_SINE + r * (wa + k * gb)
        fx, fy = _friction(mu * dp, nose, x0, y0, x1, y1, fx, fy)
        c1 = va + fx / m - r * (wb + k * fx * NOSE_SINE)
        d1 = vb - fy * NOSE_SINE / m + r * (wa + k * fy)
        press = max(0.0, dp * NOSE_SINE - fy * NOSE_COSINE)
        a, b = ga, gb
        ga, gb = _friction(mu_cloth * press, bed, c0, d0, c1, d1, ga, gb)
        if abs(ga - a) + abs(gb - b) <= SETTLED * dp:
            break
    out[0] = va + (fx + ga) / m
    out[1] = vb + (gb - fy * NOSE_SINE) / m
    out[2] = wa + k * (fy + gb)
    out[3] = wb + k * (fx * NOSE_SINE - ga)
    out[4] = wz - k * fx * NOSE_COSINE


@njit(cache=True)
def _ball_step(s: Array, dp: float, law: tuple[float, float, float, float], out: Array) -> None:
    """One step of normal impulse dp between two balls; only the one pressed down feels the cloth."""
    mu, mu_cloth, m, r = law
    k = 5.0 / (2.0 * m * r)
    touch, bed = (7.0 / m, 5.0 / m), (3.5 / m, 3.5 / m)  # v_z stays zero
    x0, y0 = s[1] - s[6] + r * (s[4] + s[9]), -r * (s[3] + s[8])
    ft = fz = ga = gb = 0.0
    pressed = 0
    for _ in range(SWEEPS):
        # The pressed ball's reaction (ga, gb) changes the slip between the balls.
        sign = 1.0 - 2.0 * pressed
        ft, fz = _friction(mu * dp, touch, x0, y0, x0 + sign * gb / m, y0 + r * k * ga, ft, fz)
        now = 0 if fz < 0.0 else 1
        if now != pressed:
            ga = gb = 0.0
            pressed = now
        o, sign = 5 * pressed, 1.0 - 2.0 * pressed
        c0, d0 = s[o] - r * s[o + 3], s[o + 1] + r * s[o + 2]
        c1, d1 = c0 - sign * dp / m + r * k * fz, d0 + sign * ft / m
        a, b = ga, gb
        ga, gb = _friction(mu_cloth * abs(fz), bed, c0, d0, c1, d1, ga, gb)
        if abs(ga - a) + abs(gb - b) <= SETTLED * dp:
            break
    for ball in range(2):
        sign = 1.0 - 2.0 * ball
        o = 5 * ball
        out[o] = s[o] - sign * dp / m
        out[o + 1] = s[o + 1] + sign * ft / m
        out[o + 2] = s[o + 2]
        out[o + 3] = s[o + 3] - k * fz
        out[o + 4] = s[o + 4] + k * ft
    o = 5 * pressed
    out[o] += ga / m
    out[o + 1] += gb / m
    out[o + 2] += k * gb
    out[o + 3] -= k * ga


@njit(cache=True)
def _step(cushion: bool, s: Array, dp: float, law: tuple[float, float, float, float], out: Array) -> None:
    if cushion:
        _cushion_step(s, dp, law, out)
    else:
        _ball_step(s, dp, law, out)


@njit(cache=True)
def _approach(cushion: bool, s: Array) -> float:
    return s[1] * NOSE_COSINE if cushion else s[0] - s[5]


@njit(cache=True)
def _slip(cushion: bool, s: Array, contact: int, r: float) -> tuple[float, float]:
    """Slip between the bodies (contact 0), or of a ball over the cloth (1, and 2 for the second ball)."""
    if contact > 0:
        o = 5 * (contact - 1)
        return s[o] - r * s[o + 3], s[o + 1] + r * s[o + 2]
    if cushion:
        return s[0] + r * (s[3] * NOSE_SINE - s[4] * NOSE_COSINE), -s[1] * NOSE_SINE + r * s[2]
    return s[1] - s[6] + r * (s[4] + s[9]), -r * (s[3] + s[8])


@njit(cache=True)
def _turned(cushion: bool, before: Array, after: Array, r: float, none: float) -> bool:
    """True where a slip larger than `none` has turned, or come to an end."""
    for contact in range(2 if cushion else 3):
        x0, y0 = _slip(cushion, before, contact, r)
        x1, y1 = _slip(cushion, after, contact, r)
        size = math.sqrt((x0 * x0 + y0 * y0) * (x1 * x1 + y1 * y1))
        if x0 * x0 + y0 * y0 > none * none and x0 * x1 + y0 * y1 <= TURN * size:
            return True
    return False


@njit(cache=True)
def collide(cushion: bool, state: Array, e: float, law: tuple[float, float, float, float], steps: int = STEPS) -> None:
    """Carry a state (5 for a cushion, 10 for two balls) through an impact, in place.

    `law`: friction of the contact, friction of the cloth, mass [kg], radius [m]. `steps`: of a whole impact, about.
    """
    speed = _approach(cushion, state)
    if speed <= 0.0:
        return
    mass = law[2] if cushion else law[2] / 2.0
    step = (1.0 + e) * mass * speed / steps
    after = np.empty_like(state)
    work, target, restoring = 0.0, -1.0, False
    size = step
    for _ in range(100 * steps):
        before = _approach(cushion, state)
        dp = size
        _step(cushion, state, dp, law, after)
        while dp > FINEST * step and _turned(cushion, state, after, law[3], STILL * speed):
            dp *= 0.5
            _step(cushion, state, dp, law, after)
        size = min(step, 2.0 * dp)
        low, high, done = 0.0, dp, False
        for attempt in range(LANDING + 1):
            if attempt > 0:
                _step(cushion, state, dp, law, after)
            now = _approach(cushion, after)
            gain = 0.5 * dp * (before + now)
            # How far this step goes beyond the end of the phase; zero is the landing.
            if restoring:
                beyond = -gain - (target - work)
                rate = -now
            else:
                beyond = -now
                rate = (before - now) / dp
            if attempt == 0 and beyond < 0.0:
                break
            done = True
            if beyond > 0.0:
                high = dp
            else:
                low = dp
            if abs(beyond) <= 1e-15 * speed * (mass * speed if restoring else 1.0) or attempt == LANDING:
                break
            dp -= beyond / rate if rate > 0.0 else 0.5 * (high - low)
            if not low < dp < high:
                dp = 0.5 * (low + high)
        state[:] = after
        if not restoring:
            work += gain
            if done:
                restoring, target, work = True, e * e * work, 0.0
                if target <= 0.0:
                    return
        else:
            work -= gain
            if done:
                return


@njit(cache=True)
def collide_rows(
    cushion: bool, hit: NDArray[np.int64], p: Array, v: Array, w: Array, e: Array, mu: Array, cloth: Array,
    m: float, r: float,
) -> None:  # fmt: skip
    """Carry the balls of every simulation through its impact, in place.

    `hit` (n, 3): kind, ball, and other ball or rail (+x, -x, +y, -y); p, v, w (n, nball, 3); e, mu, cloth (n,).
    """
    state = np.zeros(5 if cushion else 10)
    for k in range(hit.shape[0]):
        i, j = hit[k, 1], hit[k, 2]
        if cushion:
            sign = 1.0 - 2.0 * (j % 2)
            bx, by = (sign, 0.0) if j < 2 else (0.0, sign)
            ax, ay = by, -bx
        else:
            ax, ay = p[k, j, 0] - p[k, i, 0], p[k, j, 1] - p[k, i, 1]
            d = np.sqrt(ax * ax + ay * ay)
            ax, ay = ax / d, ay / d
            bx, by = -ay, ax
        for n in range(1 if cushion else 2):
            b = i if n == 0 else j
            o = 5 * n
            state[o] = v[k, b, 0] * ax + v[k, b, 1] * ay
            state[o + 1] = v[k, b, 0] * bx + v[k, b, 1] * by
            state[o + 2] = w[k, b, 0] * ax + w[k, b, 1] * ay
            state[o + 3] = w[k, b, 0] * bx + w[k, b, 1] * by
            state[o + 4] = w[k, b, 2]
        collide(cushion, state, e[k], (mu[k], cloth[k], m, r))
        for n in range(1 if cushion else 2):
            b = i if n == 0 else j
            o = 5 * n
            v[k, b, 0] = state[o] * ax + state[o + 1] * bx
            v[k, b, 1] = state[o] * ay + state[o + 1] * by
            w[k, b, 0] = state[o + 2] * ax + state[o + 3] * bx
            w[k, b, 1] = state[o + 2] * ay + state[o + 3] * by
            w[k, b, 2] = state[o + 4]
