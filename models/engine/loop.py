"""The event loop of a shot, and many shots in a row.

Kept for every ball is when its motion ends and what it meets of the table, for every pair when it meets; only what an
event has changed is worked out anew. Two bodies that meet alone are carried through by their impulse
(models/analytic/impulse.py), several at a time through springs (models/engine/cluster.py).

Where pockets have jaws (models/analytic/pocket.py) a straight rail ends before them, jaw k is logged as rail 4 + k,
and a ball falls where the slate ends; otherwise it falls where its centre passes the nose line within a mouth.

Impacts without end (a ball held between others, or pressed to a cushion by its own friction): an impact below
DEAD_SPEED gives nothing back, nor does one below LEAN_SPEED of a ball that has just had such an impact, which is not
logged either; a touch below MIN_IMPACT_SPEED is none, and bodies pressed together at rest are checked again after
PRESSED_RECHECK_S. A shot with more than `most` events is given up, and reported.
"""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.coulomb import MIN_STEPS
from models.analytic.events import DEAD_SPEED, LEAN_SPEED
from models.analytic.impulse import collide
from models.analytic.pocket import outward
from models.analytic.spring import CUSHION_TIME
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, through
from models.engine.curve import MAX_STEP_S, curve, lay_record
from models.engine.impacts import ask, deliver, describe, is_crowded, part
from models.engine.motion import POTTED, REST, advance, arrive, plain_phase
from models.engine.touch import BALL, CUSHION, POCKET, PRESSED_RECHECK_S, SWITCH, meet_balls, meet_table
from models.hooks import STROKE_FIELDS

LEAN_MEMORY_S = 2.5 * PRESSED_RECHECK_S  # for how long a ball that leans is known to [s]
ROW_SIZE = 8  # numbers of a ball at a moment: place, velocity, spin, angle turned


@compiled_in_place
def collide_alone(b, i, j, rail, jaws, state, hit, leans, own, impact, cloth, mass, radius, order, now):  # type: ignore[no-untyped-def]
    """Carry two balls, or one and a cushion (j < 0), through their impact by its impulse; returns whether they lean."""
    if j < 0:
        bx, by = outward(rail, b[i, col.X], b[i, col.Y], jaws)
        ax, ay = by, -bx
        describe(hit, True, i, rail, b[i], b[i], bx, by, radius, order, now)
    else:
        ax, ay = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
        d = math.sqrt(ax * ax + ay * ay)
        ax, ay = ax / d, ay / d
        bx, by = -ay, ax
        describe(hit, False, i, j, b[i], b[j], ax, ay, radius, order, now)
    ask(hit, hit.ctypes.data, own, impact)
    slow = hit[rec.APPROACH] < (LEAN_SPEED if leans else DEAD_SPEED)
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        state[o], state[o + 1] = q[col.VX] * ax + q[col.VY] * ay, q[col.VX] * bx + q[col.VY] * by
        state[o + 2], state[o + 3] = q[col.WX] * ax + q[col.WY] * ay, q[col.WX] * bx + q[col.WY] * by
        state[o + 4] = q[col.WZ]
    collide(
        j < 0, state, 0.0 if slow else hit[rec.RESTITUTION], (hit[rec.FRICTION], cloth[0], mass, radius), MIN_STEPS,
        hit[rec.GAIN], hit[rec.DECAY], hit[rec.MASS_FIRST] / hit[rec.MASS_SECOND], hit[rec.NOSE],
        hit[rec.COMPLIANCE], hit[rec.SINK],
    )  # fmt: skip
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        q[col.VX], q[col.VY] = state[o] * ax + state[o + 1] * bx, state[o] * ay + state[o + 1] * by
        q[col.WX], q[col.WY] = state[o + 2] * ax + state[o + 3] * bx, state[o + 2] * ay + state[o + 3] * by
        q[col.WZ] = state[o + 4]
    return slow


@compiled_in_place
def approach_speed(b, i, j, rail, jaws):  # type: ignore[no-untyped-def]
    """How fast two balls, or one and a cushion (j < 0), come together [m/s]."""
    if j < 0:
        x, y = outward(rail, b[i, col.X], b[i, col.Y], jaws)
        return b[i, col.VX] * x + b[i, col.VY] * y
    x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
    return ((b[i, col.VX] - b[j, col.VX]) * x + (b[i, col.VY] - b[j, col.VY]) * y) / math.sqrt(x * x + y * y)


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
    known = np.zeros(n, np.int64), np.zeros((n, 2), np.int64), np.zeros(n), np.zeros(n), np.zeros(n, np.bool_)
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
    (b, m, records), (kind, what, leans, quiet, todo), (pair, again), (state, hit, keep, y, k) = work
    slide, roll, alpha = cloth[0], cloth[1], cloth[2]
    for i in range(n):
        lay_record(records[i], i, launch, order, radius, mass)
        for x in range(col.COLUMN_COUNT):
            b[i, x] = start[i, x] if x < ROW_SIZE else 0.0
        kind[i], todo[i], leans[i], quiet[i] = REST, True, -np.inf, -np.inf
        if math.isnan(b[i, col.X]):
            kind[i] = POTTED
            b[i, col.END] = b[i, col.MEET] = np.inf
    # Counters begin as numbers that the compiler does not know: it would compile what they go into for each literal.
    zero = 0 * n
    next_, logged, now, ended = zero, zero, 0.0, np.nan
    for done in range(most + 1):
        for i in range(n):
            if todo[i] and kind[i] != POTTED:
                if curved:
                    kind[i] = curve(
                        b[i], m[i], until, MAX_STEP_S, records[i], records[i].ctypes.data, own, forces, support,
                        horizon, cloth, y, k,
                    )  # fmt: skip
                else:
                    kind[i] = plain_phase(b[i], radius, slide, roll)
        for i in range(n):
            if todo[i]:
                meet_table(b[i], m[i], what, i, kind[i], limits, half, mouths, jaws, falls, stays[i], until)
                # What leans on a cushion has no other look at it for a while: looks would follow without end.
                soon = quiet[i] > now and what[i, 0] == CUSHION and b[i, col.MEET] < quiet[i]
                if soon and approach_speed(b, i, zero - 1, what[i, 1], jaws) < LEAN_SPEED:
                    b[i, col.MEET], what[i, 0] = quiet[i], SWITCH
                meet_balls(now, i, b, m, kind, pair, again, radius, until)
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
        if event == BALL:
            advance(b[j], m[j], kind[j], t, radius, alpha)
            todo[j] = True
            if again[j * (j - 1) // 2 + i]:
                event, leans[j] = SWITCH, now + LEAN_MEMORY_S
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
                        todo[q] = True
                    continue
            known = leans[i] > now or (j >= 0 and leans[j] > now)
            slow = collide_alone(b, i, j, rail, jaws, state, hit, known, own, impact, cloth, mass, radius, order, now)
            if slow:
                part(b, i, j, rail, jaws, radius, limits)
                leans[i] = now + LEAN_MEMORY_S
                if j >= 0:
                    leans[j] = now + LEAN_MEMORY_S
                else:
                    quiet[i] = now + PRESSED_RECHECK_S
            b[i, col.TRY] = 0.0
            if j >= 0:
                b[j, col.TRY] = 0.0
            if slow and known:
                event = SWITCH
        elif event == SWITCH and t == b[i, col.END]:
            arrive(b[i], kind[i], radius)
        elif event == SWITCH:  # pressed to something, and looked at again
            leans[i] = now + LEAN_MEMORY_S
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
