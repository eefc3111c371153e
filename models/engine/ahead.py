"""The next event of a shot: the motion of every ball, its next contacts, and the first event.

Only balls that an event has changed (`todo`) are worked out anew. `work` is a `Workspace`.
"""

from __future__ import annotations

import numpy as np

from models.analytic.events import DEAD_SPEED
from models.compiled import compiled_within
from models.engine import columns as col
from models.engine.curve import curve
from models.engine.leaning import is_held, look_later
from models.engine.motion import POTTED, REST, plain_phase
from models.engine.rigid import approach_speed
from models.engine.touch import BALL, CUSHION, SWITCH, meet_balls, meet_table, recheck
from models.engine.workspace import Motion, Pair


@compiled_within
def next_motions(work, radius, laws, now, until):  # type: ignore[no-untyped-def]
    """How the balls move from now on: held, along a curve that effects push them on, or plainly."""
    balls, notes, curved = work.balls, work.notes, laws.forces.hooks.shape[0] > 0
    b, kind, held = balls.rows, balls.kind, notes.held
    for i in range(b.shape[0]):
        if notes.todo[i] and kind[i] != POTTED:
            held[i] = curved and notes.leans[i] > now and is_held(b[i], notes.still[i], now, radius)
            if held[i]:
                kind[i] = REST
            elif curved:
                kind[i] = curve(b[i], balls.curves[i], balls.records[i], laws, until, work.curve)
            else:
                kind[i] = plain_phase(b[i], radius, laws.cloth[0], laws.cloth[1])


@compiled_within
def next_meetings(work, geometry, now, until, zero):  # type: ignore[no-untyped-def]
    """What the balls meet, of the table and of each other; they are then worked out."""
    balls, notes = work.balls, work.notes
    b, what, quiet = balls.rows, notes.what, notes.quiet
    for i in range(b.shape[0]):
        if notes.todo[i]:
            # What leans on a cushion has no other look at it for a while: looks would follow without end.
            left_out, soon = zero, True
            if quiet[i] == np.inf:  # it has just been pressed, and how it goes on from there is known now
                quiet[i] = now + recheck(b[i, col.BOUND])
            motion = Motion(b[i], balls.curves[i], balls.kind[i])
            while soon:
                meet_table(motion, what[i], geometry, balls.stays[i], until, left_out)
                soon = quiet[i] > now and what[i, 0] == CUSHION and b[i, col.MEET] < quiet[i]
                soon = soon and approach_speed(b, Pair(i, zero - 1, what[i, 1]), geometry.jaws) < DEAD_SPEED
                if soon:
                    left_out |= 1 << what[i, 1]
            if left_out and quiet[i] < b[i, col.MEET]:
                b[i, col.MEET], what[i, 0] = quiet[i], SWITCH
            meet_balls(balls, notes, i, geometry.radius, now, until)
            if notes.leans[i] > now:
                look_later(balls, notes, i, now, geometry.radius)
            notes.todo[i] = False


@compiled_within
def first_event(b, what, pair, zero):  # type: ignore[no-untyped-def]
    """Time of the first event, what it is, whose, and of which other ball, or -1."""
    t, event, i, j = np.inf, SWITCH + zero, zero - 1, zero - 1
    for q in range(b.shape[0]):
        if b[q, col.MEET] < t:
            t, event, i = b[q, col.MEET], what[q, 0], q
        if b[q, col.END] < t:
            t, event, i = b[q, col.END], SWITCH, q
    at = 0
    for q in range(1, b.shape[0]):
        for p in range(q):
            if pair[at] < t:
                t, event, i, j = pair[at], BALL, p, q
            at += 1
    return t, event, i, j
