"""The state of a coming impact, approach and slip of the bodies, and its law as the effects give it."""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.events import DEAD_SPEED, in_mouth
from models.analytic.pocket import JAW_RAILS, is_facing
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.motion import POTTED
from models.engine.workspace import Contact
from models.hooks import STROKE_FIELDS, Table, call_hook
from models.shot import NOSE_COSINE, NOSE_SINE, SESSION_FIELDS, Array

CLIMB_FRICTION = (
    0.43  # friction of a cushion above which a ball would climb its nose (tan of the nose's elevation: 0.436)
)
MAX_NOSE_SINE = 0.8  # largest sine of a nose over a ball's centre: higher ones press it down more than back
RAIL_OF_JAW = np.array(JAW_RAILS)


@compiled_in_place
def describe(h, b, contact, radius, session, time):  # type: ignore[no-untyped-def]
    """Fill the record h of an impact (ImpactState) at a `Contact`; rows of b begin with x, y, vx, vy, wx, wy, wz."""
    i, j, rail, nx, ny = contact
    cushion, one = j < 0, b[i]
    ux, uy, wx, wy, wz = one[2], one[3], one[4], one[5], one[6]
    c, s = NOSE_COSINE, NOSE_SINE
    if not cushion:
        two = b[j]
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
    h[rec.FIRST], h[rec.SECOND] = i, ((RAIL_OF_JAW[rail - 4] if rail >= 4 else rail) if cushion else j)
    h[rec.HIT_TIME] = time
    for k in range(SESSION_FIELDS):
        h[rec.HIT_SESSION + k] = session[k]
    h[rec.RESTITUTION] = h[rec.FRICTION] = h[rec.GAIN] = h[rec.DECAY] = 0.0
    h[rec.MASS_FIRST] = h[rec.MASS_SECOND] = 1.0
    h[rec.NOSE] = NOSE_SINE
    h[rec.COMPLIANCE] = h[rec.SINK] = h[rec.CONTACT_TIME] = h[rec.CLOTH_SHARE] = 0.0


@compiled_in_place
def ask(h, own, hooks):  # type: ignore[no-untyped-def]
    """Let the effects say how the impact in record h goes, within what the impact models hold for.

    `own`: address of their parameters; `hooks` (k, 2).
    """
    for k in range(hooks.shape[0]):
        call_hook(hooks[k, 0], own + 8 * hooks[k, 1], h.ctypes.data)
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
def ask_neighbours(b: Array, radius: float, session: Array, own: Array, hooks: Table, out: Array) -> None:
    """Touches of each ball with the next one, and of the last with the first, as the effects say.

    b (n, 7): place, velocity and spin; `session` (SESSION_FIELDS,); `own` (k,) parameters of the effects; `out`
    (n, IMPACT_FIELDS).
    """
    n = b.shape[0]
    for i in range(n):
        j = (i + 1) % n
        nx, ny = b[j, 0] - b[i, 0], b[j, 1] - b[i, 1]
        d = math.sqrt(nx * nx + ny * ny)
        describe(out[i], b, Contact(i, j, 0, nx / d, ny / d), radius, session, 0.0)
        ask(out[i], own.ctypes.data, hooks)


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
def is_crowded(balls, pair, near, geometry):  # type: ignore[no-untyped-def]
    """Whether a third body is within `near` [m] of the two of an impact."""
    b, kind, (i, j, rail) = balls.rows, balls.kind, pair
    radius, limits, half, mouths = geometry.radius, geometry.limits, geometry.half, geometry.mouths
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
def followed(cloth, factor, share):  # type: ignore[no-untyped-def]
    """Friction of the cloth within an impact, where its sliding friction `cloth` is changed by a factor elsewhere."""
    return cloth * max(1.0 + share * (factor - 1.0), 0.0)


@compiled_in_place
def is_pressed(one, two, nx, ny):  # type: ignore[no-untyped-def]
    """Whether friction between two balls presses the first onto the cloth, or else the second."""
    return (one[col.WX] + two[col.WX]) * ny > (one[col.WY] + two[col.WY]) * nx


@compiled_in_place
def part(b, pair, geometry):  # type: ignore[no-untyped-def]
    """Put the bodies of a `Pair` that overlap back to where they touch."""
    i, j, rail = pair
    radius, limits, jaws = geometry.radius, geometry.limits, geometry.jaws
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
