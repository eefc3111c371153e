"""A small step of an impact: what a normal impulse and its Coulomb friction do to the bodies.

Ball-ball: Mathavan, Jackson, Parkin 2014, the cloth pushing back only on the ball that is pressed down. Ball-cushion:
the same authors 2010, nose above the centre, friction at nose and cloth. Friction opposes the slip of the middle of
the step (second order), or holds it at zero where that takes less. States as in models/analytic/impulse.py: (va, vb,
wa, wb, wz) a ball, a along the line of centres or the cushion. Friction that knows the slip takes the one at the start
of the step. Leaves out vertical motion (v_z = 0).
"""

from __future__ import annotations

import math

from models.analytic.coulomb import friction_at
from models.compiled import compiled, compiled_in_place
from models.shot import NOSE_SINE, Array

Pair = tuple[float, float]

MAX_SWEEPS = 12  # largest number of sweeps over the friction of both contacts, which depend on each other
NOT_HELD = (False, 0.0, 0.0)
SETTLED_CHANGE = 1e-7  # change of the friction between sweeps, over the normal impulse, at which they end


@compiled
def _friction(limit: float, give: Pair, before: Pair, after: Pair, last: Pair) -> Pair:
    """Friction impulse for a slip from `before` to `after` without it; `last` is the last estimate of it.

    `give`: slip per unit of friction impulse, along each direction [1/kg].
    """
    (x0, y0), (x1, y1), (fx, fy) = before, after, last
    hx, hy = -x1 / give[0], -y1 / give[1]
    if math.sqrt(hx * hx + hy * hy) <= limit:
        return hx, hy
    x, y = x0 + x1 + fx * give[0], y0 + y1 + fy * give[1]
    size = math.sqrt(x * x + y * y)
    if size == 0.0:
        return fx, fy
    return -limit * x / size, -limit * y / size


@compiled_in_place
def cushion_step(
    s: Array, dp: float, law: tuple[float, float, float, float], out: Array, sine: float = NOSE_SINE, sink: float = 0.0,
    hold: tuple[bool, float, float] = NOT_HELD,
) -> None:  # fmt: skip
    """One step of normal impulse dp at the nose, which meets the ball at an elevation of this sine.

    With a share `sink` of the ball's momentum downwards that the slate does not return, s[5] and out[5] are the speed
    at which it goes down; without one they are not looked at.
    `hold`: whether the friction at the nose is known, and its impulses along the cushion and up the face.
    """
    cosine, down = math.sqrt(1.0 - sine * sine), (s[5] if sink > 0.0 else 0.0)
    mu, mu_cloth, m, r = law
    k = 5.0 / (2.0 * m * r)
    nose, bed = (3.5 / m, (2.5 + sine**2 + sink * cosine**2) / m), (3.5 / m, 3.5 / m)
    va, vb, wa, wb, wz = s[0], s[1] - dp * cosine / m, s[2], s[3], s[4]
    x0, y0 = s[0] + r * (wb * sine - wz * cosine), -s[1] * sine - down * cosine + r * wa
    c0, d0 = s[0] - r * wb, s[1] + r * wa
    fx, fy = hold[1], hold[2]
    ga = gb = 0.0
    for _ in range(MAX_SWEEPS):
        if not hold[0]:
            x1 = va + ga / m + r * ((wb - k * ga) * sine - wz * cosine)
            y1 = -(vb + gb / m) * sine - (down + sink * dp * sine / m) * cosine + r * (wa + k * gb)
            fx, fy = _friction(mu * dp, nose, (x0, y0), (x1, y1), (fx, fy))
        c1 = va + fx / m - r * (wb + k * fx * sine)
        d1 = vb - fy * sine / m + r * (wa + k * fy)
        press = (1.0 - sink) * max(0.0, dp * sine - fy * cosine)
        a, b = ga, gb
        ga, gb = _friction(mu_cloth * press, bed, (c0, d0), (c1, d1), (ga, gb))
        if abs(ga - a) + abs(gb - b) <= SETTLED_CHANGE * dp:
            break
    out[0] = va + (fx + ga) / m
    out[1] = vb + (gb - fy * sine) / m
    out[2] = wa + k * (fy + gb)
    out[3] = wb + k * (fx * sine - ga)
    out[4] = wz - k * fx * cosine
    if sink > 0.0:
        out[5] = down + sink * (dp * sine - fy * cosine) / m


@compiled_in_place
def ball_step(
    s: Array, dp: float, mu: tuple[float, float, float], law: tuple[float, float, float, float], out: Array
) -> None:
    """One step of normal impulse dp between two balls; only the one pressed down feels the cloth.

    `mu`: friction, its gain without slip and the decay of that [s/m]. `law`: friction of the cloth, mass of the first
    ball and of the second [kg], radius [m].
    """
    mu_cloth, m0, m1, r = law
    both = 1.0 + m0 / m1
    touch = (3.5 * both / m0, 2.5 * both / m0)  # v_z stays zero
    x0, y0 = s[1] - s[6] + r * (s[4] + s[9]), -r * (s[3] + s[8])
    limit = friction_at(mu, math.sqrt(x0 * x0 + y0 * y0)) * dp
    ft = fz = ga = gb = 0.0
    pressed = 0
    for _ in range(MAX_SWEEPS):
        # The pressed ball's reaction (ga, gb) changes the slip between the balls.
        sign = 1.0 - 2.0 * pressed
        m = m0 if pressed == 0 else m1
        k = 5.0 / (2.0 * m * r)
        ft, fz = _friction(limit, touch, (x0, y0), (x0 + sign * gb / m, y0 + r * k * ga), (ft, fz))
        now = 0 if fz < 0.0 else 1
        if now != pressed:
            ga = gb = 0.0
            pressed = now
            m = m0 if pressed == 0 else m1
            k = 5.0 / (2.0 * m * r)
        o, sign = 5 * pressed, 1.0 - 2.0 * pressed
        c0, d0 = s[o] - r * s[o + 3], s[o + 1] + r * s[o + 2]
        c1, d1 = c0 - sign * dp / m + r * k * fz, d0 + sign * ft / m
        a, b = ga, gb
        ga, gb = _friction(mu_cloth * abs(fz), (3.5 / m, 3.5 / m), (c0, d0), (c1, d1), (ga, gb))
        if abs(ga - a) + abs(gb - b) <= SETTLED_CHANGE * dp:
            break
    for ball in range(2):
        sign = 1.0 - 2.0 * ball
        m = m0 if ball == 0 else m1
        k = 5.0 / (2.0 * m * r)
        o = 5 * ball
        out[o] = s[o] - sign * dp / m
        out[o + 1] = s[o + 1] + sign * ft / m
        out[o + 2] = s[o + 2]
        out[o + 3] = s[o + 3] - k * fz
        out[o + 4] = s[o + 4] + k * ft
    o = 5 * pressed
    m = m0 if pressed == 0 else m1
    k = 5.0 / (2.0 * m * r)
    out[o] += ga / m
    out[o + 1] += gb / m
    out[o + 2] += k * gb
    out[o + 3] -= k * ga
