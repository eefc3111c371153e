"""The event loop of a shot, and many shots in a row.

Kept for every ball is when its motion ends and what it meets of the table, for every pair when it meets; only what an
event has changed is worked out anew. Two bodies that meet alone are carried through by their impulse
(models/analytic/impulse.py), several at a time through springs (models/engine/cluster.py).

Where pockets have jaws (models/analytic/pocket.py) a straight rail ends before them, jaw k is logged as rail 4 + k,
and a ball falls where the slate ends; otherwise it falls where its centre passes the nose line within a mouth.

Impacts without end (a ball held between others, or pressed to a cushion by its own friction): an impact below
DEAD_SPEED gives nothing back, nor does one below LEAN_SPEED of a ball that has just had such an impact, which is not
logged either; all that press on each other so are carried through at once (models/engine/rigid.py). A touch below
MIN_IMPACT_SPEED is none, and bodies pressed together at rest are checked again after PRESSED_RECHECK_S. What has been
pressed without moving for HELD_AFTER_S (a slope holds it to a cushion) rests until something is hit. A shot with more
than `most` events is given up, and reported.
"""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.events import DEAD_SPEED, LEAN_SPEED
from models.analytic.spring import CUSHION_TIME
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, through
from models.engine.curve import MAX_STEP_S, curve, lay_record
from models.engine.impacts import deliver, is_crowded, part
from models.engine.motion import POTTED, REST, advance, arrive, place, plain_phase
from models.engine.rigid import approach_speed, collide_alone, settle
from models.engine.touch import (
    BALL,
    CUSHION,
    MAX_RECHECK_S,
    POCKET,
    PRESSED_RECHECK_S,
    SWITCH,
    meet_balls,
    meet_table,
)
from models.hooks import STROKE_FIELDS

LEAN_MEMORY_S = 5.0 * MAX_RECHECK_S  # for how long a ball that leans is known to [s]
HELD_AFTER_S = 0.2  # for which what is pressed has not moved, before it rests [s]
CALM_SPEED = 1e-4  # between bodies that lean on each other, with which they may go on until the next look [m/s]
CREEP_SPEED = 2e-3  # of what is pressed and has not moved: any rolling resistance would have stopped it [m/s]
BESIDE_M = 1e-4  # gap to a ball that is hit, at which what is held is no longer known to be [m]
ROW_SIZE = 8  # numbers of a ball at a moment: place, velocity, spin, angle turned


@compiled_in_place
def _sample(b, m, kind, times, begin, until, radius, alpha, out, keep):  # type: ignore[no-untyped-def]
    """Write the balls at all times from number `begin` up to a moment; returns the next number."""
    while begin < times.size and times[begin] <= until:
        for i in range(b.shape[0]):
            o = out[begin, i]
            if kind[i] == POTTED:
                o[:] = np.nan
                continue
            for x in range(col.COLUMN_COUNT):
                keep[x] = b[i, x]
            advance(b[i], m[i], kind[i], times[begin], radius, alpha)
            for x in range(ROW_SIZE):
                o[x] = b[i, x]
            for x in range(col.COLUMN_COUNT):
                b[i, x] = keep[x]
        begin += 1
    return begin


@compiled
def workspace(n, curved):  # type: ignore[no-untyped-def]
    """Arrays that shots of n balls are played in: of every ball, of every pair, and of one at a time."""
    pairs = n * (n - 1) // 2
    balls = (
        np.zeros((n, col.COLUMN_COUNT)),
        np.zeros((n, col.STATE_SIZE if curved else 1, col.TERM_COUNT)),
        np.zeros((n, rec.BALL_FIELDS)),
    )
    known = (
        np.zeros(n, np.int64),
        np.zeros((n, 2), np.int64),
        np.zeros(n),
        np.zeros(n),
        np.zeros((n, 3)),
        np.zeros((3, n), np.bool_),
    )
    one = (
        np.zeros(10),
        np.zeros(rec.IMPACT_FIELDS),
        np.zeros(col.COLUMN_COUNT),
        np.zeros(col.STATE_SIZE),
        np.zeros((7, col.STATE_SIZE)),
    )
    return balls, known, (np.zeros(pairs), np.zeros(pairs, np.bool_)), one


@compiled_in_place
def play_shot(  # type: ignore[no-untyped-def]
    work, start, stays, launch, order, own, forces, support, horizon, impact, cloth, mass, radius, limits, half, mouths,
    jaws, falls, table, clusters, until, most, times, out, log, who, count, potted,
):  # fmt: skip
    """Play one shot from `start` (n, 8), which is left as it ends; returns when, nan where it was given up.

    `own` is the address of the effects' parameters, `forces`, `horizon`, `impact` their hooks (models/hooks.py),
    `cloth` friction of sliding and rolling, and deceleration of sidespin; a potted ball begins with nan for a place.
    """
    n = start.shape[0]
    curved = forces.shape[0] > 0
    (
        (b, m, records),
        (kind, what, leans, quiet, still, (todo, touched, held)),
        (pair, again),
        (state, hit, keep, y, k),
    ) = work
    slide, roll, alpha = cloth[0], cloth[1], cloth[2]
    for i in range(n):
        lay_record(records[i], i, launch, order, radius, mass)
        for x in range(col.COLUMN_COUNT):
            b[i, x] = start[i, x] if x < ROW_SIZE else 0.0
        kind[i], todo[i], leans[i], quiet[i] = REST, True, -np.inf, -np.inf
        if math.isnan(b[i, col.X]):
            kind[i] = POTTED
            b[i, col.END] = b[i, col.MEET] = np.inf
        still[i, 0], still[i, 1], still[i, 2], held[i] = b[i, col.X], b[i, col.Y], 0.0, False
    # Counters begin as numbers that the compiler does not know: it would compile what they go into for each literal.
    zero = 0 * n
    next_, logged, now, ended = zero, zero, 0.0, np.nan
    for done in range(most + 1):
        for i in range(n):
            if todo[i] and kind[i] != POTTED:
                held[i] = curved and leans[i] > now and _is_held(b[i], still[i], now, radius)
                if held[i]:
                    kind[i] = REST
                elif curved:
                    kind[i] = curve(
                        b[i], m[i], until, MAX_STEP_S, records[i], records[i].ctypes.data, own, forces, support,
                        horizon, cloth, y, k,
                    )  # fmt: skip
                else:
                    kind[i] = plain_phase(b[i], radius, slide, roll)
        for i in range(n):
            if todo[i]:
                # What leans on a cushion has no other look at it for a while: looks would follow without end.
                left_out, soon = zero, True
                while soon:
                    meet_table(
                        b[i], m[i], what, i, kind[i], limits, half, mouths, jaws, falls, stays[i], until, left_out
                    )
                    soon = quiet[i] > now and what[i, 0] == CUSHION and b[i, col.MEET] < quiet[i]
                    soon = soon and approach_speed(b, i, zero - 1, what[i, 1], jaws) < DEAD_SPEED
                    if soon:
                        left_out |= 1 << what[i, 1]
                if left_out and quiet[i] < b[i, col.MEET]:
                    b[i, col.MEET], what[i, 0] = quiet[i], SWITCH
                meet_balls(now, i, b, m, kind, pair, again, radius, until)
                if leans[i] > now:
                    _look_later(now, i, b, m, kind, leans, pair, again, radius)
                todo[i] = False
        t, event, i, j = np.inf, SWITCH + zero, zero - 1, zero - 1
        for q in range(n):
            if b[q, col.MEET] < t:
                t, event, i = b[q, col.MEET], what[q, 0], q
            if b[q, col.END] < t:
                t, event, i = b[q, col.END], SWITCH, q
        at = 0
        for q in range(1, n):
            for p in range(q):
                if pair[at] < t:
                    t, event, i, j = pair[at], BALL, p, q
                at += 1
        if t > until or t == np.inf:
            ended = until
            break
        if done == most:
            break
        next_ = _sample(b, m, kind, times, next_, t, radius, alpha, out, keep)
        now = t
        advance(b[i], m[i], kind[i], t, radius, alpha)
        todo[i] = True
        pressed = False
        if event == BALL:
            advance(b[j], m[j], kind[j], t, radius, alpha)
            todo[j] = True
            if again[j * (j - 1) // 2 + i]:
                event, pressed = SWITCH, True
        if event in (BALL, CUSHION):
            rail = what[i, 1] if event == CUSHION else zero - 1
            speed = approach_speed(b, i, j, rail, jaws)
            if clusters and rail < 4 and speed >= LEAN_SPEED:
                for q in range(n):
                    advance(b[q], m[q], kind[q], t, radius, alpha)
                near = max(CROWD_GAP_M, speed * CUSHION_TIME)
                if is_crowded(b, kind, i, j, rail, near, radius, limits, half, mouths):
                    count[SWITCH] += 1
                    now, next_, logged = through(
                        b, kind, now, until, records, own, forces, support, impact, cloth, mass, radius, limits, half,
                        mouths, jaws, order, hit, table, times, next_, out, log, who, logged, count,
                    )  # fmt: skip
                    for q in range(n):
                        b[q, col.CLOCK] = now
                        touched[q] = b[q, col.VX] != 0.0 or b[q, col.VY] != 0.0
                        todo[q] = not held[q] or touched[q]
                    _release(b, held, touched, todo, still, now, radius)
                    continue
            known = leans[i] > now or (j >= 0 and leans[j] > now)
            slow = collide_alone(b, i, j, rail, jaws, state, hit, known, own, impact, cloth, mass, radius, order, now)
            if speed >= DEAD_SPEED:
                for q in range(n):
                    touched[q] = q in (i, j)
                    if held[q]:
                        advance(b[q], m[q], kind[q], t, radius, alpha)
                _release(b, held, touched, todo, still, now, radius)
            if slow:
                pressed = True
                part(b, i, j, rail, jaws, radius, limits)
                if j < 0:
                    quiet[i] = now + PRESSED_RECHECK_S
            b[i, col.TRY] = 0.0
            if j >= 0:
                b[j, col.TRY] = 0.0
            if slow and known:
                event = SWITCH
        elif event == SWITCH and t == b[i, col.END]:
            arrive(b[i], kind[i], radius)
        elif event == SWITCH:  # pressed to something, and looked at again
            _lean(i, now, leans, still)
        if pressed:
            for q in range(n):
                advance(b[q], m[q], kind[q], t, radius, alpha)
            settle(
                b, kind, i, j, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, order,
                now,
            )  # fmt: skip
            for q in range(n):
                if touched[q]:
                    todo[q], b[q, col.TRY] = True, 0.0
                    _lean(q, now, leans, still)
        count[event] += 1
        if event == POCKET:
            kind[i] = POTTED
            for x in range(col.VX, col.WZ + 1):
                b[i, x] = 0.0
            b[i, col.END] = np.inf
        if event != SWITCH:
            if logged < log.size:
                log[logged] = t
                who[logged, 0], who[logged, 1] = event, i
                who[logged, 2] = j if event == BALL else what[i, 1]
            logged += 1
    if ended == ended:
        _sample(b, m, kind, times, next_, until, radius, alpha, out, keep)
        now = until
        if until == np.inf:
            now = 0.0
            for i in range(n):
                if kind[i] != POTTED:
                    now = max(now, b[i, col.CLOCK] + (abs(b[i, col.WZ]) / alpha if alpha > 0.0 else 0.0))
        ended = now
    for i in range(n):
        if kind[i] != POTTED:
            advance(b[i], m[i], kind[i], now, radius, alpha)
        for x in range(ROW_SIZE):
            start[i, x] = b[i, x]
        potted[i] = kind[i] == POTTED
    return ended


@compiled_in_place
def _look_later(now, i, b, m, kind, leans, pair, again, radius):  # type: ignore[no-untyped-def]
    """Let ball i and others that lean on each other at no speed have no other look for a while."""
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
def _lean(i, now, leans, still):  # type: ignore[no-untyped-def]
    """Note that ball i leans on something."""
    if leans[i] <= now:
        still[i, 2] = now
    leans[i] = now + LEAN_MEMORY_S


@compiled_in_place
def _release(b, held, touched, todo, still, now, radius):  # type: ignore[no-untyped-def]
    """Let go of what is held and `touched`, or lies by what is: something that held it may be gone."""
    beside, more = 2.0 * radius + BESIDE_M, True
    while more:
        more = False
        for p in range(b.shape[0]):
            if not held[p]:
                continue
            for q in range(b.shape[0]):
                x, y = b[p, col.X] - b[q, col.X], b[p, col.Y] - b[q, col.Y]
                if touched[q] and x * x + y * y < beside * beside:
                    held[p], touched[p], todo[p], still[p, 2], more = False, True, True, now, True
                    break


@compiled_in_place
def _is_held(b, still, now, radius):  # type: ignore[no-untyped-def]
    """Whether a ball that is pressed has long not moved; then it rests. `still`: where it moved last, and when."""
    x, y, creep = b[col.X] - still[0], b[col.Y] - still[1], CREEP_SPEED * CREEP_SPEED
    ux, uy = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    v2, u2, side = b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY], ux * ux + uy * uy, radius * b[col.WZ]
    if x * x + y * y > creep * HELD_AFTER_S * HELD_AFTER_S or v2 > creep or u2 > creep or side * side > creep:
        still[0], still[1], still[2] = b[col.X], b[col.Y], now
    if now - still[2] < HELD_AFTER_S:
        return False
    b[col.VX] = b[col.VY] = b[col.WX] = b[col.WY] = b[col.WZ] = b[col.AX] = b[col.AY] = b[col.BOUND] = 0.0
    b[col.END] = np.inf
    return True


@compiled
def play_rows(  # type: ignore[no-untyped-def]
    first, last, start, stays, struck, order, own, forces, support, horizon, impact, strike, cloth, mass, radius,
    limits, half, mouths, jaws, falls, table, clusters, until, most, times, out, log, who, count, end, potted,
):  # fmt: skip
    """Play shots number `first` to `last`: `start` (n, nball, 8) in and out, `times` (n, m), `out` (n, m, nball, 8).

    `radius` (n,), `limits` (n, 2) and `half` (n, 2) are those of each shot's balls and table.
    """
    cue, work = np.zeros(STROKE_FIELDS), workspace(start.shape[1], forces.shape[0] > 0)
    for s in range(first, last):
        at = own[s].ctypes.data
        launch = 0.0
        if struck[s]:
            b = start[s, 0]
            launch = deliver(b[col.VX : col.WX], b[col.WX : ROW_SIZE], at, strike, radius[s], mass, cue)
        end[s] = play_shot(
            work, start[s], stays[s], launch, order[s], at, forces, support, horizon, impact, cloth[s], mass, radius[s],
            limits[s], half[s], mouths, jaws, falls, table, clusters, until[s], most, times[s], out[s], log[s], who[s],
            count[s], potted[s],
        )  # fmt: skip
