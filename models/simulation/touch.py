"""When do balls touch next, while every acceleration is constant? Compiled, one simulation after another.

Times of touch are those of models/analytic/events.py. A cushion is a line at R cos(theta) before the nose line, a
pocket takes a ball whose centre passes the nose line at its mouth, or comes within the corner's capture circle; or it
has jaws and an edge (models/analytic/pocket.py).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from models.analytic.events import LEAN_SPEED, in_mouth, line, meeting, mouth_sides
from models.analytic.pocket import meet_jaw, outward, straight
from models.compiled import compiled, compiled_within
from models.engine.touch import LEAN_SHARE, MOUTH_DEPTH_M

Array = NDArray[np.float64]

BALL, CUSHION, POCKET = 1, 2, 3
PUSH_STEP = (
    4e-4  # step while something is pressed against something without moving [s]: 2.4 m/s^2 stay below DEAD_SPEED
)
LEAN_STEP = 1e-3  # between two looks at what leans, at most [s]


@compiled
def _looked_at(t, quiet, closing, faster):  # type: ignore[no-untyped-def]
    """When a touch at t is looked at, of what leans until `quiet`: before that only where it gets too fast to lean.

    It closes at `closing` + `faster` t. What leans gives nothing back, so it must not come to more than LEAN_SPEED.
    """
    if quiet <= t or closing + faster * t >= LEAN_SPEED:
        return t
    if faster > 0.0:
        quiet = min(quiet, (LEAN_SHARE * LEAN_SPEED - closing) / faster)
    return max(t, quiet)


@compiled_within
def _meet_rails(  # type: ignore[no-untyped-def]
    i, p, v, a, nball, limits, half, mouths, pockets, bent, cushions, quiet, hit, h, push
):  # fmt: skip
    """The step to the first straight cushion that ball i meets, or the pocket beside it, and `push`, if sooner."""
    for rail in range(4):
        k = rail // 2
        sign = 1.0 - 2.0 * (rail % 2)
        o, inside = 1 - k, False
        if pockets and not bent and limits[k] - sign * p[k] < -MOUTH_DEPTH_M:
            inside = in_mouth(p[o], rail, half, mouths)
        for side in range(2 if inside else 0):  # it is the pocket's where it would leave it sideways
            way, level = 1.0 - 2.0 * side, mouth_sides(p[o], rail, half, mouths)[1 - side]
            t = line(way * (level - p[o]), way * v[o], way * a[o], h) if abs(level) < np.inf else np.inf
            if 0.0 <= t < h and limits[k] - sign * (p[k] + v[k] * t + 0.5 * a[k] * t * t) < -MOUTH_DEPTH_M:
                h, hit[0], hit[1], hit[2] = t, POCKET, i, rail
        if bent:
            t = straight(rail, limits, p, v, a, half, mouths, h)
        else:
            t = line(limits[k] - sign * p[k], sign * v[k], sign * a[k], h)
        if t == np.inf:
            continue
        if t < 0.0:
            push = min(push, PUSH_STEP) if cushions else push
            continue
        t = _looked_at(t, quiet[nball + rail], sign * v[k], sign * a[k])
        if pockets and in_mouth(p[o] + v[o] * t + 0.5 * a[o] * t * t, rail, half, mouths):
            if bent:
                continue
            if not inside:  # once it is in the mouth, it is looked at again
                t = line(limits[k] + 2.0 * MOUTH_DEPTH_M - sign * p[k], sign * v[k], sign * a[k], h)
                if 0.0 <= t < h:
                    h, hit[0] = t, 0
                continue
            t = line(half[k] - sign * p[k], sign * v[k], sign * a[k], h)
            if 0.0 <= t < h:
                h, hit[0], hit[1], hit[2] = t, POCKET, i, rail
        elif cushions and (t < h or (t == h and hit[0] == 0)):
            h, hit[0], hit[1], hit[2] = t, CUSHION, i, rail
    return h, push


@compiled_within
def _meet_jaws(i, p, v, a, nball, jaws, edges, quiet, hit, h, push):  # type: ignore[no-untyped-def]
    """The same for the falls of pockets, and their jaws."""
    for k in range(edges.shape[0]):
        t = meeting(p[0] - edges[k, 0], p[1] - edges[k, 1], v[0], v[1], a[0], a[1], edges[k, 2], h)
        if 0.0 <= t < h:
            h, hit[0], hit[1], hit[2] = t, POCKET, i, k
    for k in range(jaws.shape[0]):
        t = meet_jaw(jaws[k], p[0], p[1], v[0], v[1], a[0], a[1], h)
        if t == -1.0:
            push = min(push, PUSH_STEP)
            continue
        if quiet[nball + 4 + k] > t:
            x, y = outward(4 + k, p[0] + v[0] * t, p[1] + v[1] * t, jaws)
            t = _looked_at(t, quiet[nball + 4 + k], x * v[0] + y * v[1], x * a[0] + y * a[1])
        if t < h or (t == h and hit[0] == 0):
            h, hit[0], hit[1], hit[2] = t, CUSHION, i, 4 + k
    return h, push


@compiled_within
def _meet_balls(  # type: ignore[no-untyped-def]
    i, p, v, a, position, velocity, acceleration, alive, diameter, quiet, hit, h, push
):  # fmt: skip
    """The same for the balls before ball i."""
    for j in range(i):
        if not alive[j]:
            continue
        q, w, b = position[j], velocity[j], acceleration[j]
        t = meeting(p[0] - q[0], p[1] - q[1], v[0] - w[0], v[1] - w[1], a[0] - b[0], a[1] - b[1], diameter, h)
        if t == -1.0:
            push = min(push, PUSH_STEP)
            continue
        if quiet[j, i] > t:
            x, y = (q[0] - p[0] - t * (v[0] - w[0])) / diameter, (q[1] - p[1] - t * (v[1] - w[1])) / diameter
            closing, faster = x * (v[0] - w[0]) + y * (v[1] - w[1]), x * (a[0] - b[0]) + y * (a[1] - b[1])
            t = _looked_at(t, quiet[j, i], closing, faster)
        if t < h:
            h, hit[0], hit[1], hit[2] = t, BALL, j, i
    return h, push


@compiled
def next_touch(
    position: Array,
    velocity: Array,
    acceleration: Array,
    alive: NDArray[np.bool_],
    radius: float,
    limits: Array,
    half: Array,
    mouths: Array,
    jaws: Array,
    edges: Array,
    falls: NDArray[np.bool_],
    what: NDArray[np.bool_],
    quiet: Array,
    limit: Array,
) -> tuple[Array, NDArray[np.int64]]:
    """The step to the next touch of every simulation, at most `limit`, and what it is: (nsim,), (nsim, 3).

    Positions (nsim, nball, 3); `limits` and `half` (2,): where centres meet the cushions, and the nose lines;
    `mouths` (corner, middle, capture) [m], zeros on a table without pockets; where pockets have jaws the ends of
    the straight cushions, `jaws` and `edges` the falls of models/analytic/pocket.py, otherwise of no rows;
    `falls` (nsim, nball): which balls a pocket takes; `what`: balls?, cushions?
    `quiet` (nsim, nball, nball + 4 + jaws): for how long bodies that lean on each other need no other look [s].
    """
    nsim, nball = alive.shape
    step, hit = limit.copy(), np.zeros((nsim, 3), np.int64)
    diameter = 2.0 * radius
    for s in range(nsim):
        h = limit[s]
        push = h
        for i in range(nball):
            if not alive[s, i]:
                continue
            p, v, a = position[s, i], velocity[s, i], acceleration[s, i]
            moving = v[0] != 0.0 or v[1] != 0.0 or a[0] != 0.0 or a[1] != 0.0
            pockets = mouths[0] > 0.0 and (falls[s, i] or not what[1])  # native cushions have gaps
            bent = pockets and edges.shape[0] > 0
            if moving and (what[1] or pockets):
                h, push = _meet_rails(
                    i, p, v, a, nball, limits, half, mouths, pockets, bent, what[1], quiet[s, i], hit[s], h, push
                )
            if moving and bent:
                h, push = _meet_jaws(i, p, v, a, nball, jaws, edges, quiet[s, i], hit[s], h, push)
            elif moving and pockets:
                qx, qy = abs(p[0]) - half[0], abs(p[1]) - half[1]
                sx, sy = math.copysign(1.0, p[0]), math.copysign(1.0, p[1])
                t = meeting(qx, qy, sx * v[0], sy * v[1], sx * a[0], sy * a[1], mouths[2], h)
                if 0.0 <= t < h:
                    h, hit[s, 0], hit[s, 1], hit[s, 2] = t, POCKET, i, -1
            if what[0]:
                h, push = _meet_balls(
                    i, p, v, a, position[s], velocity[s], acceleration[s], alive[s], diameter, quiet[s], hit[s], h, push
                )
        if push < h:
            h, hit[s, 0] = push, 0
        step[s] = h
    return step, hit


@compiled
def native_step(
    position: Array,
    velocity: Array,
    acceleration: Array,
    alive: NDArray[np.bool_],
    radius: float,
    limits: Array,
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
                        gap = limits[k] - sign * p[k]
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


@compiled
def _safe(gap: float, closing: float, faster: float, fine: float) -> float:
    """Time until a gap is closed, at a speed and its growth; `fine` while it is."""
    if gap <= 0.0:
        return fine if abs(closing) > 1e-6 else np.inf
    disc = closing * closing + 2.0 * faster * gap
    if disc < 0.0:
        return np.inf
    speed = closing + math.sqrt(disc)
    return max(fine, 2.0 * gap / speed) if speed > 0.0 else np.inf
