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
from models.analytic.impulse import collide
from models.analytic.pocket import outward
from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, rail_gap
from models.engine.impacts import ask, describe, part
from models.engine.motion import POTTED
from models.shot import GRAVITY

MAX_SWEEPS = 20  # largest number of sweeps over bodies that press on each other; the next check treats the rest
SETTLED_SPEED = 1e-6  # approach speed that may remain between bodies that press on each other [m/s]
PARTED_M = 1e-7  # overlap that may remain between them, for instance after a correction of a place [m]


@compiled_in_place
def collide_alone(b, i, j, rail, jaws, state, hit, leans, own, impact, cloth, mass, radius, session, now):  # type: ignore[no-untyped-def]
    """Carry two balls, or one and a cushion (j < 0), through their impact by its impulse; returns whether they lean."""
    if j < 0:
        bx, by = outward(rail, b[i, col.X], b[i, col.Y], jaws)
        ax, ay = by, -bx
        describe(hit, True, i, rail, b[i], b[i], bx, by, radius, session, now)
    else:
        ax, ay = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
        d = math.sqrt(ax * ax + ay * ay)
        ax, ay = ax / d, ay / d
        bx, by = -ay, ax
        describe(hit, False, i, j, b[i], b[j], ax, ay, radius, session, now)
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
def _sweep(  # type: ignore[no-untyped-def]
    b, kind, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session, now,
):  # fmt: skip
    """Carry what closes slowly on a `touched` ball through an impact, one after the other; the fastest [m/s]."""
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
            speed = approach_speed(b, q, p, none, jaws)
            if SETTLED_SPEED < speed < LEAN_SPEED:
                collide_alone(b, q, p, none, jaws, state, hit, True, own, impact, cloth, mass, radius, session, now)
                touched[p] = touched[q] = True
                most = max(most, speed)
        if not touched[p]:
            continue
        for rail in range(4 + jaws.shape[0]):
            if rail_gap(b[p], rail, jaws, limits, half, mouths) > CROWD_GAP_M:
                continue
            speed = approach_speed(b, p, none, rail, jaws)
            if SETTLED_SPEED < speed < LEAN_SPEED:
                collide_alone(b, p, none, rail, jaws, state, hit, True, own, impact, cloth, mass, radius, session, now)
                most = max(most, speed)
    return max(most, _roll(b, touched, cloth, radius))


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
def _part_once(b, kind, touched, jaws, radius, limits, half, mouths):  # type: ignore[no-untyped-def]
    """Put back to where it touches what overlaps a `touched` ball, one after the other; the deepest overlap [m].

    A ball that is put back, and overlaps by more than PARTED_M, is touched, too: in a chain only one pair is looked at.
    """
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
                part(b, q, p, none, jaws, radius, limits)
                touched[p] = touched[q] = True
                most = max(most, over)
        for rail in range(4 + jaws.shape[0] if touched[p] else 0):
            gap = rail_gap(b[p], rail, jaws, limits, half, mouths)
            if gap < 0.0:
                most = max(most, -gap)
                part(b, p, none, rail, jaws, radius, limits)
    return most


@compiled_in_place
def part_all(b, kind, touched, jaws, radius, limits, half, mouths):  # type: ignore[no-untyped-def]
    """Put back what overlaps a `touched` ball (n,), and what overlaps then, which becomes touched."""
    for _ in range(MAX_SWEEPS):
        if _part_once(b, kind, touched, jaws, radius, limits, half, mouths) <= PARTED_M:
            break


@compiled_in_place
def settle(  # type: ignore[no-untyped-def]
    b, kind, i, j, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session, now,
):  # fmt: skip
    """Let nothing close that presses on ball i or j (j < 0: a cushion), or on what they press on: fills `touched` (n,).

    All balls are at one time. What overlaps is put back to where it touches.
    """
    for q in range(b.shape[0]):
        touched[q] = q in (i, j)
    for _ in range(MAX_SWEEPS):
        most = _sweep(
            b, kind, touched, jaws, state, hit, own, impact, cloth, mass, radius, limits, half, mouths, session, now
        )
        if most == 0.0:
            break
    part_all(b, kind, touched, jaws, radius, limits, half, mouths)
