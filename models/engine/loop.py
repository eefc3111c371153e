"""The event loop of a shot, and many shots in a row.

Kept for every ball is when its motion ends and what it meets of the table, for every pair when it meets; only what an
event has changed is worked out anew (models/engine/ahead.py). Two bodies that meet alone are carried through by their
impulse (models/analytic/impulse.py), several at a time through springs (models/engine/cluster.py).

Where pockets have jaws (models/analytic/pocket.py) a straight rail ends before them, jaw k is logged as rail 4 + k,
and a ball falls where the slate ends; otherwise it falls where its centre passes the nose line within a mouth.

Impacts without end (a ball held between others, or pressed to a cushion by its own friction): an impact below
DEAD_SPEED gives nothing back, nor does one below LEAN_SPEED of a ball that has just had such an impact, which is not
logged either; all that press on each other so are carried through at once (models/engine/rigid.py). A touch below
MIN_IMPACT_SPEED is none, and bodies pressed together at rest are checked again after PRESSED_RECHECK_S. What is pressed
and does not move rests in the end (models/engine/leaning.py). A shot with more
than `most` events is given up, and reported.
"""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.events import DEAD_SPEED, LEAN_SPEED
from models.analytic.spring import CUSHION_TIME
from models.compiled import compiled, compiled_in_place, compiled_within
from models.engine import columns as col
from models.engine.ahead import first_event, next_meetings, next_motions
from models.engine.cluster import CROWD_GAP_M, through
from models.engine.curve import lay_record
from models.engine.impacts import deliver, is_crowded, part
from models.engine.leaning import lean, release
from models.engine.motion import POTTED, REST, advance, arrive, pot
from models.engine.rigid import approach_speed, collide_alone, settle
from models.engine.rubber import delay_rebound, push_out, stopped_in_rail
from models.engine.touch import BALL, CUSHION, POCKET, SWITCH
from models.hooks import STROKE_FIELDS

ROW_SIZE = 8  # numbers of a ball at one time: place, velocity, spin, angle turned


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
        np.zeros((n, 2, 3)),
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


@compiled_within
def _lay_balls(balls, notes, start, launch, session, mass, radius):  # type: ignore[no-untyped-def]
    """Balls as they begin, all to be worked out; one without a place is potted."""
    (b, _, records), (kind, _, leans, quiet, still, (todo, _, held)) = balls, notes
    for i in range(b.shape[0]):
        lay_record(records[i], i, launch, session, radius, mass)
        for x in range(col.COLUMN_COUNT):
            b[i, x] = start[i, x] if x < ROW_SIZE else 0.0
        kind[i], todo[i], leans[i], quiet[i] = REST, True, -np.inf, -np.inf
        if math.isnan(b[i, col.X]):
            kind[i] = POTTED
            b[i, col.END] = b[i, col.MEET] = np.inf
        still[i, :, 0], still[i, :, 1], still[i, :, 2], held[i] = b[i, col.X], b[i, col.Y], 0.0, False


@compiled_within
def _in_crowd(  # type: ignore[no-untyped-def]
    balls, kind, i, j, rail, speed, t, limits, half, mouths, radius, alpha
):  # fmt: skip
    """Whether an impact has others so near that all go through springs; brings all balls to its time."""
    b, m, _ = balls
    for q in range(b.shape[0]):
        advance(b[q], m[q], kind[q], t, radius, alpha)
    near = max(CROWD_GAP_M, speed * CUSHION_TIME)
    return is_crowded(b, kind, i, j, rail, near, radius, limits, half, mouths)


@compiled_within
def _after_crowd(b, notes, now, radius):  # type: ignore[no-untyped-def]
    """Have all balls worked out again that springs have moved, and what they held."""
    _, _, _, _, still, (todo, touched, held) = notes
    for q in range(b.shape[0]):
        b[q, col.CLOCK] = now
        touched[q] = b[q, col.VX] != 0.0 or b[q, col.VY] != 0.0
        todo[q] = not held[q] or touched[q]
    release(b, held, touched, todo, still, now, radius)


@compiled_within
def _after_impact(  # type: ignore[no-untyped-def]
    balls, notes, i, j, rail, speed, slow, now, jaws, limits, radius, alpha
):  # fmt: skip
    """Let go of what an impact has moved, and part what it has left pressed together."""
    (b, m, _), (kind, _, _, _, still, (todo, touched, held)) = balls, notes
    if speed >= DEAD_SPEED:
        for q in range(b.shape[0]):
            touched[q] = q in (i, j)
            if held[q]:
                advance(b[q], m[q], kind[q], now, radius, alpha)
        release(b, held, touched, todo, still, now, radius)
    if slow:
        part(b, i, j, rail, jaws, radius, limits)
    b[i, col.TRY] = 0.0
    if j >= 0:
        b[j, col.TRY] = 0.0


@compiled_within
def _settle_pressed(  # type: ignore[no-untyped-def]
    balls, notes, i, j, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session, now
):  # fmt: skip
    """Carry all through at once that press on each other; they lean from now on."""
    (b, m, _), (kind, _, leans, quiet, still, (todo, touched, _)) = balls, notes
    for q in range(b.shape[0]):
        advance(b[q], m[q], kind[q], now, radius, cloth[2])
    settle(
        b, kind, i, j, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session, now
    )
    for q in range(b.shape[0]):
        if touched[q]:
            todo[q], b[q, col.TRY], quiet[q] = True, 0.0, np.inf
            lean(q, now, leans, still)


@compiled_within
def _leave_rail(balls, notes, i, jaws, radius, alpha, limits, half, mouths, now):  # type: ignore[no-untyped-def]
    """Have a ball that has come to rest in a rail pushed out; all that it moves is worked out again."""
    (b, m, _), (kind, _, _, _, _, (todo, touched, _)) = balls, notes
    for q in range(b.shape[0]):
        advance(b[q], m[q], kind[q], now, radius, alpha)
    push_out(b, kind, i, touched, jaws, radius, limits, half, mouths)
    for q in range(b.shape[0]):
        todo[q] = todo[q] or touched[q]


@compiled_within
def _last_motion(b, kind, alpha):  # type: ignore[no-untyped-def]
    """When the last ball has come to rest, and its sidespin is gone."""
    last = 0.0
    for i in range(b.shape[0]):
        if kind[i] != POTTED:
            last = max(last, b[i, col.CLOCK] + (abs(b[i, col.WZ]) / alpha if alpha > 0.0 else 0.0))
    return last


@compiled_within
def _hand_back(balls, kind, now, radius, alpha, start, potted):  # type: ignore[no-untyped-def]
    """The balls at the end of the shot."""
    b, m, _ = balls
    for i in range(b.shape[0]):
        if kind[i] != POTTED:
            advance(b[i], m[i], kind[i], now, radius, alpha)
        for x in range(ROW_SIZE):
            start[i, x] = b[i, x]
        potted[i] = kind[i] == POTTED


@compiled_in_place
def play_shot(  # type: ignore[no-untyped-def]
    work, start, stays, launch, session, own, forces, support, horizon, impact, cloth, mass, radius, limits, half,
    mouths, jaws, falls, clusters, until, most, times, out, log, who, count, potted,
):  # fmt: skip
    """Play one shot from `start` (n, 8), which is left as it ends; returns when, nan where it was given up.

    `own` is the address of the effects' parameters, `forces`, `horizon`, `impact` their hooks (models/hooks.py),
    `cloth` friction of sliding and rolling, and deceleration of sidespin; a potted ball begins with nan for a place.
    """
    balls, notes, pairs, (state, hit, keep, y, k) = work
    (b, m, records), (kind, what, leans, _, still, (todo, _, _)), (pair, again) = balls, notes, pairs
    alpha, curved = cloth[2], forces.shape[0] > 0
    _lay_balls(balls, notes, start, launch, session, mass, radius)
    # Counters begin as numbers that the compiler does not know: it would compile what they go into for each literal.
    zero = 0 * start.shape[0]
    next_, logged, now, ended = zero, zero, 0.0, np.nan
    for done in range(most + 1):
        next_motions(balls, notes, now, until, curved, own, forces, support, horizon, cloth, radius, y, k)
        i = stopped_in_rail(b, kind, todo, jaws, limits, half, mouths) if now > 0.0 else zero - 1
        if i >= 0:
            _leave_rail(balls, notes, i, jaws, radius, alpha, limits, half, mouths, now)
            continue
        next_meetings(balls, notes, pairs, stays, now, until, limits, half, mouths, jaws, falls, radius, zero)
        t, event, i, j = first_event(b, what, pair, zero)
        if t > until or t == np.inf:
            ended = until
            break
        if done == most:
            break
        next_ = _sample(b, m, kind, times, next_, t, radius, alpha, out, keep)
        now, pressed = t, False
        advance(b[i], m[i], kind[i], t, radius, alpha)
        todo[i] = True
        if event == BALL:
            advance(b[j], m[j], kind[j], t, radius, alpha)
            todo[j] = True
            if again[j * (j - 1) // 2 + i]:
                event, pressed = SWITCH, True
        if event in (BALL, CUSHION):
            rail = what[i, 1] if event == CUSHION else zero - 1
            speed = approach_speed(b, i, j, rail, jaws)
            if (
                clusters and rail < 4 and speed >= LEAN_SPEED
                and _in_crowd(balls, kind, i, j, rail, speed, t, limits, half, mouths, radius, alpha)
            ):  # fmt: skip
                count[SWITCH] += 1
                now, next_, logged = through(
                    b, kind, stays, now, until, records, own, forces, support, impact, cloth, mass, radius, limits,
                    half, mouths, jaws, session, hit, times, next_, out, log, who, logged, count,
                )  # fmt: skip
                _after_crowd(b, notes, now, radius)
                continue
            known = leans[i] > now or (j >= 0 and leans[j] > now)
            slow = collide_alone(b, i, j, rail, jaws, state, hit, known, own, impact, cloth, mass, radius, session, now)
            if not slow:
                delay_rebound(b[i], b[i, col.VX :], rail, hit[rec.CONTACT_TIME], cloth[0], radius, half, mouths)
            _after_impact(balls, notes, i, j, rail, speed, slow, now, jaws, limits, radius, alpha)
            pressed = slow
            if slow and known:
                event = SWITCH
        elif event == SWITCH and t == b[i, col.END]:
            arrive(b[i], kind[i], radius)
        elif event == SWITCH:  # pressed to something, and looked at again
            lean(i, now, leans, still)
        if pressed:
            _settle_pressed(
                balls, notes, i, j, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session,
                now,
            )  # fmt: skip
        count[event] += 1
        if event == POCKET:
            pot(b, kind, i)
        if event != SWITCH:
            if logged < log.size:
                log[logged] = t
                who[logged, 0], who[logged, 1] = event, i
                who[logged, 2] = j if event == BALL else what[i, 1]
            logged += 1
    if ended == ended:
        _sample(b, m, kind, times, next_, until, radius, alpha, out, keep)
        now = ended = _last_motion(b, kind, alpha) if until == np.inf else until
    _hand_back(balls, kind, now, radius, alpha, start, potted)
    return ended


@compiled
def play_rows(  # type: ignore[no-untyped-def]
    first, last, start, stays, struck, session, own, forces, support, horizon, impact, strike, cloth, mass, radius,
    limits, half, mouths, jaws, falls, clusters, until, most, times, out, log, who, count, end, potted,
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
            work, start[s], stays[s], launch, session[s], at, forces, support, horizon, impact, cloth[s], mass,
            radius[s], limits[s], half[s], mouths, jaws, falls, clusters, until[s], most, times[s], out[s],
            log[s], who[s], count[s], potted[s],
        )  # fmt: skip
