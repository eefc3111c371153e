"""The event loop of whole shots, compiled, one shot after another on each core.

Every ball keeps its own clock and its motion from there on: a parabola while it slides, a straight line while it rolls,
sidespin in closed form. Kept for every ball is when it changes (end of slide or roll) and what it meets of the table,
for every pair when it meets; only what an event has changed is worked out anew. Leaves out that three balls touch at
once: they are taken two by two.

Where pockets have jaws (models/analytic/pocket.py) a straight rail ends before them, jaw k is logged as rail 4 + k,
and a ball falls where the slate ends; otherwise it falls where its centre passes the nose line within a mouth.

Impacts without end (a ball held between others, or pressed to a cushion by its own friction): an impact below DEAD
gives nothing back, a touch below AWAY is none, and what is pressed together at rest is looked at again after PUSH
seconds; what still goes on after MOST events is given up, and reported.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from models.analytic.cloth import STILL, turned
from models.analytic.cushion import rebound
from models.analytic.events import DEAD, in_mouth, line, meeting
from models.analytic.impulse import collide
from models.analytic.pocket import outward, straight
from models.shot import GRAVITY

Array = NDArray[np.float64]
BALL, CUSHION, POCKET, SWITCH = 0, 1, 2, 3
REST, SLIDE, ROLL, POTTED = 0, 1, 2, 3
PUSH = 1e-3  # [s]
MOST = 100_000  # events of a shot
BLOCK = 16  # shots that share a workspace
X, Y, VX, VY, WX, WY, WZ, TURN, CLOCK, AX, AY, END, MEET = range(13)  # columns of a ball


@njit(cache=True, error_model="numpy")
def _advance(b, kind, t, radius, alpha):  # type: ignore[no-untyped-def]
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


@njit(cache=True, error_model="numpy")
def _phase(b, radius, slide, roll):  # type: ignore[no-untyped-def]
    """What a ball does from its clock on: its acceleration and when that ends."""
    ux, uy = b[VX] - radius * b[WY], b[VY] + radius * b[WX]
    u = math.sqrt(ux * ux + uy * uy)
    if u > STILL:
        a = slide * GRAVITY
        b[AX], b[AY] = -a * ux / u, -a * uy / u
        b[END] = b[CLOCK] + u / (3.5 * a) if a > 0.0 else np.inf
        return SLIDE
    v = math.sqrt(b[VX] * b[VX] + b[VY] * b[VY])
    if v > STILL:
        a = roll * GRAVITY
        b[AX], b[AY] = -a * b[VX] / v, -a * b[VY] / v
        b[END] = b[CLOCK] + v / a if a > 0.0 else np.inf
        b[WX], b[WY] = -b[VY] / radius, b[VX] / radius
        return ROLL
    b[VX] = b[VY] = b[WX] = b[WY] = b[AX] = b[AY] = 0.0
    b[END] = np.inf
    return REST


@njit(cache=True, error_model="numpy")
def _table(b, what, i, kind, reach, half, mouths, jaws, falls, until):  # type: ignore[no-untyped-def]
    """What of the table a ball meets next, within its phase and the time wanted."""
    b[MEET] = np.inf
    if kind != SLIDE and kind != ROLL:
        return
    h = min(b[END], until) - b[CLOCK]
    bent = falls.shape[0] > 0
    for rail in range(4):
        k, sign = rail // 2, 1.0 - 2.0 * (rail % 2)
        if bent:
            t = straight(rail, reach, b[X:VX], b[VX:WX], b[AX:END], half, mouths, h)
        else:
            t = line(reach[k] - sign * b[k], sign * b[VX + k], sign * b[AX + k], h)
        if t == np.inf:
            continue
        if t < 0.0:
            if b[CLOCK] + PUSH < b[MEET]:
                b[MEET], what[i, 0] = b[CLOCK] + PUSH, SWITCH
            continue
        o = 1 - k
        found = CUSHION
        if not bent and in_mouth(b[o] + b[VX + o] * t + 0.5 * b[AX + o] * t * t, rail, half, mouths):
            found = POCKET
            t = line(half[k] - sign * b[k], sign * b[VX + k], sign * b[AX + k], h)
        if t >= 0.0 and b[CLOCK] + t < b[MEET]:
            b[MEET], what[i, 0], what[i, 1] = b[CLOCK] + t, found, rail
    if bent:
        for k in range(jaws.shape[0] + falls.shape[0]):
            fall = k >= jaws.shape[0]
            place = falls[k - jaws.shape[0]] if fall else jaws[k]
            t = meeting(b[X] - place[0], b[Y] - place[1], b[VX], b[VY], b[AX], b[AY], place[2], h)
            if t == -1.0:
                if not fall and b[CLOCK] + PUSH < b[MEET]:
                    b[MEET], what[i, 0] = b[CLOCK] + PUSH, SWITCH
            elif b[CLOCK] + t < b[MEET]:
                b[MEET] = b[CLOCK] + t
                what[i, 0], what[i, 1] = (POCKET, k - jaws.shape[0]) if fall else (CUSHION, 4 + k)
    elif mouths[0] > 0.0:
        for corner in range(4):
            sx, sy = 1.0 - 2.0 * (corner % 2), 1.0 - 2.0 * (corner // 2)
            t = meeting(b[X] - sx * half[0], b[Y] - sy * half[1], b[VX], b[VY], b[AX], b[AY], mouths[2], h)
            if t >= 0.0 and b[CLOCK] + t < b[MEET]:
                b[MEET], what[i, 0], what[i, 1] = b[CLOCK] + t, POCKET, -1


@njit(cache=True, error_model="numpy")
def _pairs(now, i, b, kind, pair, again, radius, until):  # type: ignore[no-untyped-def]
    """When a ball meets each other one, within the phases of both."""
    for j in range(b.shape[0]):
        if j == i:
            continue
        at = i * (i - 1) // 2 + j if j < i else j * (j - 1) // 2 + i
        pair[at], again[at] = np.inf, False
        if kind[i] == POTTED or kind[j] == POTTED or (kind[i] == REST and kind[j] == REST):
            continue
        d = now - b[j, CLOCK]
        x = b[i, X] - b[j, X] - (b[j, VX] + 0.5 * b[j, AX] * d) * d
        y = b[i, Y] - b[j, Y] - (b[j, VY] + 0.5 * b[j, AY] * d) * d
        vx, vy = b[i, VX] - b[j, VX] - b[j, AX] * d, b[i, VY] - b[j, VY] - b[j, AY] * d
        h = min(b[i, END], b[j, END], until) - now
        t = meeting(x, y, vx, vy, b[i, AX] - b[j, AX], b[i, AY] - b[j, AY], 2.0 * radius, h)
        if t == -1.0:
            pair[at], again[at] = now + PUSH, True
        else:
            pair[at] = now + t


@njit(cache=True, error_model="numpy")
def _hit(b, i, j, rail, jaws, state, c, law, mass, radius):  # type: ignore[no-untyped-def]
    """Carry two balls, or one and a cushion (j < 0), through their impact."""
    if j < 0:
        bx, by = outward(rail, b[i, X], b[i, Y], jaws)
        ax, ay = by, -bx
    else:
        ax, ay = b[j, X] - b[i, X], b[j, Y] - b[i, Y]
        d = math.sqrt(ax * ax + ay * ay)
        ax, ay = ax / d, ay / d
        bx, by = -ay, ax
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        state[o], state[o + 1] = q[VX] * ax + q[VY] * ay, q[VX] * bx + q[VY] * by
        state[o + 2], state[o + 3] = q[WX] * ax + q[WY] * ay, q[WX] * bx + q[WY] * by
        state[o + 4] = q[WZ]
    if j < 0:
        e = 0.0 if state[1] < DEAD else c[5]
        rebound(law, state, e, (c[6], c[0], mass, radius))
    else:
        e = 0.0 if state[0] - state[5] < DEAD else c[3]
        collide(False, state, e, (c[4], c[0], mass, radius))
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        q[VX], q[VY] = state[o] * ax + state[o + 1] * bx, state[o] * ay + state[o + 1] * by
        q[WX], q[WY] = state[o + 2] * ax + state[o + 3] * bx, state[o + 2] * ay + state[o + 3] * by
        q[WZ] = state[o + 4]


@njit(cache=True, error_model="numpy")
def _sample(b, kind, times, begin, until, radius, alpha, out):  # type: ignore[no-untyped-def]
    """Write the balls at all times from number `begin` up to a moment; returns the next number."""
    while begin < times.size and times[begin] <= until:
        for i in range(b.shape[0]):
            o = out[begin, i]
            if kind[i] == POTTED:
                o[:] = np.nan
                continue
            copy = (b[i, 0], b[i, 1], b[i, 2], b[i, 3], b[i, 4], b[i, 5], b[i, 6], b[i, 7], b[i, 8])
            _advance(b[i], kind[i], times[begin], radius, alpha)
            for x in range(8):
                o[x] = b[i, x]
            for x in range(9):
                b[i, x] = copy[x]
        begin += 1
    return begin


@njit(cache=True, error_model="numpy")
def _play(  # type: ignore[no-untyped-def]
    b, kind, what, pair, again, state, c, law, mass, radius, reach, half, mouths, jaws, falls, until, most, times, out,
    log, who, count,
):  # fmt: skip
    """Play one shot from b's first eight columns; returns when it ended, nan where it was given up, balls as then."""
    n = b.shape[0]
    slide, roll, alpha = c[0], c[1], c[2]
    for i in range(n):
        b[i, CLOCK] = 0.0
        kind[i] = _phase(b[i], radius, slide, roll)
    for i in range(n):
        _table(b[i], what, i, kind[i], reach, half, mouths, jaws, falls, until)
        _pairs(0.0, i, b, kind, pair, again, radius, until)
    next_, logged, now = 0, 0, 0.0
    for _ in range(most):
        t, event, i, j = np.inf, SWITCH, -1, -1
        for k in range(n):
            if b[k, MEET] < t:
                t, event, i = b[k, MEET], what[k, 0], k
            if b[k, END] < t:
                t, event, i = b[k, END], SWITCH, k
        at = 0
        for k in range(1, n):
            for m in range(k):
                if pair[at] < t:
                    t, event, i, j = pair[at], BALL, m, k
                at += 1
        if t > until or t == np.inf:
            break
        next_ = _sample(b, kind, times, next_, t, radius, alpha, out)
        now = t
        _advance(b[i], kind[i], t, radius, alpha)
        if event == BALL:
            _advance(b[j], kind[j], t, radius, alpha)
            if again[j * (j - 1) // 2 + i]:
                event = SWITCH
            else:
                _hit(b, i, j, 0, jaws, state, c, law, mass, radius)
            kind[j] = _phase(b[j], radius, slide, roll)
        elif event == CUSHION:
            _hit(b, i, -1, what[i, 1], jaws, state, c, law, mass, radius)
        elif event == SWITCH and t == b[i, END]:
            if kind[i] == SLIDE:
                b[i, WX], b[i, WY] = -b[i, VY] / radius, b[i, VX] / radius
            else:
                b[i, VX] = b[i, VY] = b[i, WX] = b[i, WY] = 0.0
        count[event] += 1
        if event == POCKET:
            kind[i] = POTTED
            for x in range(VX, WZ + 1):
                b[i, x] = 0.0
            b[i, END] = np.inf
        else:
            kind[i] = _phase(b[i], radius, slide, roll)
        if event != SWITCH:
            if logged < log.size:
                log[logged] = t
                who[logged, 0], who[logged, 1] = event, i
                who[logged, 2] = j if event == BALL else what[i, 1]
            logged += 1
        _table(b[i], what, i, kind[i], reach, half, mouths, jaws, falls, until)
        _pairs(now, i, b, kind, pair, again, radius, until)
        if j >= 0:
            _table(b[j], what, j, kind[j], reach, half, mouths, jaws, falls, until)
            _pairs(now, j, b, kind, pair, again, radius, until)
    else:
        for i in range(n):
            _advance(b[i], kind[i], now, radius, alpha)
        return np.nan
    _sample(b, kind, times, next_, until, radius, alpha, out)
    if until < np.inf:
        now = until
    elif alpha > 0.0:
        for i in range(n):
            if kind[i] != POTTED:
                now = max(now, b[i, CLOCK] + abs(b[i, WZ]) / alpha)
    for i in range(n):
        _advance(b[i], kind[i], now, radius, alpha)
    return now


@njit(cache=True, parallel=True, error_model="numpy")
def play_rows(
    start: Array, constants: Array, law: int, mass: float, radius: float, reach: Array, half: Array, mouths: Array,
    jaws: Array, falls: Array, until: Array, most: int, times: Array, out: Array, log: Array, who: NDArray[np.int64],
    count: NDArray[np.int64], end: Array, potted: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Play shots: `start` (n, nball, 8) in and out, `constants` (n, 7), `times` (n, m), `out` (n, m, nball, 8).

    `jaws`, `falls` as models/analytic/pocket.py has them, with its `ends` for `mouths`; no rows: mouths only.
    """
    n, nball = start.shape[0], start.shape[1]
    for block in prange((n + BLOCK - 1) // BLOCK):
        b = np.zeros((nball, 13))
        kind, what = np.zeros(nball, np.int64), np.zeros((nball, 2), np.int64)
        pair, again = np.zeros(nball * (nball - 1) // 2), np.zeros(nball * (nball - 1) // 2, np.bool_)
        state = np.zeros(10)
        for s in range(block * BLOCK, min(n, (block + 1) * BLOCK)):
            for i in range(nball):
                for x in range(8):
                    b[i, x] = start[s, i, x]
            end[s] = _play(
                b, kind, what, pair, again, state, constants[s], law, mass, radius, reach, half, mouths, jaws, falls,
                until[s], most, times[s], out[s], log[s], who[s], count[s],
            )  # fmt: skip
            for i in range(nball):
                potted[s, i] = kind[i] == POTTED
                for x in range(8):
                    start[s, i, x] = b[i, x]
