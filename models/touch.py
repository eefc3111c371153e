"""When do balls touch next, while every acceleration is constant? Compiled, one simulation after another.

Two balls: the squared distance is a quartic in time; its first fall through (2R)^2 is found between the roots of its
derivatives, so that none is missed. A cushion is a line at R cos(theta) before the nose line, a pocket takes a ball
whose centre passes the nose line at its mouth, or comes within the corner's capture circle.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]

BALL, CUSHION, POCKET = 1, 2, 3
PUSH_STEP = 4e-4  # step while something is pressed against something without moving [s]: 2.4 m/s^2 stay below DEAD
LEAN_STEP = 2e-3  # between two looks at what leans [s]
LEAN = 1e-2  # approach speed that leaning may come to meanwhile [m/s]
DEAD = 1e-3  # approach speed below which an impact gives nothing back [m/s]
AWAY = 1e-9  # approach speed below which a touch is no impact [m/s]


@njit(cache=True)
def _value(c: Array, t: float) -> float:
    total = 0.0
    for k in range(c.size - 1, -1, -1):
        total = total * t + c[k]
    return total


@njit(cache=True)
def _root(c: Array, low: float, high: float) -> float:
    """The root of a polynomial in an interval where it changes sign once: bisection, then Newton kept inside."""
    flow = _value(c, low)
    x = 0.5 * (low + high)
    for _ in range(80):
        f = _value(c, x)
        if f == 0.0 or high - low < 1e-16:
            break
        if (f > 0.0) == (flow > 0.0):
            low = x
        else:
            high = x
        slope = 0.0
        for k in range(c.size - 1, 0, -1):
            slope = slope * x + k * c[k]
        new = x - f / slope if slope != 0.0 else low
        x_next = new if low < new < high else 0.5 * (low + high)
        if abs(x_next - x) < 1e-15 * (1.0 + abs(x)):
            x = x_next
            break
        x = x_next
    return x


@njit(cache=True)
def _breaks(c: Array, h: float, inner: Array, count: int, out: Array) -> int:
    """Roots of c within (0, h), given the `count` roots of its derivative there; returns how many."""
    found = 0
    low = 0.0
    for k in range(count + 1):
        high = inner[k] if k < count else h
        if high > low and (_value(c, low) > 0.0) != (_value(c, high) > 0.0):
            out[found] = _root(c, low, high)
            found += 1
        low = high
    return found


@njit(cache=True)
def first_fall(c: Array, h: float) -> float:
    """First time in [0, h] at which a quartic that is not negative at 0 falls through zero; inf where it does not."""
    n = c.size - 1
    chain = np.zeros((n, n + 1))  # derivatives
    chain[0, : n + 1] = c
    for d in range(1, n):
        for k in range(n + 1 - d):
            chain[d, k] = chain[d - 1, k + 1] * (k + 1)
    inner, outer = np.zeros(n + 1), np.zeros(n + 1)
    count = 0
    for d in range(n - 1, 0, -1):
        count = _breaks(chain[d, : n + 1 - d], h, inner, count, outer)
        inner, outer = outer, inner
    low = 0.0
    for k in range(count + 1):
        high = inner[k] if k < count else h
        if high > low and _value(c, high) < 0.0:
            if _value(c, low) <= 0.0:
                return low
            return _root(c, low, high)
        low = high
    return np.inf


@njit(cache=True)
def _fall(c: Array, h: float) -> float:
    """Time of touch for a gap c0 + c1 t + ...; 0 where it is closed and closing, -1 where it is pressed at rest."""
    if c[0] <= 1e-13:
        if c[1] < -AWAY:
            return 0.0
        shifted = c[1:].copy()
        if abs(shifted[0]) <= AWAY:
            if shifted[1] < 0.0:
                return -1.0
            shifted[0] = 0.0
        return first_fall(shifted, h)
    return first_fall(c, h)


@njit(cache=True)
def _line(gap: float, v: float, a: float, h: float) -> float:
    """The same for a straight line, approached at speed v and acceleration a."""
    if gap <= 1e-13:
        if v > AWAY:
            return 0.0
        if abs(v) <= AWAY:
            return -1.0 if a > 0.0 else np.inf
        t = -2.0 * v / a if a > 0.0 else np.inf
        return t if t <= h else np.inf
    # gap = v t + a t^2 / 2, in the form that loses no digits
    disc = v * v + 2.0 * a * gap
    if disc < 0.0:
        return np.inf
    low = v + math.sqrt(disc)
    t = 2.0 * gap / low if low > 0.0 else np.inf
    return t if t <= h else np.inf


@njit(cache=True)
def in_mouth(along: float, rail: int, half: Array, mouths: Array) -> bool:
    """Whether a ball at a rail (+x, -x, +y, -y), at `along` from its middle, is in a pocket's mouth."""
    k = rail // 2
    return mouths[0] > 0.0 and (abs(along) > half[1 - k] - mouths[0] or (k == 1 and abs(along) < mouths[1]))


@njit(cache=True)
def next_touch(
    position: Array,
    velocity: Array,
    acceleration: Array,
    alive: NDArray[np.bool_],
    radius: float,
    reach: Array,
    half: Array,
    mouths: Array,
    what: NDArray[np.bool_],
    quiet: Array,
    limit: Array,
) -> tuple[Array, NDArray[np.int64]]:
    """The step to the next touch of every simulation, at most `limit`, and what it is: (nsim,), (nsim, 3).

    Positions (nsim, nball, 3); `reach` and `half` (2,): where centres meet the cushions, and the nose lines;
    `mouths` (corner, middle, capture) [m], zeros on a table without pockets; `what`: balls?, cushions?
    `quiet` (nsim, nball, nball + 4): for how long bodies that lean on each other need no other look [s].
    """
    nsim, nball = alive.shape
    step, hit = limit.copy(), np.zeros((nsim, 3), np.int64)
    c = np.zeros(5)
    diameter = 2.0 * radius
    for s in range(nsim):
        h = limit[s]
        push = h
        for i in range(nball):
            if not alive[s, i]:
                continue
            p, v, a = position[s, i], velocity[s, i], acceleration[s, i]
            moving = v[0] != 0.0 or v[1] != 0.0 or a[0] != 0.0 or a[1] != 0.0
            if moving and (what[1] or mouths[0] > 0.0):
                for rail in range(4):
                    k = rail // 2
                    sign = 1.0 - 2.0 * (rail % 2)
                    t = _line(reach[k] - sign * p[k], sign * v[k], sign * a[k], h)
                    if t == np.inf:
                        continue
                    if t < 0.0:
                        push = min(push, PUSH_STEP) if what[1] else push
                        continue
                    if quiet[s, i, nball + rail] > t and sign * (v[k] + a[k] * t) < LEAN:
                        t = quiet[s, i, nball + rail]
                    o = 1 - k
                    if in_mouth(p[o] + v[o] * t + 0.5 * a[o] * t * t, rail, half, mouths):
                        t = _line(half[k] - sign * p[k], sign * v[k], sign * a[k], h)
                        if 0.0 <= t < h:
                            h, hit[s, 0], hit[s, 1], hit[s, 2] = t, POCKET, i, rail
                    elif what[1] and (t < h or (t == h and hit[s, 0] == 0)):
                        h, hit[s, 0], hit[s, 1], hit[s, 2] = t, CUSHION, i, rail
            if moving and mouths[0] > 0.0:
                qx, qy = abs(p[0]) - half[0], abs(p[1]) - half[1]
                sx, sy = math.copysign(1.0, p[0]), math.copysign(1.0, p[1])
                t = _circle(c, qx, qy, sx * v[0], sy * v[1], sx * a[0], sy * a[1], mouths[2], h)
                if 0.0 <= t < h:
                    h, hit[s, 0], hit[s, 1], hit[s, 2] = t, POCKET, i, -1
            if not what[0]:
                continue
            for j in range(i):
                if not alive[s, j]:
                    continue
                q, w, b = position[s, j], velocity[s, j], acceleration[s, j]
                t = _circle(
                    c, p[0] - q[0], p[1] - q[1], v[0] - w[0], v[1] - w[1], a[0] - b[0], a[1] - b[1], diameter, h
                )
                if t == -1.0:
                    push = min(push, PUSH_STEP)
                    continue
                if quiet[s, j, i] > t:
                    x, y = (p[0] - q[0]) + t * (v[0] - w[0]), (p[1] - q[1]) + t * (v[1] - w[1])
                    closing = (
                        -(x * (v[0] - w[0] + t * (a[0] - b[0])) + y * (v[1] - w[1] + t * (a[1] - b[1]))) / diameter
                    )
                    t = quiet[s, j, i] if closing < LEAN else t
                if t < h:
                    h, hit[s, 0], hit[s, 1], hit[s, 2] = t, BALL, j, i
        if push < h:
            h, hit[s, 0] = push, 0
        step[s] = h
    return step, hit


@njit(cache=True)
def _circle(
    c: Array, x: float, y: float, vx: float, vy: float, ax: float, ay: float, distance: float, h: float
) -> float:
    """When does a relative motion come within a distance? As `_fall`."""
    gap = math.sqrt(x * x + y * y) - distance
    if gap > math.sqrt(vx * vx + vy * vy) * h + 0.5 * math.sqrt(ax * ax + ay * ay) * h * h:
        return np.inf
    c[0] = x * x + y * y - distance * distance
    c[1] = 2.0 * (x * vx + y * vy)
    c[2] = vx * vx + vy * vy + x * ax + y * ay
    c[3] = vx * ax + vy * ay
    c[4] = 0.25 * (ax * ax + ay * ay)
    return _fall(c, h)


@njit(cache=True)
def native_step(
    position: Array,
    velocity: Array,
    acceleration: Array,
    alive: NDArray[np.bool_],
    radius: float,
    reach: Array,
    what: NDArray[np.bool_],
    fine: Array,
    coarse: Array,
) -> Array:
    """A safe step where MuJoCo's own contacts act: not beyond the next touch, fine while touching."""
    nsim, nball = alive.shape
    step = coarse.copy()
    for s in range(nsim):
        for i in range(nball):
            if not alive[s, i]:
                continue
            p, v, a = position[s, i], velocity[s, i], acceleration[s, i]
            if what[1]:
                for k in range(2):
                    for sign in (-1.0, 1.0):
                        gap = reach[k] - sign * p[k]
                        step[s] = min(step[s], _safe(gap, sign * v[k], sign * a[k], fine[s]))
            if what[0]:
                for j in range(i):
                    if alive[s, j]:
                        x, y = p[0] - position[s, j, 0], p[1] - position[s, j, 1]
                        d = math.sqrt(x * x + y * y)
                        x, y = x / max(d, 1e-12), y / max(d, 1e-12)
                        closing = -(x * (v[0] - velocity[s, j, 0]) + y * (v[1] - velocity[s, j, 1]))
                        faster = -(x * (a[0] - acceleration[s, j, 0]) + y * (a[1] - acceleration[s, j, 1]))
                        step[s] = min(step[s], _safe(d - 2.0 * radius, closing, faster, fine[s]))
    return step


@njit(cache=True)
def _safe(gap: float, closing: float, faster: float, fine: float) -> float:
    """Time until a gap is closed, at a speed and its growth; `fine` while it is."""
    if gap <= 0.0:
        return fine if abs(closing) > 1e-6 else np.inf
    disc = closing * closing + 2.0 * faster * gap
    if disc < 0.0:
        return np.inf
    speed = closing + math.sqrt(disc)
    return max(fine, 2.0 * gap / speed) if speed > 0.0 else np.inf
