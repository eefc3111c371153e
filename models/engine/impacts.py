"""The state of a coming impact, approach and slip of the bodies, and its law as the effects give it."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from models import record as rec
from models.analytic.events import DEAD_SPEED, in_mouth
from models.analytic.pocket import JAW_RAILS, is_facing, outward
from models.compiled import compiled, compiled_in_place
from models.engine.motion import POTTED
from models.hooks import STROKE_FIELDS, Table, call_hook
from models.shot import NOSE_COSINE, NOSE_SINE, SESSION_FIELDS, Array

CLIMB_FRICTION = (
    0.43  # friction of a cushion above which a ball would climb its nose (tan of the nose's elevation: 0.436)
)
MAX_NOSE_SINE = 0.8  # largest sine of a nose over a ball's centre: higher ones press it down more than back
RAIL_OF_JAW = np.array(JAW_RAILS)


@compiled_in_place
def describe(h, cushion, i, j, one, two, nx, ny, radius, session, time):  # type: ignore[no-untyped-def]
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
    h[rec.CUSHION_HIT] = 1.0 if cushion else 0.0
    h[rec.APPROACH], h[rec.SLIP] = approach, math.sqrt(along * along + up * up)
    h[rec.HIT_X], h[rec.HIT_Y], h[rec.HIT_VX], h[rec.HIT_VY] = one[0], one[1], one[2], one[3]
    h[rec.HIT_WZ] = one[6]
    h[rec.FIRST], h[rec.SECOND] = i, (RAIL_OF_JAW[j - 4] if cushion and j >= 4 else j)
    h[rec.HIT_TIME] = time
    for k in range(SESSION_FIELDS):
        h[rec.HIT_SESSION + k] = session[k]
    h[rec.RESTITUTION] = h[rec.FRICTION] = h[rec.GAIN] = h[rec.DECAY] = 0.0
    h[rec.MASS_FIRST] = h[rec.MASS_SECOND] = 1.0
    h[rec.NOSE] = NOSE_SINE
    h[rec.COMPLIANCE] = h[rec.SINK] = h[rec.CONTACT_TIME] = 0.0


@compiled_in_place
def ask(h, at, own, hooks):  # type: ignore[no-untyped-def]
    """Let the effects say how the impact in record h, at address `at`, goes, within what the impact models hold for."""
    for k in range(hooks.shape[0]):
        call_hook(hooks[k, 0], own + 8 * hooks[k, 1], at)
    h[rec.RESTITUTION] = min(max(h[rec.RESTITUTION], 0.0), 1.0)
    h[rec.FRICTION] = max(h[rec.FRICTION], 0.0)
    if h[rec.CUSHION_HIT] > 0.0:
        h[rec.FRICTION] = min(h[rec.FRICTION], CLIMB_FRICTION)
        h[rec.NOSE] = min(max(h[rec.NOSE], 0.0), MAX_NOSE_SINE)
        h[rec.SINK] = min(max(h[rec.SINK], 0.0), 1.0)
        h[rec.CONTACT_TIME] = max(h[rec.CONTACT_TIME], 0.0)
    if h[rec.APPROACH] < DEAD_SPEED:
        h[rec.RESTITUTION] = 0.0


@compiled
def ask_rows(
    cushion: bool, p: Array, v: Array, w: Array, first: NDArray[np.int64], second: NDArray[np.int64], jaws: Array,
    radius: float, session: Array, time: Array, own: Array, rows: NDArray[np.int64], hooks: Table, out: Array,
) -> None:  # fmt: skip
    """Impacts of one kind, a row each, as the effects say: `out` (n, IMPACT_FIELDS).

    p, v, w (n, nball, 3); ball `first` with ball, rail (+x, -x, +y, -y) or 4 + jaw `second`; `session`
    (n, SESSION_FIELDS), `time` (n,);
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
        describe(out[n], cushion, i, j, one, two, nx, ny, radius, session[n], time[n])
        ask(out[n], out[n].ctypes.data, own[rows[n]].ctypes.data, hooks)


@compiled_in_place
def _gather(one, p, v, w):  # type: ignore[no-untyped-def]
    one[0], one[1], one[2], one[3] = p[0], p[1], v[0], v[1]
    one[4], one[5], one[6] = w[0], w[1], w[2]


@compiled_in_place
def deliver(v, w, own, hooks, radius, mass, cue):  # type: ignore[no-untyped-def]
    """Change velocity v (2,) and spin w (3,) of the struck ball to what the cue really delivers; returns its speed.

    `own` is the address of the effects' parameters; `cue` (STROKE_FIELDS,) is for work.
    """
    cue[0], cue[1], cue[2], cue[3], cue[4], cue[5], cue[6] = v[0], v[1], w[0], w[1], w[2], radius, mass
    for k in range(hooks.shape[0]):
        call_hook(hooks[k, 0], own + 8 * hooks[k, 1], cue.ctypes.data)
    v[0], v[1], w[0], w[1], w[2] = cue[0], cue[1], cue[2], cue[3], cue[4]
    return math.sqrt(v[0] * v[0] + v[1] * v[1])


@compiled
def strike_rows(own, hooks, radius, mass, struck, velocity, spin):  # type: ignore[no-untyped-def]
    """Velocity and spin (n, nball, ...) with the effects of the cue on ball 0 of every simulation with a strike."""
    cue = np.zeros(STROKE_FIELDS)
    for s in range(struck.size):
        if struck[s]:
            deliver(velocity[s, 0], spin[s, 0], own[s].ctypes.data, hooks, radius, mass, cue)


@compiled_in_place
def is_crowded(b, kind, i, j, rail, near, radius, limits, half, mouths):  # type: ignore[no-untyped-def]
    """Whether a third body is within `near` [m] of those of an impact: balls i and j, or ball i and a rail (j < 0).

    b (nball, 2 or more) begins with the balls' places; `kind` (nball,) says which are potted.
    """
    for one in (i, j):
        if one < 0:
            continue
        for k in range(b.shape[0]):
            if k != i and k != j and kind[k] != POTTED:
                x, y = b[k, 0] - b[one, 0], b[k, 1] - b[one, 1]
                d = 2.0 * radius + near
                if x * x + y * y < d * d:
                    return True
        for other in range(4):
            k = other // 2
            gap = limits[k] - (1.0 - 2.0 * (other % 2)) * b[one, k]
            if gap < near and not (j < 0 and other == rail) and not in_mouth(b[one, 1 - k], other, half, mouths):
                return True
    return False


@compiled_in_place
def part(b, i, j, rail, jaws, radius, limits):  # type: ignore[no-untyped-def]
    """Put bodies that overlap back to where they touch: balls i and j of b, or ball i and a rail or jaw (j < 0)."""
    if j >= 0:
        x, y = b[j, 0] - b[i, 0], b[j, 1] - b[i, 1]
        d = math.sqrt(x * x + y * y)
        more = 0.5 * max(2.0 * radius - d, 0.0) / d
        b[i, 0], b[i, 1] = b[i, 0] - more * x, b[i, 1] - more * y
        b[j, 0], b[j, 1] = b[j, 0] + more * x, b[j, 1] + more * y
    elif rail < 4:
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        b[i, k] = sign * min(sign * b[i, k], limits[k])
    elif is_facing(jaws[rail - 4]):
        x, y = jaws[rail - 4, 3], jaws[rail - 4, 4]
        more = max(x * (b[i, 0] - jaws[rail - 4, 0]) + y * (b[i, 1] - jaws[rail - 4, 1]), 0.0)
        b[i, 0], b[i, 1] = b[i, 0] - more * x, b[i, 1] - more * y
    else:
        x, y = jaws[rail - 4, 0] - b[i, 0], jaws[rail - 4, 1] - b[i, 1]
        d = math.sqrt(x * x + y * y)
        more = max(jaws[rail - 4, 2] - d, 0.0) / d
        b[i, 0], b[i, 1] = b[i, 0] - more * x, b[i, 1] - more * y
