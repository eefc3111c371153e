"""A cushion that gives way along its face as well: Stronge's compliant contact, integrated over time.

The nose is two massless springs. One along its normal loads with stiffness K and unloads with K / e^2, which gives back
e^2 of the work of compression; one along its face has the stiffness K / compliance, and is held by Coulomb friction at
the ball. A ball that grips winds up the second, which then turns its sidespin back. Stiffness itself cancels out: only
the ratio of the two counts. The cloth stays rigid, with Coulomb friction. Source: Stronge, Impact Mechanics, 2000,
chapter 5 (a sphere on a body of its own material: (2 - nu) / (2 - 2 nu), 1.2 for a metal, 1.5 for rubber).
Leaves out any mass of the rubber, and losses along its face.
"""

from __future__ import annotations

import math

from models.analytic.coulomb import CLOTH_MOBILITY, friction_at
from models.compiled import compiled

QUARTER_STEPS = 120  # steps of compression, and of restitution
MIN_COMPLIANCE = 0.002  # below it the spring along the face is too stiff for these steps
MAX_QUARTERS = 8  # number of quarter periods after which an impact is ended
CLOTH_SWEEPS = 2  # sweeps over the direction of friction at the cloth within a step


@compiled
def dragged(q1, q2, w1, w2, longest):  # type: ignore[no-untyped-def]
    """The extension q of a spring that grew by w and slips where it exceeds `longest`: its foot is dragged along q.

    The drag acts along the mean of the extensions before and after, to second order; where it is more than those it
    acts along the one after, which swings less.
    """
    extension = math.sqrt(q1 * q1 + q2 * q2)
    if extension <= longest:
        return q1, q2
    z1, z2 = q1 - w1, q2 - w2
    a = z1 * z1 + z2 * z2 - longest * longest
    b = q1 * z1 + q2 * z2 + longest * longest
    c = extension * extension - longest * longest
    if b > 0.0 and b * b > a * c:
        share = c / (b + math.sqrt(b * b - a * c))
        if share < 1.0:
            q1, q2 = (q1 - share * z1) / (1.0 + share), (q2 - share * z2) / (1.0 + share)
            extension = math.sqrt(q1 * q1 + q2 * q2)
    return q1 * longest / extension, q2 * longest / extension


@compiled
def integrate_compliant(slips, u, e, law, compliance):  # type: ignore[no-untyped-def]
    """Impulses over mass of a whole impact, as `integrate` of models/analytic/coulomb.py has them.

    `compliance`: stiffness along the normal over that along the face, above 0.
    """
    s1, s2, c1, c2 = slips
    ds, dc, a1, a2, b1, b2, p0, p1, du, uf, ug = law.coupling
    mu, cloth = law.friction, law.cloth
    soft = max(compliance, MIN_COMPLIANCE)
    # Time is such that compression alone is a quarter of a circle: the force is x / -du at a depth x.
    dt = 0.5 * math.pi / QUARTER_STEPS
    total = i1 = i2 = j1 = j2 = 0.0
    deepest, stiffness = 0.0, -1.0 / du  # depth where compression ended; 0 until then
    x, w1, w2 = 0.5 * dt * u, 0.5 * dt * s1, 0.5 * dt * s2  # depth, and by how much the extension grew last
    q1, q2 = w1, w2
    for _ in range(MAX_QUARTERS * QUARTER_STEPS):
        # Depth and extension half a step before, velocities at its end: a leapfrog.
        force = stiffness * x if deepest == 0.0 else stiffness * (deepest - (deepest - x) / (e * e))
        if force <= 0.0:
            break
        hold = friction_at(mu, math.sqrt(s1 * s1 + s2 * s2)) * force
        q1, q2 = dragged(q1, q2, w1, w2, hold * soft / stiffness)
        f1, f2 = -stiffness / soft * q1, -stiffness / soft * q2
        press = cloth * max(0.0, p0 * force + p1 * f2) * dt
        d1, d2 = c1 + dt * b1 * f1, c2 + dt * (dc * force + b2 * f2)
        g1, g2 = -d1 / CLOTH_MOBILITY, -d2 / CLOTH_MOBILITY
        if g1 * g1 + g2 * g2 > press * press:
            g1 = g2 = 0.0
            for _ in range(CLOTH_SWEEPS):
                m1, m2 = c1 + d1 + CLOTH_MOBILITY * g1, c2 + d2 + CLOTH_MOBILITY * g2
                size = math.sqrt(m1 * m1 + m2 * m2)
                g1, g2 = -press * m1 / size, -press * m2 / size
        before = u
        s1, s2 = s1 + dt * a1 * f1 + b1 * g1, s2 + dt * (ds * force + a2 * f2) + b2 * g2
        c1, c2 = d1 + CLOTH_MOBILITY * g1, d2 + CLOTH_MOBILITY * g2
        u += dt * (du * force + uf * f2) + ug * g2
        total += dt * force
        i1, i2, j1, j2 = i1 + dt * f1, i2 + dt * f2, j1 + g1, j2 + g2
        on = dt
        if deepest == 0.0 and u <= 0.0:
            # Compression ended within the step; from there on the nose unloads, in steps as much shorter.
            if e <= 0.0:
                break
            slowing, late = (before - u) / dt, u / (u - before) * dt
            deepest = x + 0.5 * slowing * (late - 0.5 * dt) ** 2
            on = 0.5 * (1.0 + e) * dt
            dt *= e
            x = deepest - 0.5 * slowing * (late + 0.5 * dt) ** 2
        else:
            x += u * dt
        w1, w2 = on * s1, on * s2
        q1, q2 = q1 + w1, q2 + w2
    return total, i1, i2, j1, j2
