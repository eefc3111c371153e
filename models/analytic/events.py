"""Times at which a ball meets another one, a cushion or a pocket, while accelerations are constant.

Two balls: the squared distance is a quartic in time. Where the relative path is straight and does not turn back, its
touch is a quadratic along the line; otherwise the first fall through (2R)^2 is found between the roots of the
derivatives, so that none is missed, after a bound on the closest approach has excluded most pairs. A cushion is a
line at R cos(theta) before the nose line (Mathavan, Jackson, Parkin 2010); a pocket takes a ball whose centre passes
the nose line in its mouth, or comes within a corner's capture circle (Robotic Billiards 2015). A time of -1 says that
things are pressed together at rest. Jaws are circles to a centre, as balls are (models/analytic/pocket.py).
"""

from __future__ import annotations

import math

import numpy as np

from models.compiled import compiled, compiled_in_place

CLOSED_GAP_M = 1e-13  # gap [m], and squared distance [m^2], below which there is none
INSIDE_M = 1e-9  # depth in a rail above which it is not rounding [m]
DEAD_SPEED = 1e-3  # approach speed below which an impact has no restitution [m/s]
LEAN_SPEED = 1e-2  # approach speed that bodies in lasting contact may gain between two checks [m/s]
MIN_IMPACT_SPEED = 1e-9  # approach speed below which a touch is no impact [m/s]
STRAIGHT_SINE = 4e-16  # sine between velocity and acceleration below which it is rounding


@compiled
def _root(c, low, high, falling):  # type: ignore[no-untyped-def]
    """The root of a polynomial in an interval where it changes sign once: Newton, kept inside by bisection.

    c: its coefficients (5), the constant first.
    """
    c0, c1, c2, c3, c4 = c
    x = 0.5 * (low + high)
    for _ in range(100):
        f = c0 + x * (c1 + x * (c2 + x * (c3 + x * c4)))
        if f == 0.0:
            return x
        if (f > 0.0) == falling:
            low = x
        else:
            high = x
        slope = c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * 4.0 * c4))
        new = x - f / slope if slope != 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        if abs(new - x) <= 1e-16 + 2e-16 * abs(x):
            return new
        x = new
    return x


@compiled
def first_fall(c0, c1, c2, c3, c4, h):  # type: ignore[no-untyped-def]
    """First time in [0, h] at which a quartic that is not negative at 0 falls through zero; inf where it does not."""
    # Roots of the second derivative part the interval into pieces where the first is monotone.
    p, q = np.inf, np.inf
    a, b, c = 12.0 * c4, 6.0 * c3, 2.0 * c2
    if a != 0.0:
        disc = b * b - 4.0 * a * c
        if disc > 0.0:
            w = -0.5 * (b + math.copysign(math.sqrt(disc), b))
            p, q = w / a, (c / w if w != 0.0 else np.inf)
            if p > q:
                p, q = q, p
    elif b != 0.0:
        p = -c / b
    low, edge = 0.0, 0.0
    for piece in range(3):
        far = p if piece == 0 else (q if piece == 1 else h)
        if far <= edge:
            continue
        far = min(far, h)
        d0 = c1 + edge * (2.0 * c2 + edge * (3.0 * c3 + edge * 4.0 * c4))
        d1 = c1 + far * (2.0 * c2 + far * (3.0 * c3 + far * 4.0 * c4))
        turn = h
        if d0 < 0.0 < d1:
            turn = _root((c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0), edge, far, False)
        elif d0 > 0.0 > d1:
            low = _root((c1, 2.0 * c2, 3.0 * c3, 4.0 * c4, 0.0), edge, far, True)
        lowest = (d0 < 0.0 < d1) or far >= h
        if lowest and c0 + turn * (c1 + turn * (c2 + turn * (c3 + turn * c4))) < 0.0:
            if c0 + low * (c1 + low * (c2 + low * (c3 + low * c4))) <= 0.0:
                return low
            return _root((c0, c1, c2, c3, c4), low, turn, True)
        if far >= h:
            break
        edge = far
    return np.inf


@compiled
def meeting(path, distance, h):  # type: ignore[no-untyped-def]
    """First time in [0, h] at which a relative path comes within a distance; inf for none, -1 where pressed."""
    x, y, vx, vy, ax, ay = path
    c0 = x * x + y * y - distance * distance
    c1 = 2.0 * (x * vx + y * vy)
    v2, a2 = vx * vx + vy * vy, ax * ax + ay * ay
    if c0 > CLOSED_GAP_M:
        v, a = math.sqrt(v2), math.sqrt(a2)
        # What sets off from rest is left to the quartic: the line it takes is that of its acceleration.
        if (
            (v > 0.0 or a == 0.0)
            and abs(vx * ay - vy * ax) <= STRAIGHT_SINE * v * a
            and (a == 0.0 or v + a * h * math.copysign(1.0, vx * ax + vy * ay) >= -1e-9 * v)
        ):
            if c1 >= 0.0:
                return np.inf
            along, across = -0.5 * c1 / v, (x * vy - y * vx) / v
            room = distance * distance - across * across
            if room <= 0.0:
                return np.inf
            way = c0 / (along + math.sqrt(room))
            disc = v2 + 2.0 * math.copysign(a, vx * ax + vy * ay) * way
            if disc < 0.0:
                return np.inf
            t = 2.0 * way / (v + math.sqrt(disc))
            return t if t <= h else np.inf
        if h < 1e9:
            # The path keeps within a h^2 / 2 of the straight one.
            t = min(max(-0.5 * c1 / v2, 0.0), h) if v2 > 0.0 else 0.0
            px, py = x + vx * t, y + vy * t
            room = distance + 0.5 * a * h * h
            if px * px + py * py > room * room:
                return np.inf
            # The same for the chord from start to end, from which the path keeps within a h^2 / 8.
            ux, uy = h * vx + 0.5 * ax * h * h, h * vy + 0.5 * ay * h * h
            u2 = ux * ux + uy * uy
            t = min(max(-(x * ux + y * uy) / u2, 0.0), 1.0) if u2 > 0.0 else 0.0
            px, py = x + ux * t, y + uy * t
            room = distance + 0.125 * a * h * h
            if px * px + py * py > room * room:
                return np.inf
    c2, c3, c4 = v2 + x * ax + y * ay, vx * ax + vy * ay, 0.25 * a2
    if c0 > CLOSED_GAP_M:
        return first_fall(c0, c1, c2, c3, c4, h)
    if c1 < -MIN_IMPACT_SPEED:
        return 0.0
    if c1 <= MIN_IMPACT_SPEED:
        if c2 < 0.0:
            return -1.0
        c1 = 0.0
    return first_fall(c1, c2, c3, c4, 0.0, h)


@compiled
def line(gap, v, a, h):  # type: ignore[no-untyped-def]
    """The same for a straight line at a gap, approached at speed v and acceleration a."""
    if gap <= CLOSED_GAP_M:
        if v > MIN_IMPACT_SPEED:
            return 0.0
        if v >= -MIN_IMPACT_SPEED:
            return -1.0 if a > 0.0 else np.inf
        if a <= 0.0:
            return np.inf
        # From within a rail: out and back to the line, or to where it turns if it does not come out.
        inside = gap < -INSIDE_M
        t = (math.sqrt(max(v * v + 2.0 * a * gap, 0.0)) - v) / a if inside else -2.0 * v / a
        return t if t <= h else np.inf
    disc = v * v + 2.0 * a * gap
    if disc < 0.0:
        return np.inf
    low = v + math.sqrt(disc)
    t = 2.0 * gap / low if low > 0.0 else np.inf
    return t if t <= h else np.inf


@compiled_in_place
def in_mouth(along, rail, half, mouths):  # type: ignore[no-untyped-def]
    """Whether a ball at a rail (+x, -x, +y, -y), at `along` from its middle [m], is in a pocket's mouth."""
    k = rail // 2
    return mouths[0] > 0.0 and (abs(along) > half[1 - k] - mouths[0] or (k == 1 and abs(along) < mouths[1]))


@compiled_in_place
def mouth_sides(along, rail, half, mouths):  # type: ignore[no-untyped-def]
    """The sides of the mouth at a rail that `along` is in: the least and the largest place along the rail [m]."""
    k = rail // 2
    far = half[1 - k] - mouths[0]
    if abs(along) > far:
        return (far, np.inf) if along > 0.0 else (-np.inf, -far)
    return -mouths[1], mouths[1]
