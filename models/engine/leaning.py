"""Balls that lean on each other or on a cushion: when they are looked at again, and when they rest.

What leans is known to for LEAN_MEMORY_S; what has been pressed without moving for HELD_AFTER_S is held, and rests until
something beside it is hit. A ball that keeps to its place is held after the shorter time: until then it sinks, between
two looks, into what it is pressed to, and is put back at the second.
"""

from __future__ import annotations

import math

import numpy as np

from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M
from models.engine.motion import POTTED, place
from models.engine.touch import MAX_RECHECK_S, PRESSED_RECHECK_S

LEAN_MEMORY_S = 5.0 * MAX_RECHECK_S  # time for which the contact of a leaning ball is remembered [s]
# What is pressed rests once it has moved by no more than a way for a time. In the shorter time a net push of 8 mm/s2
# drives it further; the longer one ends creeping along a cushion, which sinking in and friction sustain.
HELD_AFTER_S, HELD_WAY_M = (0.05, 0.2), (1e-5, 4e-4)  # [s], [m]
CALM_SPEED = 1e-4  # relative speed that bodies in lasting contact may keep until the next check [m/s]
CREEP_SPEED = 2e-3  # largest speed of a pressed ball that has not moved: rolling resistance would have stopped it [m/s]
BESIDE_M = 1e-4  # gap to a struck ball below which a held ball has to be checked again [m]


@compiled_in_place
def look_later(balls, notes, i, now, radius):  # type: ignore[no-untyped-def]
    """Let ball i and others that lean on each other at no speed have no other look for a while."""
    b, m, kind, leans, pair, again = balls.rows, balls.curves, balls.kind, notes.leans, notes.pair, notes.again
    later, touch = now + PRESSED_RECHECK_S, 2.0 * radius + CROWD_GAP_M
    x, y, vx, vy = place(b[i], m[i], kind[i], now)
    for j in range(b.shape[0]):
        at = i * (i - 1) // 2 + j if j < i else j * (j - 1) // 2 + i
        if j == i or kind[j] == POTTED or leans[j] <= now or not pair[at] < later:
            continue
        px, py, pvx, pvy = place(b[j], m[j], kind[j], now)
        px, py, pvx, pvy = px - x, py - y, pvx - vx, pvy - vy
        d = math.sqrt(px * px + py * py)
        if d < touch and abs(px * pvx + py * pvy) < CALM_SPEED * d:
            pair[at], again[at] = later, True


@compiled_in_place
def lean(i, now, leans, still):  # type: ignore[no-untyped-def]
    """Note that ball i leans on something."""
    if leans[i] <= now:
        still[i, :, 2] = now
    leans[i] = now + LEAN_MEMORY_S


@compiled_in_place
def release(b, notes, now, radius):  # type: ignore[no-untyped-def]
    """Let go of what is held and `touched`, or lies by what is: something that held it may be gone."""
    held, touched, todo, still = notes.held, notes.touched, notes.todo, notes.still
    beside, more = 2.0 * radius + BESIDE_M, True
    while more:
        more = False
        for p in range(b.shape[0]):
            if not held[p]:
                continue
            for q in range(b.shape[0]):
                x, y = b[p, col.X] - b[q, col.X], b[p, col.Y] - b[q, col.Y]
                if touched[q] and x * x + y * y < beside * beside:
                    held[p], touched[p], todo[p], more = False, True, True, True
                    still[p, :, 2] = now
                    break


@compiled_in_place
def is_held(b, still, now, radius):  # type: ignore[no-untyped-def]
    """Whether a ball that is pressed has long not moved; then it rests.

    `still` (2, 3): where it moved last by more than the short way and the long one [m], and when [s].
    """
    creep, holds = CREEP_SPEED * CREEP_SPEED, False
    ux, uy = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    v2, u2, side = b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY], ux * ux + uy * uy, radius * b[col.WZ]
    moves = v2 > creep or u2 > creep or side * side > creep
    for k in range(2):
        x, y = b[col.X] - still[k, 0], b[col.Y] - still[k, 1]
        if moves or x * x + y * y > HELD_WAY_M[k] * HELD_WAY_M[k]:
            still[k, 0], still[k, 1], still[k, 2] = b[col.X], b[col.Y], now
        holds = holds or now - still[k, 2] >= HELD_AFTER_S[k]
    if not holds:
        return False
    b[col.VX] = b[col.VY] = b[col.WX] = b[col.WY] = b[col.WZ] = b[col.AX] = b[col.AY] = b[col.BOUND] = 0.0
    b[col.END] = np.inf
    return True
