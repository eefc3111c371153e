"""Several bodies that touch at once: a shot in small steps, through springs that hold restitution and friction.

The springs are those of MuJoCo's contacts (models/analytic/spring.py), stepped in the same way. Friction at a contact,
and of the cloth under a ball that is pressed down, follow from its force by the increments of the impulse models. Jaws
have the springs of cushions, but are no third body that makes a cluster of two. A ball that comes into a cushion from a
mouth, sideways, is the pocket's; there and wherever else one is suddenly deep in something, no spring throws it out.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models import record as rec
from models.analytic.cloth import RESTING, ROLLING, SLIDING, STILL_SPEED, ClothPhase, add_cloth
from models.analytic.events import DEAD_SPEED, MIN_IMPACT_SPEED
from models.analytic.increments import NOT_HELD, ball_step, cushion_step
from models.analytic.spring import (
    CALM_TIME_S,
    CONTACT_GAP_M,
    MAX_CLUSTER_S,
    SLIP_PARTS,
    SPRING_STEP_S,
    depth_of,
    pushed,
)
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.curve import push, see
from models.engine.gaps import line_gap, meets
from models.engine.impacts import ask, describe, followed, is_pressed
from models.engine.motion import POTTED, pot
from models.engine.touch import BALL, CUSHION, MOUTH_DEPTH_M, POCKET
from models.engine.workspace import Contact, Flags, Index
from models.hooks import Array
from models.shot import GRAVITY

CONTACT_RANGE_M = 1e-3  # gap up to which a contact is checked in every step [m]
CROWD_GAP_M = 1e-6  # gap of a third body below which there is a cluster at any speed [m]


class ContactLaw(NamedTuple):
    """How two bodies rub each other in a step."""

    friction: float  # at a slip that is fast
    gain: float  # friction is more by gain exp(-decay slip); two balls only
    decay: float  # [s/m]
    sine: float  # of the elevation of a cushion's nose
    cloth: float  # friction of the cloth
    radius: float  # [m]
    level: float  # horizontal part of the normal along which the bodies are pressed
    down: float  # speed at which the ball goes down [m/s], and the share of its momentum downwards that the slate does
    sink: float  # not return, as in `cushion_step`
    hold: tuple[bool, float, float]  # as in `cushion_step`


class Springs(NamedTuple):
    """The contacts of a cluster, c of them, of n balls."""

    first: Index  # (c,) ball of each
    second: Index  # (c,) other ball, or -1 - the number of a rail or jaw
    near: Index  # (c,) those that are looked at in every step, in order
    gives_back: Array  # (c,) restitution
    mu: Array  # (c, 5) friction, gain, decay and nose, as in `ContactLaw`, and how the cloth's follows what changes it
    peak: Array  # (c,) largest approach speed [m/s]
    given: Array  # (c,) depth that is nobody's work [m]
    deepest: Array  # (c,) largest depth beyond that [m]
    known: Flags  # (c,) which are logged
    heavier: Array  # (n,) masses of the balls over that of the table's ball
    dv: Array  # (n, 5) changes of velocity and spin in a step
    work: Array  # (3, 10)
    hit: Array  # (IMPACT_FIELDS,)


@compiled_in_place
def _flow(b, r, forces, cloth, now, dv):  # type: ignore[no-untyped-def]
    """Set the changes dv (5,) of a ball's velocity and spin to what cloth and effects do to it in a step."""
    radius = r[rec.RADIUS]
    see(b, r, now)
    ux, uy = r[rec.SLIP_X], r[rec.SLIP_Y]
    u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(b[col.VX] ** 2 + b[col.VY] ** 2)
    mode = SLIDING if u > STILL_SPEED else (ROLLING if v > STILL_SPEED else RESTING)
    r[rec.ROLLING] = 1.0 if mode == ROLLING else 0.0
    push(r, forces)
    over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / v if v > 0.0 else 0.0
    add_cloth(r, ClothPhase(mode, u, ux * over, uy * over, v, b[col.VX] * per, b[col.VY] * per, b[col.WZ]), cloth)
    dv[0], dv[1] = r[rec.AX] * SPRING_STEP_S, r[rec.AY] * SPRING_STEP_S
    dv[2], dv[3], dv[4] = r[rec.BX] * SPRING_STEP_S, r[rec.BY] * SPRING_STEP_S, r[rec.BZ] * SPRING_STEP_S
    if mode == ROLLING:
        b[col.ROLLED] += v / radius * SPRING_STEP_S
    # No friction turns a slip, a roll or a sidespin round within a step.
    if mode == SLIDING:
        ux, uy = ux + dv[0] - radius * dv[3], uy + dv[1] + radius * dv[2]
        if u <= 3.5 * cloth[0] * GRAVITY * SPRING_STEP_S:
            dv[0], dv[1] = dv[0] - 2 / 7 * ux, dv[1] - 2 / 7 * uy
            dv[3] += 2.5 / radius * 2 / 7 * ux
            dv[2] -= 2.5 / radius * 2 / 7 * uy
    if b[col.WZ] * (b[col.WZ] + dv[4]) < 0.0:
        dv[4] = -b[col.WZ]


@compiled_in_place
def press(b, contact, dp, masses, law, dv, work):  # type: ignore[no-untyped-def]
    """Add what a normal impulse dp and the friction with it do to the bodies of a contact to their changes dv (n, 5).

    `masses`: of the ball and, if it is one, of the other [kg]; `law`: a `ContactLaw`; `work` (3, 10). Returns the speed
    at which the ball goes down after it [m/s].
    """
    (i, j, _, nx, ny), (own, other), (radius, cloth, hold) = contact, masses, (law.radius, law.cloth, law.hold)
    cushion = j < 0
    ax, ay, bx, by = (ny, -nx, nx, ny) if cushion else (nx, ny, -ny, nx)
    s, out, after = work[0], work[1], work[2]
    for q in range(1 if cushion else 2):
        ball, o = (i if q == 0 else j), 5 * q
        s[o], s[o + 1] = b[ball, col.VX] * ax + b[ball, col.VY] * ay, b[ball, col.VX] * bx + b[ball, col.VY] * by
        s[o + 2], s[o + 3] = b[ball, col.WX] * ax + b[ball, col.WY] * ay, b[ball, col.WX] * bx + b[ball, col.WY] * by
        s[o + 4] = b[ball, col.WZ]
    if cushion:
        s[5] = law.down
    part = hold[0], hold[1] / SLIP_PARTS, hold[2] / SLIP_PARTS
    for x in range(10):
        out[x] = s[x]
    for _ in range(SLIP_PARTS):
        if cushion:
            cushion_step(out, dp / SLIP_PARTS, (law.friction, cloth, own, radius), after, law.sine, law.sink, part)
        else:
            friction = law.friction, law.gain, law.decay
            ball_step(out, dp / SLIP_PARTS, friction, (cloth, own, other, radius), after)
        for x in range(10):
            out[x] = after[x]
    if cushion:
        out[1] += dp * (math.sqrt(1.0 - law.sine * law.sine) - law.level) / own
    for q in range(1 if cushion else 2):
        ball, o = (i if q == 0 else j), 5 * q
        va, vb, wa, wb = out[o] - s[o], out[o + 1] - s[o + 1], out[o + 2] - s[o + 2], out[o + 3] - s[o + 3]
        dv[ball, 0] += va * ax + vb * bx
        dv[ball, 1] += va * ay + vb * by
        dv[ball, 2] += wa * ax + wb * bx
        dv[ball, 3] += wa * ay + wb * by
        dv[ball, 4] += out[o + 4] - s[o + 4]
    return out[5] if cushion and law.sink > 0.0 else 0.0


@compiled_in_place
def _near(balls, springs, geometry):  # type: ignore[no-untyped-def]
    """Fill `near` with the contacts within CONTACT_RANGE_M of closing, in order; returns how many there are."""
    b, kind, first, second, near = balls.rows, balls.kind, springs.first, springs.second, springs.near
    n, found = b.shape[0], 0
    apart, pairs = 2.0 * geometry.radius + CONTACT_RANGE_M, n * (n - 1) // 2
    for c in range(first.size):
        i, j = first[c], second[c]
        if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
            continue
        if c < pairs:
            x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
            away = x * x + y * y > apart * apart
        else:
            away = line_gap(b[i], -1 - j, geometry) > CONTACT_RANGE_M  # a ball in a mouth may come sideways
        if not away:
            near[found] = c
            found += 1
    return found


@compiled_in_place
def is_still(b):  # type: ignore[no-untyped-def]
    """Whether a ball has no velocity and no spin."""
    return b[col.VX] == 0.0 and b[col.VY] == 0.0 and b[col.WX] == 0.0 and b[col.WY] == 0.0 and b[col.WZ] == 0.0


@compiled_in_place
def _go(b, dv, kind, lasts):  # type: ignore[no-untyped-def]
    """Carry the balls through a step by their changes dv; returns the room that they are sure to leave each other [m].

    `lasts` is the room so far: what two balls come together by in a step is at most twice the way of the fastest.
    """
    most = 0.0
    for i in range(b.shape[0]):
        if kind[i] == POTTED:
            continue
        b[i, col.TURN] += SPRING_STEP_S * (b[i, col.WZ] + 0.5 * dv[i, 4])
        b[i, col.VX] += dv[i, 0]
        b[i, col.VY] += dv[i, 1]
        b[i, col.WX] += dv[i, 2]
        b[i, col.WY] += dv[i, 3]
        b[i, col.WZ] += dv[i, 4]
        b[i, col.X] += SPRING_STEP_S * b[i, col.VX]
        b[i, col.Y] += SPRING_STEP_S * b[i, col.VY]
        most = max(most, b[i, col.VX] * b[i, col.VX] + b[i, col.VY] * b[i, col.VY])
    return lasts - 2.0 * SPRING_STEP_S * math.sqrt(most)


@compiled_in_place
def note(record, now, what, i, other):  # type: ignore[no-untyped-def]
    """Log an event of ball i where there is room (`ShotLog`)."""
    number = record.cursor[1]
    if number < record.log.size:
        who = record.who
        record.log[number], who[number, 0], who[number, 1], who[number, 2] = now, what, i, other
    record.cursor[1] = number + 1


@compiled
def through(balls, now, until, geometry, laws, record, hit):  # type: ignore[no-untyped-def]
    """Carry a shot through a cluster, or up to `until` [s]; returns when it has parted.

    `record`: a `ShotLog`, in which samples and events are noted; `hit` (IMPACT_FIELDS,) for work.
    """
    n = balls.kind.size
    rails = 4 + geometry.jaws.shape[0]
    contacts = n * (n - 1) // 2 + rails * n
    springs = Springs(
        np.empty(contacts, np.int64), np.empty(contacts, np.int64), np.empty(contacts, np.int64), np.zeros(contacts),
        np.zeros((contacts, 5)), np.zeros(contacts), np.zeros(contacts), np.zeros(contacts),
        np.zeros(contacts, np.bool_), np.ones(n), np.zeros((n, 5)), np.zeros((3, 10)), hit,
    )  # fmt: skip
    return _through(springs, balls, now, until, geometry, laws, record)


@compiled_in_place
def _lay_contacts(balls, springs, geometry):  # type: ignore[no-untyped-def]
    """All pairs of bodies that may touch, and how deep they stand in each other to begin with."""
    b, kind, first, second = balls.rows, balls.kind, springs.first, springs.second
    n = b.shape[0]
    at = 0
    for i in range(1, n):
        for j in range(i):
            first[at], second[at] = j, i
            at += 1
    for i in range(n):
        for rail in range(4 + geometry.jaws.shape[0]):
            first[at], second[at] = i, -1 - rail
            at += 1
    for c in range(first.size):
        i, j = first[c], second[c]
        if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
            continue
        gap, _, _, _ = meets(b, i, j, geometry)
        if gap < 0.0:
            springs.given[c] = depth_of(j < 0, gap, geometry.radius)[0]


@compiled_in_place
def _begin_impact(springs, c, contact, now, laws, record):  # type: ignore[no-untyped-def]
    """Ask the effects how the impact at contact number c goes, which `hit` describes, and log its first."""
    (i, j, rail, _, _), mu, heavier, hit = contact, springs.mu, springs.heavier, springs.hit
    ask(hit, laws.forces.own, laws.impact)
    springs.gives_back[c] = hit[rec.RESTITUTION]
    mu[c, 0], mu[c, 1], mu[c, 2] = hit[rec.FRICTION], hit[rec.GAIN], hit[rec.DECAY]
    mu[c, 3], mu[c, 4] = hit[rec.NOSE], hit[rec.CLOTH_SHARE]
    heavier[i] = hit[rec.MASS_FIRST]
    if j >= 0:
        heavier[j] = hit[rec.MASS_SECOND]
    if not springs.known[c]:
        springs.known[c] = True
        what, other = (BALL, j) if j >= 0 else (CUSHION, rail)
        record.counts[what] += 1
        note(record, now, what, i, other)


@compiled_in_place
def _sample(balls, dv, now, until, record):  # type: ignore[no-untyped-def]
    """Write the balls at the times within a step, at most to `until`, as their changes dv (n, 5) carry them."""
    b, kind, times, out, cursor = balls.rows, balls.kind, record.times, record.out, record.cursor
    n = b.shape[0]
    while cursor[0] < times.size and times[cursor[0]] <= min(now + SPRING_STEP_S, until):
        part = times[cursor[0]] - now
        for i in range(n):
            o = out[cursor[0], i]
            if kind[i] == POTTED:
                o[:] = np.nan
                continue
            f = part / SPRING_STEP_S
            o[2], o[3] = b[i, col.VX] + f * dv[i, 0], b[i, col.VY] + f * dv[i, 1]
            o[0], o[1] = (
                b[i, col.X] + part * (b[i, col.VX] + dv[i, 0]),
                b[i, col.Y] + part * (b[i, col.VY] + dv[i, 1]),
            )
            for x in range(3):
                o[4 + x] = b[i, col.WX + x] + f * dv[i, 2 + x]
            o[7] = b[i, col.TURN] + part * (b[i, col.WZ] + 0.5 * f * dv[i, 4])
        cursor[0] += 1


@compiled_in_place
def _has_parted(balls, springs, looked, geometry):  # type: ignore[no-untyped-def]
    """Whether nothing presses any longer, and whether nothing moves against what it touches."""
    b, kind, first, second, given = balls.rows, balls.kind, springs.first, springs.second, springs.given
    free, rests = True, True
    for c in springs.near[:looked]:
        i, j = first[c], second[c]
        if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
            continue
        gap, approach, _, _ = meets(b, i, j, geometry)
        if gap > CONTACT_GAP_M:
            continue
        rests = rests and abs(approach) < DEAD_SPEED
        if approach > MIN_IMPACT_SPEED:
            free = False
            continue
        # A spring of little restitution is slower than what it has pushed: that leaves it before it has come back.
        depth = depth_of(j < 0, gap, geometry.radius)[0]
        free = free and depth - min(given[c], depth) <= CONTACT_GAP_M
    return free, rests


@compiled_in_place
def _through(springs, balls, now, until, geometry, laws, record):  # type: ignore[no-untyped-def]
    b, kind, records, radius, mass = balls.rows, balls.kind, balls.records, geometry.radius, laws.mass
    first, second, near, gives_back, mu, peak, given, deepest, _, heavier, dv, work, hit = springs
    n = b.shape[0]
    _lay_contacts(balls, springs, geometry)
    end, calm, room = now + MAX_CLUSTER_S, 0.0, CONTACT_RANGE_M
    looked = _near(balls, springs, geometry)
    while True:
        for i in range(n):
            for x in range(5):
                dv[i, x] = 0.0
            if kind[i] != POTTED and (laws.forces.hooks.shape[0] > 0 or not is_still(b[i])):
                _flow(b[i], records[i], laws.forces, laws.cloth, now, dv[i])
        for c in near[:looked]:
            i, j = first[c], second[c]
            if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
                continue
            gap, approach, nx, ny = meets(b, i, j, geometry)
            if gap > CONTACT_GAP_M:
                peak[c] = given[c] = deepest[c] = 0.0
                continue
            contact, cushion = Contact(i, j, -1 - j, nx, ny), j < 0
            sudden = peak[c] == 0.0 and given[c] == 0.0
            if sudden and -gap > CROWD_GAP_M + 2.0 * SPRING_STEP_S * abs(approach):  # it came sideways
                given[c] = depth_of(cushion, gap, radius)[0]
                if cushion and gap < -MOUTH_DEPTH_M and geometry.jaws.shape[0] == 0 and not balls.stays[i]:
                    pot(b, kind, i)
                    record.counts[POCKET] += 1
                    note(record, now, POCKET, i, -1 - j)
                    continue
            if approach > max(peak[c], MIN_IMPACT_SPEED):
                peak[c] = approach
                describe(hit, b, contact, radius, laws.session, now)
                _begin_impact(springs, c, contact, now, laws, record)
            depth, level = depth_of(cushion, gap, radius)
            given[c] = min(given[c], max(depth, 0.0))
            pressed = depth - given[c]
            deepest[c] = max(deepest[c], pressed)
            push_apart = pushed(cushion, pressed, deepest[c], gives_back[c], approach * level)
            if push_apart == 0.0:
                continue
            one = mass * heavier[i]
            moved = one if cushion else one / (1.0 + heavier[i] / heavier[j])
            dp = SPRING_STEP_S * moved * push_apart
            masses = one, one if cushion else mass * heavier[j]
            cloth = laws.cloth[0]
            if mu[c, 4] != 0.0 and laws.forces.hooks.shape[0] > 0:
                under = i if cushion or is_pressed(b[i], b[j], nx, ny) else j
                cloth = followed(cloth, records[under, rec.SLIDE_FACTOR], mu[c, 4])
            law = ContactLaw(mu[c, 0], mu[c, 1], mu[c, 2], mu[c, 3], cloth, radius, level, 0.0, 0.0, NOT_HELD)
            press(b, contact, dp, masses, law, dv, work)
        _sample(balls, dv, now, until, record)
        room = _go(b, dv, kind, room)
        if room <= 2.0 * CONTACT_GAP_M:
            looked, room = _near(balls, springs, geometry), CONTACT_RANGE_M
        now += SPRING_STEP_S
        free, rests = _has_parted(balls, springs, looked, geometry)
        calm = calm + SPRING_STEP_S if rests else 0.0
        if free or calm >= CALM_TIME_S or now >= end or now >= until:
            return now
