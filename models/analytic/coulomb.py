"""Two slips under Coulomb friction, driven by one normal impulse: the equation behind every rigid impact.

With impulses over mass and spins as R omega, F and G the friction impulses at the contact and at the cloth,

    d(slip at the contact) = (0, ds) dP + (a1, a2) F + (b1, b2) G        |F| <= mu(slip),   F against the slip
    d(slip at the cloth)   = (0, dc) dP + (b1, b2) F + 7/2 G             |G| <= mu_cloth N,  N = max(0, p0 + p1 F2)
    d(approach)            = (du + uf F2 + ug G2) dP

It takes fourth-order steps whose length follows how fast a slip turns, comes to rest on a slip that ends, and then
holds it at zero, or lets it leave in the one direction that friction allows. Steps depend smoothly on the state, and
so does the result, but where a slip begins or ceases to stick.

(Mathavan, Jackson, Parkin 2010 and 2014, made of one form.) Compression ends where the approach speed is zero,
restitution where the work given back is e^2 times the work done. Friction at the contact follows its slip s of the
moment, mu(s) = a + b exp(-c s), never below 0 (the form that Alciatore, TP A.14, fitted to Marlow's figures); a slip
that sticks is held by mu(0). Leaves out friction of the cloth that depends on speed.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.compiled import compiled

MIN_STEPS = 4  # steps of a whole impact in which no slip turns
TURNING_TOLERANCE = (
    3e-7  # tolerance of the turning of a slip in a step, over approach speed; fits differentiate what comes out
)
MAX_SLIP_SHARE = 0.8  # largest part of the rest of a slip in one step
MAX_FRICTION_FADE = 0.25  # largest part of one step of the slip over which friction falls by a factor e
MAX_TURNS_PER_STEP = 2.0  # largest number of turns of that kind in one step
SNAP_SLIP = 1e-6  # slip times friction over approach speed below which friction stops it at once, if it can
STILL_SLIP = 2e-8  # slip times friction over approach speed below which there is no slip
CLOTH_MOBILITY = 3.5  # slip of a ball's lowest point per impulse at that point
MAX_STEPS = 4000  # largest number of steps, against endless loops
ALIGNED_SINE = 1e-10  # sine between a slip and its rate below which it is rounding
SLIP, STICK = 0, 1


class Coupling(NamedTuple):
    """How impulses change slips and the approach: the constants of the equations above, with masses of 1."""

    ds: float
    dc: float
    a1: float
    a2: float
    b1: float
    b2: float
    p0: float
    p1: float
    du: float
    uf: float
    ug: float


class CoulombLaw(NamedTuple):
    """Friction of an impact, and what it acts on."""

    friction: tuple[float, float, float]  # at the contact: (a, b, c) of `friction_at` [1], [1], [s/m]
    cloth: float  # friction of the cloth [1]
    coupling: Coupling


@compiled
def friction_at(mu, slip):  # type: ignore[no-untyped-def]
    """Friction a + b exp(-c slip) of a law mu = (a, b, c); a itself, to the last bit, where b is 0."""
    a, b, c = mu
    return a if b == 0.0 else max(a + b * math.exp(-c * slip), 0.0)


@compiled
def _rates(s1, s2, c1, c2, ms, mc, law):  # type: ignore[no-untyped-def]
    """Friction (F1, F2, G1, G2) per normal impulse for slips and whether they stick."""
    ds, dc, a1, a2, b1, b2, p0, p1, _, _, _ = law.coupling
    cloth = law.cloth
    if ms == STICK and mc == STICK:
        det = a2 * CLOTH_MOBILITY - b2 * b2
        f2, g2 = (b2 * dc - CLOTH_MOBILITY * ds) / det, (b2 * ds - a2 * dc) / det
        return 0.0, f2, 0.0, g2
    size = math.sqrt(c1 * c1 + c2 * c2)
    over = 1.0 / size if size > 0.0 else 0.0
    x, y = c1 * over, c2 * over
    if ms == STICK:
        f2 = (b2 * cloth * p0 * y - ds) / (a2 - b2 * cloth * p1 * y)
        press = cloth * max(0.0, p0 + p1 * f2)
        return b1 * press * x / a1, f2, -press * x, -press * y
    size = math.sqrt(s1 * s1 + s2 * s2)
    over = -friction_at(law.friction, size) / size if size > 0.0 else 0.0
    f1, f2 = s1 * over, s2 * over
    if mc == STICK:
        return f1, f2, -b1 * f1 / CLOTH_MOBILITY, -(dc + b2 * f2) / CLOTH_MOBILITY
    press = cloth * max(0.0, p0 + p1 * f2)
    return f1, f2, -press * x, -press * y


@compiled
def _modes(slips, still_s, still_c, ms, mc, law):  # type: ignore[no-untyped-def]
    """Which slips (s1, s2, c1, c2) at rest stick, and where to the others leave: (ms, mc, s1, s2, c1, c2)."""
    s1, s2, c1, c2 = slips
    ds, dc, a1, a2, b1, b2, p0, p1, _, _, _ = law.coupling
    x, y = still_s or ms == STICK, still_c or mc == STICK
    cloth, hold = law.cloth, friction_at(law.friction, 0.0)
    if x:  # directions in place of slips: what leaves does so at the friction of no slip
        law = CoulombLaw((hold, 0.0, 0.0), cloth, law.coupling)
    for choice in range(4):
        ms = STICK if x and choice in (0, 1) else SLIP
        mc = STICK if y and choice in (0, 2) else SLIP
        if (choice in (0, 1) and not x) or (choice in (0, 2) and not y):
            continue
        p, q, u, v = (0.0, 0.0, 0.0, 0.0)
        if not (x and ms == SLIP):
            p, q = s1, s2
        if not (y and mc == SLIP):
            u, v = c1, c2
        if (x and ms == SLIP) or (y and mc == SLIP):
            # The direction in which a slip leaves is the one that the friction against it leaves it.
            for _ in range(60):
                f1, f2, g1, g2 = _rates(p, q, u, v, ms, mc, law)
                change = 0.0
                if x and ms == SLIP:
                    size = math.sqrt(p * p + q * q)
                    grip = hold * max(a1, a2) / size if size > 0.0 else 0.0
                    n1, n2 = a1 * f1 + b1 * g1 + grip * p, ds + a2 * f2 + b2 * g2 + grip * q
                    size = math.sqrt(n1 * n1 + n2 * n2)
                    if size > 0.0:
                        n1, n2 = n1 / size, n2 / size
                    change += abs(n1 - p) + abs(n2 - q)
                    p, q = n1, n2
                if y and mc == SLIP:
                    size = math.sqrt(u * u + v * v)
                    press = cloth * max(0.0, p0 + p1 * f2)
                    grip = CLOTH_MOBILITY * press / size if size > 0.0 else 0.0
                    n1, n2 = b1 * f1 + CLOTH_MOBILITY * g1 + grip * u, dc + b2 * f2 + CLOTH_MOBILITY * g2 + grip * v
                    size = math.sqrt(n1 * n1 + n2 * n2)
                    if size > 0.0:
                        n1, n2 = n1 / size, n2 / size
                    change += abs(n1 - u) + abs(n2 - v)
                    u, v = n1, n2
                if change < 1e-14:
                    break
        f1, f2, g1, g2 = _rates(p, q, u, v, ms, mc, law)
        press = cloth * max(0.0, p0 + p1 * f2)
        over = (ms == STICK and f1 * f1 + f2 * f2 > hold * hold) or (mc == STICK and g1 * g1 + g2 * g2 > press * press)
        if not over or choice == 3:
            return ms, mc, p, q, u, v
    return SLIP, SLIP, s1, s2, c1, c2


@compiled
def _runge_kutta(slips, ms, mc, h, first, law):  # type: ignore[no-untyped-def]
    """Friction of a step h that begins with `first` (F1, F2, G1, G2), from slips (s1, s2, c1, c2).

    Its mean, and the F2, G2 that work takes, from a double integral.
    """
    s1, s2, c1, c2 = slips
    f1, f2, g1, g2 = first
    ds, dc, a1, a2, b1, b2, _, _, _, _, _ = law.coupling
    m1, m2, n1, n2 = f1, f2, g1, g2
    for stage in range(3):
        d = h if stage == 2 else 0.5 * h
        x1, x2 = s1 + d * (a1 * f1 + b1 * g1), s2 + d * (ds + a2 * f2 + b2 * g2)
        y1, y2 = c1 + d * (b1 * f1 + CLOTH_MOBILITY * g1), c2 + d * (dc + b2 * f2 + CLOTH_MOBILITY * g2)
        f1, f2, g1, g2 = _rates(x1, x2, y1, y2, ms, mc, law)
        if stage < 2:
            m1, m2, n1, n2 = m1 + 2.0 * f1, m2 + 2.0 * f2, n1 + 2.0 * g1, n2 + 2.0 * g2
            if stage == 0:
                w2, v2 = m2 - f2, n2 - g2
            else:
                w2, v2 = w2 + f2, v2 + g2
        else:
            m1, m2, n1, n2 = m1 + f1, m2 + f2, n1 + g1, n2 + g2
    return m1 / 6.0, m2 / 6.0, n1 / 6.0, n2 / 6.0, w2 / 6.0, v2 / 6.0


@compiled
def _reach(x, y, dx, dy, weight, grip, fine):  # type: ignore[no-untyped-def]
    """Largest change of a slip in one step before it turns too much, from its rate and its friction."""
    rate = math.sqrt(dx * dx + dy * dy)
    if weight <= 0.0 or rate == 0.0:
        return np.inf
    size = math.sqrt(x * x + y * y)
    past = weight * abs(x * dy - y * dx) / rate  # how near to zero it will come, were it to go straight on
    if past <= ALIGNED_SINE * weight * size:
        return MAX_SLIP_SHARE * size / rate if x * dx + y * dy < 0.0 else np.inf
    h = size / rate * math.sqrt(math.sqrt(fine / past))
    # Friction turns a slip towards its course at the rate grip / size, beyond which a step would swing about it.
    stable = MAX_TURNS_PER_STEP * size / (weight * grip)
    if x * dx + y * dy < 0.0:
        return min(h, MAX_SLIP_SHARE * size / rate, stable)
    return min(h, stable * max(1.0, 0.01 * fine / past))


@compiled
def _fade(size, rate, rub, hold, grip, mu):  # type: ignore[no-untyped-def]
    """Largest change of a slip in one step before its friction changes too much."""
    steep = mu[2] * max(rate, grip * abs(rub - mu[0]))
    h = MAX_FRICTION_FADE / steep if steep > 0.0 else np.inf
    # Friction that grows as the slip ends may end it sooner than the present rate says.
    return min(h, MAX_SLIP_SHARE * size / (rate + grip * (hold - rub))) if hold > rub else h


@compiled
def integrate(slips, u, e, law, steps):  # type: ignore[no-untyped-def]
    """Impulses over mass of a whole impact, (P, F1, F2, G1, G2), that begins with slips (s1, s2, c1, c2) [m/s].

    u: approach speed [m/s]; e: restitution; `law`: a `CoulombLaw`; `steps` of the whole, at least.
    """
    s1, s2, c1, c2 = slips
    ds, dc, a1, a2, b1, b2, p0, p1, du, uf, ug = law.coupling
    mu, cloth = law.friction, law.cloth
    start, hold = u, friction_at(mu, 0.0)
    longest = (1.0 + e) * u / (-du * steps)
    fine = TURNING_TOLERANCE * start * (MIN_STEPS / steps) ** 4
    total = i1 = i2 = j1 = j2 = work = 0.0
    most = -1.0
    ms = mc = SLIP
    none = STILL_SLIP * start
    for _ in range(MAX_STEPS * (1 + steps)):
        f1, f2, g1, g2 = _rates(s1, s2, c1, c2, ms, mc, law)
        press = cloth * max(0.0, p0 + p1 * f2)
        r1, r2 = a1 * f1 + b1 * g1, ds + a2 * f2 + b2 * g2
        q1, q2 = b1 * f1 + CLOTH_MOBILITY * g1, dc + b2 * f2 + CLOTH_MOBILITY * g2
        size_s, size_c = math.sqrt(s1 * s1 + s2 * s2), math.sqrt(c1 * c1 + c2 * c2)
        rub = friction_at(mu, size_s)
        if ms == SLIP and rub * size_s < SNAP_SLIP * start:
            f1, f2, g1, g2 = _rates(s1, s2, c1, c2, STICK, mc, law)
            press = cloth * max(0.0, p0 + p1 * f2)
            if f1 * f1 + f2 * f2 < hold * hold and (mc == SLIP or g1 * g1 + g2 * g2 < press * press):
                # What is left of the slip is stopped at once: the impulse that takes is known, its course matters not.
                f1, f2 = -s1 / a1, -s2 / a2
                i1, i2 = i1 + f1, i2 + f2
                if mc == SLIP:
                    c1, c2 = c1 + b1 * f1, c2 + b2 * f2
                u += uf * f2
                ms, s1, s2 = STICK, 0.0, 0.0
                continue
            f1, f2, g1, g2 = _rates(s1, s2, c1, c2, ms, mc, law)
            press = cloth * max(0.0, p0 + p1 * f2)
        still_s = ms == SLIP and rub * size_s < none and s1 * r1 + s2 * r2 <= 0.0
        still_c = mc == SLIP and press * size_c < none and c1 * q1 + c2 * q2 <= 0.0
        over = (ms == STICK and f1 * f1 + f2 * f2 > hold * hold * (1.0 + 1e-12)) or (
            mc == STICK and g1 * g1 + g2 * g2 > press * press * (1.0 + 1e-12)
        )
        if still_s or still_c or over:
            x, y = still_s or ms == STICK, still_c or mc == STICK
            ms, mc, p, q, v, w = _modes((s1, s2, c1, c2), still_s, still_c, ms, mc, law)
            # A slip that leaves is given a trace of its direction.
            if ms == STICK:
                s1 = s2 = 0.0
            elif x:
                s1, s2 = none * p, none * q
            if mc == STICK:
                c1 = c2 = 0.0
            elif y:
                c1, c2 = none * v, none * w
            f1, f2, g1, g2 = _rates(s1, s2, c1, c2, ms, mc, law)
            press = cloth * max(0.0, p0 + p1 * f2)
            r1, r2 = a1 * f1 + b1 * g1, ds + a2 * f2 + b2 * g2
            q1, q2 = b1 * f1 + CLOTH_MOBILITY * g1, dc + b2 * f2 + CLOTH_MOBILITY * g2
        h = longest
        if ms == SLIP:
            h = min(h, _reach(s1, s2, r1, r2, rub, a1, fine))
            if mu[1] != 0.0:
                h = min(h, _fade(size_s, math.sqrt(r1 * r1 + r2 * r2), rub, hold, a1, mu))
        if mc == SLIP:
            h = min(h, _reach(c1, c2, q1, q2, press, CLOTH_MOBILITY, fine))
        h = max(h, 1e-9 * longest)
        slips, first = (s1, s2, c1, c2), (f1, f2, g1, g2)
        # The last step ends where the work does, by Newton on the root of the work still owed, which is nearly linear.
        for attempt in range(6):
            f1, f2, g1, g2, w2, v2 = _runge_kutta(slips, ms, mc, h, first, law)
            if attempt == 0 and ms + mc == 1:
                held = _held(slips, ms, mc, h, (f1, f2, g1, g2), first, law)
                if held < h:
                    h = held
                    f1, f2, g1, g2, w2, v2 = _runge_kutta(slips, ms, mc, h, first, law)
            after = u + h * (du + uf * f2 + ug * g2)
            gain = h * u + h * h * (0.5 * du + uf * w2 + ug * v2)
            if attempt == 0:
                if after > 0.0:
                    break
                if most < 0.0:
                    most = work + _top(u, after, gain, h)
                    if e == 0.0:
                        h *= u / (u - after)
                        continue
            if e == 0.0:
                done = abs(after) <= 1e-6 * start
                slope = (after - u) / h
                shift = -after / slope
            else:
                owed = max(most - work - gain, 0.0)
                root, goal = math.sqrt(owed), e * math.sqrt(most)
                if attempt == 0 and root < goal:
                    break
                shift = (goal - root) * 2.0 * root / (-after) if after < 0.0 else -0.5 * h
                done = abs(shift) <= 1e-6 * longest
            if done or attempt == 5:
                # The rest at the friction of the end.
                i1, i2, j1, j2 = i1 + h * f1, i2 + h * f2, j1 + h * g1, j2 + h * g2
                s1, s2 = s1 + h * (a1 * f1 + b1 * g1), s2 + h * (ds + a2 * f2 + b2 * g2)
                c1, c2 = c1 + h * (b1 * f1 + CLOTH_MOBILITY * g1), c2 + h * (dc + b2 * f2 + CLOTH_MOBILITY * g2)
                f1, f2, g1, g2 = _rates(s1, s2, c1, c2, ms, mc, law)
                return total + h + shift, i1 + shift * f1, i2 + shift * f2, j1 + shift * g1, j2 + shift * g2
            h = max(h + shift, 1e-3 * h)
        total, work, u = total + h, work + gain, after
        i1, i2, j1, j2 = i1 + h * f1, i2 + h * f2, j1 + h * g1, j2 + h * g2
        s1, s2 = s1 + h * (a1 * f1 + b1 * g1), s2 + h * (ds + a2 * f2 + b2 * g2)
        c1, c2 = c1 + h * (b1 * f1 + CLOTH_MOBILITY * g1), c2 + h * (dc + b2 * f2 + CLOTH_MOBILITY * g2)
    return total, i1, i2, j1, j2


@compiled
def _top(u, after, gain, h):  # type: ignore[no-untyped-def]
    """Most work within a step in which the approach ends: its integral through (0, u), (h, after), with this area."""
    # u(t) = u + (after - u) x + c x (1 - x), x = t / h; its mean is gain / h.
    c = 6.0 * (gain / h - 0.5 * (u + after))
    x = u / (u - after)
    for _ in range(8):
        f = u + (after - u) * x + c * x * (1.0 - x)
        x -= f / (after - u + c * (1.0 - 2.0 * x))
    return h * x * (u + 0.5 * (after - u) * x + c * x * (0.5 - x / 3.0))


@compiled
def _held(slips, ms, mc, h, mean, first, law):  # type: ignore[no-untyped-def]
    """The part of a step h during which sticking contacts stick; usually all of it.

    `first`, `mean`: friction (F1, F2, G1, G2) at the beginning of the step, and its mean.
    """
    s1, s2, c1, c2 = slips
    f1, f2, g1, g2 = mean
    ds, dc, a1, a2, b1, b2, p0, p1, _, _, _ = law.coupling
    cloth, hold = law.cloth, friction_at(law.friction, 0.0)
    low, high, x = 0.0, h, h
    for _ in range(50):
        if x < h:
            f1, f2, g1, g2, _, _ = _runge_kutta(slips, ms, mc, x, first, law)
        x1, x2 = s1 + x * (a1 * f1 + b1 * g1), s2 + x * (ds + a2 * f2 + b2 * g2)
        y1, y2 = c1 + x * (b1 * f1 + CLOTH_MOBILITY * g1), c2 + x * (dc + b2 * f2 + CLOTH_MOBILITY * g2)
        f1, f2, g1, g2 = _rates(x1, x2, y1, y2, ms, mc, law)
        press = cloth * max(0.0, p0 + p1 * f2)
        # A little beyond, so that the end is seen as such.
        limit = 1.0 + 1e-10
        if (ms == STICK and f1 * f1 + f2 * f2 > limit * hold * hold) or (
            mc == STICK and g1 * g1 + g2 * g2 > limit * press * press
        ):
            high = x
        else:
            low = x
            if x == h:
                return h
        x = 0.5 * (low + high)
    return high
