"""What an impact is about to be, approach and slip of the bodies that meet, and what the effects say of how it goes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from models.analytic.events import DEAD, in_mouth
from models.analytic.pocket import OWNERS, outward
from models.compiled import compiled
from models.hooks import IMPACT_FIELDS, Table, call_hook
from models.shot import NOSE_COSINE, NOSE_SINE, Array

CLIMB = 0.43  # friction of a cushion above which a ball would climb its nose (tan of the nose's elevation: 0.436)
(
    CUSHION_HIT, APPROACH, SLIP, HIT_X, HIT_Y, HIT_VX, HIT_VY, FIRST, SECOND, HIT_ORDER, HIT_TIME, RESTITUTION,
    FRICTION, GAIN, DECAY, MASS_FIRST, MASS_SECOND,
) = range(IMPACT_FIELDS)  # fmt: skip
RAIL_OF_JAW = np.array(OWNERS)


@compiled
def describe(h, cushion, i, j, one, two, nx, ny, radius, order, time):  # type: ignore[no-untyped-def]
    """Fill the record h of an impact (ImpactState) of ball i with ball j, or with rail or jaw j.

    `one`, `two`: their x, y, vx, vy, wx, wy, wz; the second is not read at a cushion. (nx, ny) points from the first
    into the second.
    """
    ux, uy, wx, wy, wz = one[2], one[3], one[4], one[5], one[6]
    c, s = NOSE_COSINE, NOSE_SINE
    if not cushion:
        ux, uy, wx, wy, wz = ux - two[2], uy - two[3], wx + two[4], wy + two[5], wz + two[6]
        c, s = 1.0, 0.0
    approach = ux * nx + uy * ny
    # Slip along the horizontal tangent (-ny, nx), and up the face.
    along = -ux * ny + uy * nx + radius * (wz * c - s * (wx * nx + wy * ny))
    up = -approach * s + radius * (wx * ny - wy * nx)
    h[CUSHION_HIT] = 1.0 if cushion else 0.0
    h[APPROACH], h[SLIP] = approach, math.sqrt(along * along + up * up)
    h[HIT_X], h[HIT_Y], h[HIT_VX], h[HIT_VY] = one[0], one[1], one[2], one[3]
    h[FIRST], h[SECOND] = i, (RAIL_OF_JAW[j - 4] if cushion and j >= 4 else j)
    h[HIT_ORDER], h[HIT_TIME] = order, time
    h[RESTITUTION] = h[FRICTION] = h[GAIN] = h[DECAY] = 0.0
    h[MASS_FIRST] = h[MASS_SECOND] = 1.0


@compiled
def ask(h, at, own, hooks):  # type: ignore[no-untyped-def]
    """Let the effects say how the impact in record h, at address `at`, goes, within what the impact models hold for."""
    for k in range(hooks.shape[0]):
        call_hook(hooks[k, 0], own + 8 * hooks[k, 1], at)
    h[RESTITUTION] = min(max(h[RESTITUTION], 0.0), 1.0)
    h[FRICTION] = max(h[FRICTION], 0.0)
    if h[CUSHION_HIT] > 0.0:
        h[FRICTION] = min(h[FRICTION], CLIMB)
    if h[APPROACH] < DEAD:
        h[RESTITUTION] = 0.0


@compiled
def ask_rows(
    cushion: bool, p: Array, v: Array, w: Array, first: NDArray[np.int64], second: NDArray[np.int64], jaws: Array,
    radius: float, order: Array, time: Array, own: Array, rows: NDArray[np.int64], hooks: Table, out: Array,
) -> None:  # fmt: skip
    """Impacts of one kind, a row each, as the effects say: `out` (n, IMPACT_FIELDS).

    p, v, w (n, nball, 3); ball `first` with ball, rail (+x, -x, +y, -y) or 4 + jaw `second`; `order`, `time` (n,);
    `own` (nsim, k) are the effects' parameters, of which each impact has those of simulation `rows` (n,).
    """
    one, two = np.zeros(7), np.zeros(7)
    for n in range(first.size):
        i, j = first[n], second[n]
        _gather(one, p[n, i], v[n, i], w[n, i])
        if cushion:
            nx, ny = outward(j, p[n, i, 0], p[n, i, 1], jaws)
        else:
            _gather(two, p[n, j], v[n, j], w[n, j])
            nx, ny = two[0] - one[0], two[1] - one[1]
            d = math.sqrt(nx * nx + ny * ny)
            nx, ny = nx / d, ny / d
        describe(out[n], cushion, i, j, one, two, nx, ny, radius, order[n], time[n])
        ask(out[n], out[n].ctypes.data, own[rows[n]].ctypes.data, hooks)


@compiled
def _gather(one, p, v, w):  # type: ignore[no-untyped-def]
    one[0], one[1], one[2], one[3] = p[0], p[1], v[0], v[1]
    one[4], one[5], one[6] = w[0], w[1], w[2]


@compiled
def strike_rows(  # type: ignore[no-untyped-def]
    own, hooks, radius, mass, struck, velocity, spin
):
    """What the cue really delivers to ball 0 of every simulation that is struck: velocity, spin (n, nball, ...)."""
    cue = np.zeros(7)
    for s in range(struck.size):
        if struck[s]:
            v, w = velocity[s, 0], spin[s, 0]
            cue[0], cue[1], cue[2], cue[3], cue[4], cue[5], cue[6] = v[0], v[1], w[0], w[1], w[2], radius, mass
            for k in range(hooks.shape[0]):
                call_hook(hooks[k, 0], own[s].ctypes.data + 8 * hooks[k, 1], cue.ctypes.data)
            v[0], v[1], w[0], w[1], w[2] = cue[0], cue[1], cue[2], cue[3], cue[4]


@compiled
def crowded(
    cushion: bool, hit: NDArray[np.int64], p: Array, alive: NDArray[np.bool_], near: Array, radius: float,
    reach: Array, half: Array, mouths: Array,
) -> NDArray[np.bool_]:  # fmt: skip
    """Impacts (rows of `hit`: kind, ball, other ball or rail) with a third body within `near` (n,) [m] of theirs."""
    found = np.zeros(hit.shape[0], np.bool_)
    for n in range(hit.shape[0]):
        one = hit[n, 1]
        two = one if cushion else hit[n, 2]
        for i in (one, two):
            for k in range(alive.shape[1]):
                if alive[n, k] and k != one and k != two:
                    x, y = p[n, k, 0] - p[n, i, 0], p[n, k, 1] - p[n, i, 1]
                    d = 2.0 * radius + near[n]
                    found[n] = found[n] or x * x + y * y < d * d
            for rail in range(4):
                k = rail // 2
                gap = reach[k] - (1.0 - 2.0 * (rail % 2)) * p[n, i, k]
                other = not (cushion and rail == hit[n, 2])
                found[n] = found[n] or (gap < near[n] and other and not in_mouth(p[n, i, 1 - k], rail, half, mouths))
    return found


@compiled
def part(cushion: bool, hit: NDArray[np.int64], p: Array, radius: float, reach: Array, jaws: Array) -> None:
    """Put bodies that overlap, each row of `hit`, back to where they touch."""
    for n in range(hit.shape[0]):
        i, j = hit[n, 1], hit[n, 2]
        if cushion and j >= 4:
            nx, ny = outward(j, p[n, i, 0], p[n, i, 1], jaws)
            x, y = jaws[j - 4, 0] - p[n, i, 0], jaws[j - 4, 1] - p[n, i, 1]
            more = max(jaws[j - 4, 2] - math.sqrt(x * x + y * y), 0.0)
            p[n, i, 0] -= more * nx
            p[n, i, 1] -= more * ny
            continue
        if cushion:
            k, sign = j // 2, 1.0 - 2.0 * (j % 2)
            p[n, i, k] = sign * min(sign * p[n, i, k], reach[k])
            continue
        x, y = p[n, j, 0] - p[n, i, 0], p[n, j, 1] - p[n, i, 1]
        d = math.sqrt(x * x + y * y)
        more = 0.5 * max(2.0 * radius - d, 0.0) / d
        p[n, i, 0] -= more * x
        p[n, i, 1] -= more * y
        p[n, j, 0] += more * x
        p[n, j, 1] += more * y
