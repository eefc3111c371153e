"""Impacts by their impulse: of two bodies that meet alone, and of all that press on each other slowly, at once.

Bodies that lean on each other (a ball that rolls on against another, a pack that is driven along, what lies against a
cushion) would meet without end: each impact that gives nothing back sets off others at the same moment. So all that
touch within CROWD_GAP_M and close at less than LEAN_SPEED are carried through impacts without restitution, one after
the other and again until none closes: the simultaneous inelastic impact of rigid bodies by Gauss and Seidel's sweeps
(Moreau 1988; Brogliato, Nonsmooth Mechanics, 2016, chapter 5), in which the cloth takes part where it would end a
slip as soon. Each of them takes energy, none gives any.
"""

from __future__ import annotations

import math

from models import record as rec
from models.analytic.cloth import LAST_SLIP_S
from models.analytic.coulomb import MIN_STEPS
from models.analytic.events import DEAD_SPEED, LEAN_SPEED
from models.analytic.impulse import ImpactLaw, collide
from models.analytic.pocket import outward
from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M
from models.engine.curve import slide_factor_in_impact
from models.engine.gaps import rail_gap
from models.engine.impacts import ask, describe, followed, is_pressed, part
from models.engine.motion import POTTED
from models.engine.workspace import Contact, Pair
from models.shot import GRAVITY

MAX_SWEEPS = 20  # largest number of sweeps over bodies that press on each other; the next check treats the rest
SETTLED_SPEED = 1e-6  # approach speed that may remain between bodies that press on each other [m/s]
PARTED_M = 1e-7  # overlap that may remain between them, for instance after a correction of a place [m]


@compiled_in_place
def _cloth_friction(balls, pair, hit, a, laws, now):  # type: ignore[no-untyped-def]
    """Friction of the cloth under the ball that an impact presses onto it; a: axis of models/analytic/impulse.py."""
    if hit[rec.CLOTH_SHARE] == 0.0 or laws.forces.hooks.shape[0] == 0:
        return laws.cloth[0]
    b, (i, j, _), approach, ratio = balls.rows, pair, hit[rec.APPROACH], hit[rec.MASS_FIRST] / hit[rec.MASS_SECOND]
    if j < 0:
        pressed, lost = i, (-approach * a[1], approach * a[0])
    elif is_pressed(b[i], b[j], a[0], a[1]):
        share = approach / (1.0 + ratio)
        pressed, lost = i, (share * a[0], share * a[1])
    else:
        share = -approach * ratio / (1.0 + ratio)
        pressed, lost = j, (share * a[0], share * a[1])
    factor = slide_factor_in_impact(b[pressed], balls.records[pressed], lost, laws.forces, now)
    return followed(laws.cloth[0], factor, hit[rec.CLOTH_SHARE])


@compiled_in_place
def collide_alone(balls, pair, leans, geometry, laws, work, now):  # type: ignore[no-untyped-def]
    """Carry the bodies of a `Pair` through their impact by its impulse; returns whether they lean from now on.

    `leans`: whether they have leant before; `work`: an `ImpactWork`, whose record is that of the impact afterwards.
    """
    b, (i, j, rail), (state, hit), radius = balls.rows, pair, work, geometry.radius
    if j < 0:
        bx, by = outward(rail, b[i, col.X], b[i, col.Y], geometry.jaws)
        ax, ay = by, -bx
        describe(hit, b, Contact(i, j, rail, bx, by), radius, laws.session, now)
    else:
        ax, ay = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
        d = math.sqrt(ax * ax + ay * ay)
        ax, ay = ax / d, ay / d
        bx, by = -ay, ax
        describe(hit, b, Contact(i, j, rail, ax, ay), radius, laws.session, now)
    ask(hit, laws.forces.own, laws.impact)
    slow = hit[rec.APPROACH] < (LEAN_SPEED if leans else DEAD_SPEED)
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        state[o], state[o + 1] = q[col.VX] * ax + q[col.VY] * ay, q[col.VX] * bx + q[col.VY] * by
        state[o + 2], state[o + 3] = q[col.WX] * ax + q[col.WY] * ay, q[col.WX] * bx + q[col.WY] * by
        state[o + 4] = q[col.WZ]
    cloth = _cloth_friction(balls, pair, hit, (ax, ay), laws, now)
    law = ImpactLaw(
        0.0 if slow else hit[rec.RESTITUTION], hit[rec.FRICTION], cloth, hit[rec.GAIN], hit[rec.DECAY],
        hit[rec.MASS_FIRST] / hit[rec.MASS_SECOND], hit[rec.NOSE], hit[rec.COMPLIANCE], hit[rec.SINK],
    )  # fmt: skip
    collide(j < 0, state, law, radius, MIN_STEPS)
    for n in range(1 if j < 0 else 2):
        q, o = b[i] if n == 0 else b[j], 5 * n
        q[col.VX], q[col.VY] = state[o] * ax + state[o + 1] * bx, state[o] * ay + state[o + 1] * by
        q[col.WX], q[col.WY] = state[o + 2] * ax + state[o + 3] * bx, state[o + 2] * ay + state[o + 3] * by
        q[col.WZ] = state[o + 4]
    return slow


@compiled_in_place
def approach_speed(b, pair, jaws):  # type: ignore[no-untyped-def]
    """How fast the bodies of a `Pair` come together [m/s]."""
    i, j, rail = pair
    if j < 0:
        x, y = outward(rail, b[i, col.X], b[i, col.Y], jaws)
        return b[i, col.VX] * x + b[i, col.VY] * y
    x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
    return ((b[i, col.VX] - b[j, col.VX]) * x + (b[i, col.VY] - b[j, col.VY]) * y) / math.sqrt(x * x + y * y)


@compiled_in_place
def _sweep(balls, touched, geometry, laws, work, now):  # type: ignore[no-untyped-def]
    """Carry what closes slowly on a `touched` ball through an impact, one after the other; the fastest [m/s]."""
    b, kind, jaws, radius = balls.rows, balls.kind, geometry.jaws, geometry.radius
    most, none, touch = 0.0, -1 + 0 * b.shape[0], 2.0 * radius + CROWD_GAP_M
    for p in range(b.shape[0]):
        if kind[p] == POTTED:
            continue
        for q in range(p):
            if kind[q] == POTTED or not (touched[p] or touched[q]):
                continue
            x, y = b[p, col.X] - b[q, col.X], b[p, col.Y] - b[q, col.Y]
            if x * x + y * y > touch * touch:
                continue
            pair = Pair(q, p, none)
            speed = approach_speed(b, pair, jaws)
            if SETTLED_SPEED < speed < LEAN_SPEED:
                collide_alone(balls, pair, True, geometry, laws, work, now)
                touched[p] = touched[q] = True
                most = max(most, speed)
        if not touched[p]:
            continue
        for rail in range(4 + jaws.shape[0]):
            if rail_gap(b[p], rail, geometry) > CROWD_GAP_M:
                continue
            pair = Pair(p, none, rail)
            speed = approach_speed(b, pair, jaws)
            if SETTLED_SPEED < speed < LEAN_SPEED:
                collide_alone(balls, pair, True, geometry, laws, work, now)
                most = max(most, speed)
    return max(most, _roll(b, touched, laws.cloth, radius))


@compiled_in_place
def _roll(b, touched, cloth, radius):  # type: ignore[no-untyped-def]
    """Let balls that are `touched` roll where full friction ends their slip in LAST_SLIP_S; the largest ended [m/s].

    Any longer one may last: an effect can weaken the friction that it meets (models/analytic/cloth.py).
    """
    most, slip, spin = 0.0, 3.5 * cloth[0] * GRAVITY * LAST_SLIP_S, cloth[2] * LAST_SLIP_S
    for p in range(b.shape[0]):
        if not touched[p]:
            continue
        ux, uy = b[p, col.VX] - radius * b[p, col.WY], b[p, col.VY] + radius * b[p, col.WX]
        u = math.sqrt(ux * ux + uy * uy)
        if 0.0 < u <= slip:
            b[p, col.VX], b[p, col.VY] = b[p, col.VX] - 2 / 7 * ux, b[p, col.VY] - 2 / 7 * uy
            b[p, col.WX], b[p, col.WY] = -b[p, col.VY] / radius, b[p, col.VX] / radius
            if u > SETTLED_SPEED:
                most = max(most, u)
        if abs(b[p, col.WZ]) <= spin:
            b[p, col.WZ] = 0.0
    return most


@compiled_in_place
def _part_once(balls, touched, geometry):  # type: ignore[no-untyped-def]
    """Put back to where it touches what overlaps a `touched` ball, one after the other; the deepest overlap [m].

    A ball that is put back, and overlaps by more than PARTED_M, is touched, too: in a chain only one pair is looked at.
    """
    b, kind, radius = balls.rows, balls.kind, geometry.radius
    most, none = 0.0, -1 + 0 * b.shape[0]
    for p in range(b.shape[0]):
        if kind[p] == POTTED:
            continue
        for q in range(p):
            x, y = b[p, col.X] - b[q, col.X], b[p, col.Y] - b[q, col.Y]
            if kind[q] == POTTED or not (touched[p] or touched[q]) or x * x + y * y >= 4.0 * radius * radius:
                continue
            over = 2.0 * radius - math.sqrt(x * x + y * y)
            if over > PARTED_M or (touched[p] and touched[q]):
                part(b, Pair(q, p, none), geometry)
                touched[p] = touched[q] = True
                most = max(most, over)
        for rail in range(4 + geometry.jaws.shape[0] if touched[p] else 0):
            gap = rail_gap(b[p], rail, geometry)
            if gap < 0.0:
                most = max(most, -gap)
                part(b, Pair(p, none, rail), geometry)
    return most


@compiled_in_place
def part_all(balls, touched, geometry):  # type: ignore[no-untyped-def]
    """Put back what overlaps a `touched` ball (n,), and what overlaps then, which becomes touched."""
    for _ in range(MAX_SWEEPS):
        if _part_once(balls, touched, geometry) <= PARTED_M:
            break


@compiled_in_place
def settle(balls, touched, geometry, laws, work, now):  # type: ignore[no-untyped-def]
    """Let nothing close that presses on a `touched` ball (n,), or on what those press on: they become touched.

    All balls are at one time. What overlaps is put back to where it touches.
    """
    for _ in range(MAX_SWEEPS):
        if _sweep(balls, touched, geometry, laws, work, now) == 0.0:
            break
    part_all(balls, touched, geometry)
