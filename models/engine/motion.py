"""How one ball moves until it changes: its state, and where it is at any time of a motion that is laid.

A ball keeps its own clock. Without effects that push it, it slides along a parabola, rolls along a straight line and
rests, its sidespin in closed form (models/analytic/cloth.py). Where effects push it, it follows polynomials in time
(models/engine/curve.py).
"""

from __future__ import annotations

import math

import numpy as np

from models.analytic.cloth import ROLLING, STILL, STILL_SPIN, turned
from models.compiled import compiled_in_place
from models.shot import GRAVITY

# What a ball does: closed forms, or along a curve.
REST, SLIDE, ROLL, POTTED, CURVE = 0, 1, 2, 3, 4
# Columns of a ball: its state at CLOCK, its acceleration then, when its motion ends and what it meets of the table by
# then, and for a curve: when that began, how long it spans, what the ball does on it, how its end is reached, the
# largest acceleration on it, and what share of its motion the next step may take by its error (models/engine/curve.py).
(
    X, Y, VX, VY, WX, WY, WZ, TURN, ROLLED, CLOCK, AX, AY, END, MEET, BEGIN, SPAN, MODE, LAST, BOUND, TRY,
) = range(20)  # fmt: skip
COLUMNS, STATE, TERMS = 20, 9, 6
ON, SLIDE_ENDS, STOPS = 0.0, 1.0, 2.0  # how a curve's end is reached


@compiled_in_place
def advance(b, m, kind, t, radius, alpha):  # type: ignore[no-untyped-def]
    """Carry a ball b (COLUMNS,) along its motion to time t; m (STATE, TERMS) are its curve's polynomials."""
    if kind == CURVE:
        if t != b[CLOCK]:
            _follow(b, m, (t - b[BEGIN]) / b[SPAN], radius)
            b[CLOCK] = t
        return
    dt = t - b[CLOCK]
    b[CLOCK] = t
    if dt == 0.0 or kind == POTTED:
        return
    if b[WZ] != 0.0:
        more, b[WZ] = turned(b[WZ], alpha, dt)
        b[TURN] += more
    if kind == REST:
        return
    b[X] += (b[VX] + 0.5 * b[AX] * dt) * dt
    b[Y] += (b[VY] + 0.5 * b[AY] * dt) * dt
    b[VX] += b[AX] * dt
    b[VY] += b[AY] * dt
    if kind == SLIDE:
        b[WX] += 2.5 * b[AY] * dt / radius
        b[WY] -= 2.5 * b[AX] * dt / radius
    else:
        b[WX], b[WY] = -b[VY] / radius, b[VX] / radius


@compiled_in_place
def _follow(b, m, s, radius):  # type: ignore[no-untyped-def]
    """The state at part s of a curve."""
    for k in range(STATE):
        value = m[k, TERMS - 1]
        for n in range(TERMS - 2, -1, -1):
            value = value * s + m[k, n]
        b[k] = value
    if b[MODE] == ROLLING:  # its spin follows its velocity
        b[WX], b[WY] = -b[VY] / radius, b[VX] / radius


@compiled_in_place
def place(b, m, kind, t):  # type: ignore[no-untyped-def]
    """Position and velocity of a ball at a time within its motion: (x, y, vx, vy)."""
    if kind == CURVE:
        s = (t - b[BEGIN]) / b[SPAN]
        x, y, vx, vy = m[X, 5], m[Y, 5], m[VX, 4], m[VY, 4]
        for n in range(4, -1, -1):
            x, y = x * s + m[X, n], y * s + m[Y, n]
        for n in range(3, -1, -1):
            vx, vy = vx * s + m[VX, n], vy * s + m[VY, n]
        return x, y, vx, vy
    d = t - b[CLOCK]
    return (
        b[X] + (b[VX] + 0.5 * b[AX] * d) * d, b[Y] + (b[VY] + 0.5 * b[AY] * d) * d, b[VX] + b[AX] * d,
        b[VY] + b[AY] * d,
    )  # fmt: skip


@compiled_in_place
def pull(b, m, kind, t):  # type: ignore[no-untyped-def]
    """Acceleration of a ball at a time within its motion: (ax, ay)."""
    if kind == CURVE:
        s = (t - b[BEGIN]) / b[SPAN]
        ax = m[VX, 1] + s * (2.0 * m[VX, 2] + s * (3.0 * m[VX, 3] + s * 4.0 * m[VX, 4]))
        ay = m[VY, 1] + s * (2.0 * m[VY, 2] + s * (3.0 * m[VY, 3] + s * 4.0 * m[VY, 4]))
        return ax / b[SPAN], ay / b[SPAN]
    return b[AX], b[AY]


@compiled_in_place
def plain_phase(b, radius, slide, roll):  # type: ignore[no-untyped-def]
    """What a ball does from its clock on where nothing but the cloth acts: its acceleration and when that ends."""
    ux, uy = b[VX] - radius * b[WY], b[VY] + radius * b[WX]
    u = math.sqrt(ux * ux + uy * uy)
    b[BOUND] = 0.0
    if u > STILL:
        a = slide * GRAVITY
        b[AX], b[AY], b[BOUND] = -a * ux / u, -a * uy / u, a
        b[END] = b[CLOCK] + u / (3.5 * a) if a > 0.0 else np.inf
        return SLIDE
    v = math.sqrt(b[VX] * b[VX] + b[VY] * b[VY])
    if v > STILL:
        a = roll * GRAVITY
        b[AX], b[AY], b[BOUND] = -a * b[VX] / v, -a * b[VY] / v, a
        b[END] = b[CLOCK] + v / a if a > 0.0 else np.inf
        b[WX], b[WY] = -b[VY] / radius, b[VX] / radius
        return ROLL
    b[VX] = b[VY] = b[WX] = b[WY] = b[AX] = b[AY] = 0.0
    b[END] = np.inf
    return REST


@compiled_in_place
def arrive(b, kind, radius):  # type: ignore[no-untyped-def]
    """Set a ball that has come to the end of its motion to what it does there exactly: it rolls, or rests."""
    if kind == SLIDE:
        b[WX], b[WY] = -b[VY] / radius, b[VX] / radius
    elif kind == ROLL:
        b[VX] = b[VY] = b[WX] = b[WY] = 0.0
    elif kind == CURVE:
        if b[LAST] == SLIDE_ENDS:
            b[VX] -= 2 / 7 * (b[VX] - radius * b[WY])
            b[VY] -= 2 / 7 * (b[VY] + radius * b[WX])
            b[WX], b[WY] = -b[VY] / radius, b[VX] / radius
            b[TRY] = 0.0
        elif b[LAST] == STOPS:
            b[VX] = b[VY] = b[WX] = b[WY] = 0.0
        if abs(b[WZ]) <= STILL_SPIN:
            b[WZ] = 0.0
