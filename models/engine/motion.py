"""How one ball moves until it changes: its state, and where it is at any time of a motion that is laid.

A ball keeps its own clock. Without effects that push it, it slides along a parabola, rolls along a straight line and
rests, its sidespin in closed form (models/analytic/cloth.py). Where effects push it, it follows polynomials in time
(models/engine/curve.py).
"""

from __future__ import annotations

import math

import numpy as np

from models.analytic.cloth import ROLLING, STILL_SPEED, STILL_SPIN, turned
from models.compiled import compiled_in_place
from models.engine import columns as col
from models.shot import GRAVITY

# What a ball does: closed forms, or along a curve.
REST, SLIDE, ROLL, POTTED, CURVE = 0, 1, 2, 3, 4
GOES_ON, SLIDE_ENDS, STOPS = 0.0, 1.0, 2.0  # how a curve ends: the motion continues, the slide ends, the ball stops


@compiled_in_place
def look(b, m, kind, t, radius, alpha, row):  # type: ignore[no-untyped-def]
    """Write the state of a ball b (col.COLUMN_COUNT,) at time t of its motion into a row of ROW_SIZE columns at least.

    m (STATE_SIZE, TERM_COUNT): its curve in time. The row may be the ball itself.
    """
    if kind == CURVE:
        if t != b[col.CLOCK]:
            _follow(b, m, (t - b[col.BEGIN]) / b[col.SPAN], radius, row, col.ROW_SIZE)
            return
        for x in range(col.ROW_SIZE):
            row[x] = b[x]
        return
    dt = t - b[col.CLOCK]
    vx, vy, wx, wy, wz = b[col.VX], b[col.VY], b[col.WX], b[col.WY], b[col.WZ]
    x, y, turn, ax, ay = b[col.X], b[col.Y], b[col.TURN], b[col.AX], b[col.AY]
    if dt != 0.0 and kind != POTTED:
        if wz != 0.0:
            more, wz = turned(wz, alpha, dt)
            turn += more
        if kind != REST:
            x += (vx + 0.5 * ax * dt) * dt
            y += (vy + 0.5 * ay * dt) * dt
            vx += ax * dt
            vy += ay * dt
            if kind == SLIDE:
                wx += 2.5 * ay * dt / radius
                wy -= 2.5 * ax * dt / radius
            else:
                wx, wy = -vy / radius, vx / radius
    row[col.X], row[col.Y], row[col.VX], row[col.VY] = x, y, vx, vy
    row[col.WX], row[col.WY], row[col.WZ], row[col.TURN] = wx, wy, wz, turn


@compiled_in_place
def advance(b, m, kind, t, radius, alpha):  # type: ignore[no-untyped-def]
    """Carry a ball along its motion to time t, as `look`."""
    if kind == CURVE and t != b[col.CLOCK]:
        _follow(b, m, (t - b[col.BEGIN]) / b[col.SPAN], radius, b, col.STATE_SIZE)
    elif kind != CURVE:
        look(b, m, kind, t, radius, alpha, b)
    b[col.CLOCK] = t


@compiled_in_place
def advance_all(balls, t, radius, alpha):  # type: ignore[no-untyped-def]
    """Carry all balls of a shot to time t."""
    for i in range(balls.kind.size):
        advance(balls.rows[i], balls.curves[i], balls.kind[i], t, radius, alpha)


@compiled_in_place
def _follow(b, m, s, radius, row, columns):  # type: ignore[no-untyped-def]
    """So many columns of the state at part s of a curve."""
    for k in range(columns):
        value = m[k, col.TERM_COUNT - 1]
        for n in range(col.TERM_COUNT - 2, -1, -1):
            value = value * s + m[k, n]
        row[k] = value
    if b[col.MODE] == ROLLING:  # its spin follows its velocity
        row[col.WX], row[col.WY] = -row[col.VY] / radius, row[col.VX] / radius


@compiled_in_place
def place(b, m, kind, t):  # type: ignore[no-untyped-def]
    """Position and velocity of a ball at a time within its motion: (x, y, vx, vy)."""
    if kind == CURVE:
        s = (t - b[col.BEGIN]) / b[col.SPAN]
        x, y, vx, vy = m[col.X, 5], m[col.Y, 5], m[col.VX, 4], m[col.VY, 4]
        for n in range(4, -1, -1):
            x, y = x * s + m[col.X, n], y * s + m[col.Y, n]
        for n in range(3, -1, -1):
            vx, vy = vx * s + m[col.VX, n], vy * s + m[col.VY, n]
        return x, y, vx, vy
    d = t - b[col.CLOCK]
    vx, vy = b[col.VX] + b[col.AX] * d, b[col.VY] + b[col.AY] * d
    return b[col.X] + (b[col.VX] + 0.5 * b[col.AX] * d) * d, b[col.Y] + (b[col.VY] + 0.5 * b[col.AY] * d) * d, vx, vy


@compiled_in_place
def pull(b, m, kind, t):  # type: ignore[no-untyped-def]
    """Acceleration of a ball at a time within its motion: (ax, ay)."""
    if kind == CURVE:
        s = (t - b[col.BEGIN]) / b[col.SPAN]
        ax = m[col.VX, 1] + s * (2.0 * m[col.VX, 2] + s * (3.0 * m[col.VX, 3] + s * 4.0 * m[col.VX, 4]))
        ay = m[col.VY, 1] + s * (2.0 * m[col.VY, 2] + s * (3.0 * m[col.VY, 3] + s * 4.0 * m[col.VY, 4]))
        return ax / b[col.SPAN], ay / b[col.SPAN]
    return b[col.AX], b[col.AY]


@compiled_in_place
def plain_phase(b, radius, slide, roll):  # type: ignore[no-untyped-def]
    """What a ball does from its clock on where nothing but the cloth acts: its acceleration and when that ends."""
    ux, uy = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    u = math.sqrt(ux * ux + uy * uy)
    b[col.BOUND] = 0.0
    if u > STILL_SPEED:
        a = slide * GRAVITY
        b[col.AX], b[col.AY], b[col.BOUND] = -a * ux / u, -a * uy / u, a
        b[col.END] = b[col.CLOCK] + u / (3.5 * a) if a > 0.0 else np.inf
        return SLIDE
    v = math.sqrt(b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY])
    if v > STILL_SPEED:
        a = roll * GRAVITY
        b[col.AX], b[col.AY], b[col.BOUND] = -a * b[col.VX] / v, -a * b[col.VY] / v, a
        b[col.END] = b[col.CLOCK] + v / a if a > 0.0 else np.inf
        b[col.WX], b[col.WY] = -b[col.VY] / radius, b[col.VX] / radius
        return ROLL
    b[col.VX] = b[col.VY] = b[col.WX] = b[col.WY] = b[col.AX] = b[col.AY] = 0.0
    b[col.END] = np.inf
    return REST


@compiled_in_place
def arrive(b, kind, radius):  # type: ignore[no-untyped-def]
    """Set a ball that has come to the end of its motion to what it does there exactly: it rolls, or rests."""
    if kind == SLIDE:
        b[col.WX], b[col.WY] = -b[col.VY] / radius, b[col.VX] / radius
    elif kind == ROLL:
        b[col.VX] = b[col.VY] = b[col.WX] = b[col.WY] = 0.0
    elif kind == CURVE:
        if b[col.LAST] == SLIDE_ENDS:
            b[col.VX] -= 2 / 7 * (b[col.VX] - radius * b[col.WY])
            b[col.VY] -= 2 / 7 * (b[col.VY] + radius * b[col.WX])
            b[col.WX], b[col.WY] = -b[col.VY] / radius, b[col.VX] / radius
            b[col.TRY] = 0.0
        elif b[col.LAST] == STOPS:
            b[col.VX] = b[col.VY] = b[col.WX] = b[col.WY] = 0.0
        if abs(b[col.WZ]) <= STILL_SPIN:
            b[col.WZ] = 0.0


@compiled_in_place
def pot(b, kind, i):  # type: ignore[no-untyped-def]
    """Take a ball off the table."""
    kind[i] = POTTED
    for x in range(col.VX, col.WZ + 1):
        b[i, x] = 0.0
    b[i, col.END] = np.inf
