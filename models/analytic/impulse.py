"""Rigid impacts with Coulomb friction and energetic restitution, integrated over the normal impulse.

Ball-ball: Mathavan, Jackson, Parkin 2014, the cloth pushing back only on the ball that is pressed down. Ball-cushion:
the same authors 2010, nose above the centre, friction at nose and cloth. Restitution ends where the work given back is
e^2 times the work of compression, which ends where the approach speed is zero. The cloth's slip is that of the LOWEST
point of a ball, v + w x (-R z). Two balls may differ in mass, their inertia 2/5 m R^2 with it. Leaves out that the
line of centres turns during contact, and vertical motion (v_z = 0).

Both impacts are one ordinary differential equation (models/analytic/coulomb.py). It takes fourth-order steps whose
length follows how fast a slip turns, comes to rest on a slip that ends, and then holds it at zero, or lets it leave in
the one direction that friction allows. Steps depend smoothly on the state, and so does the result, but where a slip
begins or ceases to stick.

A state is (va, vb, wa, wb, wz) a ball, in a right-handed frame (a, b, z): for two balls a is the line of centres from
the first to the second, for a cushion b points into it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from models.analytic.compliant import integrate_compliant
from models.analytic.coulomb import MIN_STEPS, integrate
from models.analytic.pocket import outward
from models.compiled import compiled, compiled_in_place
from models.shot import NOSE_SINE

Array = NDArray[np.float64]

LEAST_APPROACH = 1e-30  # smallest approach speed of an impact; powers of a lower one would vanish [m/s]


@compiled_in_place
def collide(
    cushion: bool, state: Array, e: float, law: tuple[float, float, float, float], steps: int = MIN_STEPS,
    gain: float = 0.0, decay: float = 0.0, ratio: float = 1.0, sine: float = NOSE_SINE,
    compliance: float = 0.0, sink: float = 0.0,
) -> None:  # fmt: skip
    """Carry a state (5 for a cushion, 10 for two balls) through an impact, in place.

    `law`: friction of the contact, friction of the cloth, mass [kg], radius [m]. `steps`: of a whole impact, at least.
    `gain` [1], `decay` [s/m]: friction of the contact is more by gain exp(-decay slip), at the slip of the moment.
    `ratio`: mass of the first ball over that of the second, the inertia with it; a cushion does not know it.
    `sine`: of the elevation at which a cushion's nose meets the ball; two balls do not know it.
    `compliance`: of the nose along its face, over that along its normal (models/analytic/compliant.py); 0 is rigid.
    `sink`: share of a cushion's push on the slate that this does not return: 0 for rigid slate, 1 for none (Han 2005).
    """
    friction, cloth, _, r = law
    mu = (friction, 1.0 * gain, 1.0 * decay)
    if cushion:
        if state[1] < LEAST_APPROACH:
            return
        va, vb, wa, wb, wz = state[0], state[1], r * state[2], r * state[3], r * state[4]
        sn, cs = 1.0 * sine, math.sqrt(1.0 - sine * sine)
        firm = 1.0 - sink
        nose = (
            firm * sn * cs, -cs, 3.5, 2.5 + sn * sn + sink * cs * cs, 1.0 - 2.5 * sn, 2.5 - sn, firm * sn,
            -firm * cs, -cs * cs - sink * sn * sn, -firm * sn * cs, cs,
        )  # fmt: skip
        s1, s2, c1, c2, u = va + wb * sn - wz * cs, wa - vb * sn, va - wb, vb + wa, vb * cs
        if compliance > 0.0:
            p, f1, f2, g1, g2 = integrate_compliant(s1, s2, c1, c2, u, e, mu, cloth, nose, compliance)
        else:
            p, f1, f2, g1, g2 = integrate(s1, s2, c1, c2, u, e, mu, cloth, nose, steps)
        state[0] = va + f1 + g1
        state[1] = vb - p * cs - f2 * sn + g2
        state[2] = (wa + 2.5 * (f2 + g2)) / r
        state[3] = (wb + 2.5 * (f1 * sn - g1)) / r
        state[4] = (wz - 2.5 * f1 * cs) / r
        return
    u = state[0] - state[5]
    if u < LEAST_APPROACH:
        return
    s1, s2 = state[1] - state[6] + r * (state[4] + state[9]), -r * (state[3] + state[8])
    o, sign = (0, 1.0) if s2 > 0.0 else (5, -1.0)
    # The cloth's slip is taken along b first, as that between the balls.
    # Impulses are over the mass of the pressed ball; the other moves by `far` of them.
    far = 1.0 * ratio if sign > 0.0 else 1.0 / ratio
    both = 1.0 + far
    pair = (0.0, -sign, 3.5 * both, 2.5 * both, sign, 2.5, 0.0, -sign, -both, 0.0, sign)
    c1, c2 = state[o + 1] + r * state[o + 2], state[o] - r * state[o + 3]
    p, f1, f2, g1, g2 = integrate(s1, s2, c1, c2, u, e, mu, cloth, pair, steps)
    for n in range(2):
        part = 1.0 if 5 * n == o else far
        turn = 1.0 - 2.0 * n
        state[5 * n] -= turn * part * p
        state[5 * n + 1] += turn * part * f1
        state[5 * n + 3] -= 2.5 * part * f2 / r
        state[5 * n + 4] += 2.5 * part * f1 / r
    state[o] += g2
    state[o + 1] += g1
    state[o + 2] += 2.5 * g1 / r
    state[o + 3] -= 2.5 * g2 / r


@compiled
def collide_rows(
    cushion: bool, hit: NDArray[np.int64], p: Array, v: Array, w: Array, e: Array, mu: Array, cloth: Array,
    m: float, r: float, gain: Array | None = None, decay: Array | None = None, ratio: Array | None = None,
    sine: Array | None = None, compliance: Array | None = None, sink: Array | None = None,
    jaws: Array | None = None,
) -> None:  # fmt: skip
    """Carry the balls of every simulation through its impact, in place.

    `hit` (n, 3): kind, ball, and other ball or rail (+x, -x, +y, -y), or 4 + jaw; p, v, w (n, nball, 3);
    e, mu, cloth (n,). gain, decay, ratio, sine, compliance, sink (n,), as in `collide`; `jaws` as in
    models/analytic/pocket.py.
    """
    state = np.zeros(5 if cushion else 10)
    for k in range(hit.shape[0]):
        i, j = hit[k, 1], hit[k, 2]
        if cushion:
            if jaws is None:
                sign = 1.0 - 2.0 * (j % 2)
                bx, by = (sign, 0.0) if j < 2 else (0.0, sign)
            else:
                bx, by = outward(j, p[k, i, 0], p[k, i, 1], jaws)
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
        more = 0.0 if gain is None else gain[k]
        fade = 0.0 if decay is None else decay[k]
        heavier = 1.0 if ratio is None else ratio[k]
        nose = NOSE_SINE if sine is None else sine[k]
        soft = 0.0 if compliance is None else compliance[k]
        sunk = 0.0 if sink is None else sink[k]
        collide(cushion, state, e[k], (mu[k], cloth[k], m, r), MIN_STEPS, more, fade, heavier, nose, soft, sunk)
        for n in range(1 if cushion else 2):
            b = i if n == 0 else j
            o = 5 * n
            v[k, b, 0] = state[o] * ax + state[o + 1] * bx
            v[k, b, 1] = state[o] * ay + state[o + 1] * by
            w[k, b, 0] = state[o + 2] * ax + state[o + 3] * bx
            w[k, b, 1] = state[o + 2] * ay + state[o + 3] * by
            w[k, b, 2] = state[o + 4]
