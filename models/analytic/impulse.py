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
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.analytic.compliant import integrate_compliant
from models.analytic.coulomb import MIN_STEPS, CoulombLaw, Coupling, integrate
from models.compiled import compiled, compiled_in_place
from models.shot import NOSE_SINE

Array = NDArray[np.float64]

LEAST_APPROACH = 1e-30  # smallest approach speed of an impact; powers of a lower one would vanish [m/s]


class ImpactLaw(NamedTuple):
    """How an impact goes."""

    restitution: float  # energetic
    friction: float  # of the contact, at a slip that is fast
    cloth: float  # friction of the cloth
    gain: float = 0.0  # friction of the contact is more by gain exp(-decay slip), at the slip of the moment
    decay: float = 0.0  # [s/m]
    ratio: float = 1.0  # mass of the first ball over that of the second, the inertia with it; not used of a cushion
    sine: float = NOSE_SINE  # of the elevation at which a cushion's nose meets the ball; not used of two balls
    compliance: float = 0.0  # of the nose along its face over that along its normal; 0 where it is rigid (compliant.py)
    sink: float = 0.0  # share of a cushion's push on the slate that this does not return: 0 rigid, 1 none (Han 2005)


@compiled_in_place
def collide(cushion: bool, state: Array, law: ImpactLaw, r: float, steps: int = MIN_STEPS) -> None:
    """Carry a state (5 for a cushion, 10 for two balls) of balls of radius r [m] through an impact, in place.

    `steps`: of a whole impact, at least.
    """
    e, friction, cloth, gain, decay, ratio, sine, compliance, sink = law
    mu = (friction, gain, decay)
    if cushion:
        if state[1] < LEAST_APPROACH:
            return
        va, vb, wa, wb, wz = state[0], state[1], r * state[2], r * state[3], r * state[4]
        sn, cs = sine, math.sqrt(1.0 - sine * sine)
        firm = 1.0 - sink
        nose = Coupling(
            firm * sn * cs, -cs, 3.5, 2.5 + sn * sn + sink * cs * cs, 1.0 - 2.5 * sn, 2.5 - sn, firm * sn,
            -firm * cs, -cs * cs - sink * sn * sn, -firm * sn * cs, cs,
        )  # fmt: skip
        slips, u = (va + wb * sn - wz * cs, wa - vb * sn, va - wb, vb + wa), vb * cs
        if compliance > 0.0:
            p, f1, f2, g1, g2 = integrate_compliant(slips, u, e, CoulombLaw(mu, cloth, nose), compliance)
        else:
            p, f1, f2, g1, g2 = integrate(slips, u, e, CoulombLaw(mu, cloth, nose), steps)
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
    far = ratio if sign > 0.0 else 1.0 / ratio
    both = 1.0 + far
    pair = Coupling(0.0, -sign, 3.5 * both, 2.5 * both, sign, 2.5, 0.0, -sign, -both, 0.0, sign)
    slips = s1, s2, state[o + 1] + r * state[o + 2], state[o] - r * state[o + 3]
    p, f1, f2, g1, g2 = integrate(slips, u, e, CoulombLaw(mu, cloth, pair), steps)
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
def rebound_rows(velocity: Array, spin: Array, e: Array, friction: Array, cloth: float, r: float) -> None:
    """Carry balls through an impact with the cushion at +y, each with its restitution and friction (n,), in place.

    velocity, spin (n, 3) [m/s], [rad/s]; friction of the cloth; radius [m].
    """
    state = np.zeros(5)
    for k in range(e.size):
        state[0], state[1] = velocity[k, 0], velocity[k, 1]
        state[2], state[3], state[4] = spin[k, 0], spin[k, 1], spin[k, 2]
        collide(True, state, ImpactLaw(e[k], friction[k], cloth, 0.0, 0.0, 1.0, NOSE_SINE, 0.0, 0.0), r, MIN_STEPS)
        velocity[k, 0], velocity[k, 1] = state[0], state[1]
        spin[k, 0], spin[k, 1], spin[k, 2] = state[2], state[3], state[4]
