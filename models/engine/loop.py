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
from models.analytic.geometry import TableGeometry
from models.analytic.spring import CUSHION_TIME
from models.compiled import compiled, compiled_in_place, compiled_within
from models.engine import columns as col
from models.engine.ahead import first_event, next_meetings, next_motions
from models.engine.cluster import CROWD_GAP_M, note, through
from models.engine.curve import lay_record
from models.engine.impacts import deliver, is_crowded, part
from models.engine.leaning import lean, release
from models.engine.motion import POTTED, REST, advance, advance_all, arrive, look, pot
from models.engine.rigid import approach_speed, collide_alone, settle
from models.engine.rubber import delay_rebound, push_out, stopped_in_rail
from models.engine.touch import BALL, CUSHION, POCKET, SWITCH
from models.engine.workspace import Forces, Options, Pair, ShotLaws, ShotLog, workspace
from models.hooks import STROKE_FIELDS


@compiled_in_place
def _sample(balls, record, until, radius, alpha):  # type: ignore[no-untyped-def]
    """Write the balls at all times from the next sample on, up to a moment."""
    b, m, kind, times, cursor = balls.rows, balls.curves, balls.kind, record.times, record.cursor
    first = last = cursor[0]
    while last < times.size and times[last] <= until:
        last += 1
    for i in range(b.shape[0]):
        for k in range(first, last):
            if kind[i] == POTTED:
                record.out[k, i, :] = np.nan
            else:
                look(b[i], m[i], kind[i], times[k], radius, alpha, record.out[k, i])
    cursor[0] = last


@compiled_within
def _lay_balls(work, start, stays, radius, laws):  # type: ignore[no-untyped-def]
    """Balls as they begin, all to be worked out; one without a place is potted."""
    balls, notes, still = work.balls, work.notes, work.notes.still
    b, kind = balls.rows, balls.kind
    work.cursor[0] = work.cursor[1] = 0
    for i in range(b.shape[0]):
        lay_record(balls.records[i], i, radius, laws)
        for x in range(col.COLUMN_COUNT):
            b[i, x] = start[i, x] if x < col.ROW_SIZE else 0.0
        kind[i], balls.stays[i] = REST, stays[i]
        notes.todo[i], notes.leans[i], notes.quiet[i], notes.held[i] = True, -np.inf, -np.inf, False
        if math.isnan(b[i, col.X]):
            kind[i] = POTTED
            b[i, col.END] = b[i, col.MEET] = np.inf
        still[i, :, 0], still[i, :, 1], still[i, :, 2] = b[i, col.X], b[i, col.Y], 0.0


@compiled_within
def _in_crowd(balls, pair, speed, now, geometry, laws):  # type: ignore[no-untyped-def]
    """Whether an impact has others so near that all go through springs; brings all balls to its time."""
    advance_all(balls, now, geometry.radius, laws.cloth[2])
    return is_crowded(balls, pair, max(CROWD_GAP_M, speed * CUSHION_TIME), geometry)


@compiled_within
def _after_crowd(balls, notes, now, radius):  # type: ignore[no-untyped-def]
    """Have all balls worked out again that springs have moved, and what they held."""
    b = balls.rows
    for q in range(b.shape[0]):
        b[q, col.CLOCK] = now
        notes.touched[q] = b[q, col.VX] != 0.0 or b[q, col.VY] != 0.0
        notes.todo[q] = not notes.held[q] or notes.touched[q]
    release(b, notes, now, radius)


@compiled_within
def _after_impact(work, pair, speed, slow, now, geometry, alpha):  # type: ignore[no-untyped-def]
    """Let go of what an impact has moved, and part what it has left pressed together."""
    balls, notes, b, (i, j, _) = work.balls, work.notes, work.balls.rows, pair
    if speed >= DEAD_SPEED:
        for q in range(b.shape[0]):
            notes.touched[q] = q in (i, j)
            if notes.held[q]:
                advance(b[q], balls.curves[q], balls.kind[q], now, geometry.radius, alpha)
        release(b, notes, now, geometry.radius)
    if slow:
        part(b, pair, geometry)
    b[i, col.TRY] = 0.0
    if j >= 0:
        b[j, col.TRY] = 0.0


@compiled_within
def _bring(balls, notes, event, i, j, t, radius, alpha):  # type: ignore[no-untyped-def]
    """Bring what an event concerns to its time; returns what it is, and whether two balls are only pressed together."""
    b, m, kind, todo = balls.rows, balls.curves, balls.kind, notes.todo
    advance(b[i], m[i], kind[i], t, radius, alpha)
    todo[i] = True
    if event == BALL:
        advance(b[j], m[j], kind[j], t, radius, alpha)
        todo[j] = True
        if notes.again[j * (j - 1) // 2 + i]:
            return SWITCH, True
    return event, False


@compiled_within
def _impact(work, pair, speed, geometry, laws, now):  # type: ignore[no-untyped-def]
    """Carry two bodies through their impact; whether it leaves them pressed together, and whether they were before."""
    b, leans, (i, j, _) = work.balls.rows, work.notes.leans, pair
    known = leans[i] > now or (j >= 0 and leans[j] > now)
    slow = collide_alone(work.balls, pair, known, geometry, laws, work.impact, now)
    if not slow:
        stays_in = work.impact.hit[rec.CONTACT_TIME]
        delay_rebound(b[i], b[i, col.VX :], pair.rail, stays_in, laws.cloth[0], geometry)
    _after_impact(work, pair, speed, slow, now, geometry, laws.cloth[2])
    return slow, known


@compiled_within
def _settle_pressed(work, pair, geometry, laws, now):  # type: ignore[no-untyped-def]
    """Carry all through at once that press on each other; they lean from now on."""
    balls, notes, touched = work.balls, work.notes, work.notes.touched
    advance_all(balls, now, geometry.radius, laws.cloth[2])
    for q in range(touched.size):
        touched[q] = q in (pair.i, pair.j)
    settle(balls, touched, geometry, laws, work.impact, now)
    for q in range(touched.size):
        if touched[q]:
            notes.todo[q], balls.rows[q, col.TRY], notes.quiet[q] = True, 0.0, np.inf
            lean(q, now, notes.leans, notes.still)


@compiled_within
def _leave_rail(work, i, geometry, alpha, now):  # type: ignore[no-untyped-def]
    """Have a ball that has come to rest in a rail pushed out; all that it moves is worked out again."""
    notes = work.notes
    advance_all(work.balls, now, geometry.radius, alpha)
    push_out(work.balls, i, notes.touched, geometry)
    for q in range(notes.todo.size):
        notes.todo[q] = notes.todo[q] or notes.touched[q]


@compiled_within
def _last_motion(b, kind, alpha):  # type: ignore[no-untyped-def]
    """When the last ball has come to rest, and its sidespin is gone."""
    last = 0.0
    for i in range(b.shape[0]):
        if kind[i] != POTTED:
            last = max(last, b[i, col.CLOCK] + (abs(b[i, col.WZ]) / alpha if alpha > 0.0 else 0.0))
    return last


@compiled_within
def _hand_back(balls, now, radius, alpha, start, potted):  # type: ignore[no-untyped-def]
    """The balls at the end of the shot."""
    b, m, kind = balls.rows, balls.curves, balls.kind
    for i in range(b.shape[0]):
        if kind[i] != POTTED:
            advance(b[i], m[i], kind[i], now, radius, alpha)
        for x in range(col.ROW_SIZE):
            start[i, x] = b[i, x]
        potted[i] = kind[i] == POTTED


@compiled_in_place
def play_shot(work, start, stays, geometry, laws, options, record):  # type: ignore[no-untyped-def]
    """Play one shot from `start` (n, 8), which is left as it ends; returns when, nan where it was given up.

    A potted ball begins with nan for a place; no pocket takes balls that `stays` (n,). `work`: a `Workspace`, the
    others: a `TableGeometry`, `ShotLaws`, `Options` and a `ShotLog`.
    """
    balls, notes, radius, alpha, until = work.balls, work.notes, geometry.radius, laws.cloth[2], options.until
    b, kind, what = balls.rows, balls.kind, notes.what
    _lay_balls(work, start, stays, radius, laws)
    # Counters begin as numbers that the compiler does not know: it would compile what they go into for each literal.
    zero = 0 * start.shape[0]
    now, ended = 0.0, np.nan
    for done in range(options.most + 1):
        next_motions(work, radius, laws, now, until)
        i = stopped_in_rail(balls, notes.todo, geometry) if now > 0.0 else zero - 1
        if i >= 0:
            _leave_rail(work, i, geometry, alpha, now)
            continue
        next_meetings(work, geometry, now, until, zero)
        t, event, i, j = first_event(b, what, notes.pair, zero)
        if t > until or t == np.inf:
            ended = until
            break
        if done == options.most:
            break
        _sample(balls, record, t, radius, alpha)
        now = t
        event, pressed = _bring(balls, notes, event, i, j, t, radius, alpha)
        pair = Pair(i, j, what[i, 1] if event == CUSHION else zero - 1)
        if event in (BALL, CUSHION):
            speed = approach_speed(b, pair, geometry.jaws)
            if (
                options.clusters and pair.rail < 4 and speed >= LEAN_SPEED
                and _in_crowd(balls, pair, speed, t, geometry, laws)
            ):  # fmt: skip
                record.counts[SWITCH] += 1
                now = through(balls, now, until, geometry, laws, record, work.impact.hit)
                _after_crowd(balls, notes, now, radius)
                continue
            pressed, known = _impact(work, pair, speed, geometry, laws, now)
            if pressed and known:
                event = SWITCH
        elif event == SWITCH and t == b[i, col.END]:
            arrive(b[i], kind[i], radius)
        elif event == SWITCH:  # pressed to something, and looked at again
            lean(i, now, notes.leans, notes.still)
        if pressed:
            _settle_pressed(work, pair, geometry, laws, now)
        record.counts[event] += 1
        if event == POCKET:
            pot(b, kind, i)
        if event != SWITCH:
            note(record, t, event, i, j if event == BALL else what[i, 1])
    if ended == ended:
        _sample(balls, record, until, radius, alpha)
        now = ended = _last_motion(b, kind, alpha) if until == np.inf else until
    _hand_back(balls, now, radius, alpha, start, record.potted)
    return ended


@compiled
def play_rows(first, last, game, shots, record, most, clusters):  # type: ignore[no-untyped-def]
    """Play shots number `first` to `last`: a `Game`, `ShotRows` and `LogRows` of models/engine/play.py.

    Each is given up after `most` events; `clusters` as in `Options`.
    """
    hooks, cloth, pockets, limits, half, mass, radius = game
    start, stays, struck, session, until, times = shots
    out, log, who, count, potted, end = record
    cue, work = np.zeros(STROKE_FIELDS), workspace(start.shape[1], hooks.forces.shape[0] > 0)
    for s in range(first, last):
        at = hooks.own[s].ctypes.data
        launch = 0.0
        if struck[s]:
            b = start[s, 0]
            launch = deliver(b[col.VX : col.WX], b[col.WX : col.ROW_SIZE], at, hooks.strike, radius[s], mass, cue)
        geometry = TableGeometry(radius[s], limits[s], half[s], pockets.ends, pockets.jaws, pockets.falls)
        forces = Forces(at, hooks.forces, hooks.support)
        laws = ShotLaws(forces, hooks.horizon, hooks.impact, cloth[s], mass, session[s], launch)
        written = ShotLog(times[s], out[s], log[s], who[s], count[s], potted[s], work.cursor)
        end[s] = play_shot(work, start[s], stays[s], geometry, laws, Options(until[s], most, clusters), written)
