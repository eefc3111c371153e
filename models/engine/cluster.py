"""Several bodies that touch at once: a shot in small steps, through springs that hold restitution and friction.

The springs are those of MuJoCo's contacts (models/analytic/spring.py), stepped in the same way. Friction at a contact,
and of the cloth under a ball that is pressed down, follow from its force by the increments of the impulse models. Jaws
have the springs of cushions, but are no third body that makes a cluster of two. A ball that comes into a cushion from a
mouth, sideways, is the pocket's; there and wherever else one is suddenly deep in something, no spring throws it out.
"""

from __future__ import annotations

import math

import numpy as np

from models import record as rec
from models.analytic.cloth import RESTING, ROLLING, SLIDING, STILL_SPEED, add_cloth
from models.analytic.events import DEAD_SPEED, MIN_IMPACT_SPEED, in_mouth
from models.analytic.increments import NOT_HELD, ball_step, cushion_step
from models.analytic.pocket import jaw_gap, outward
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
from models.engine.curve import push
from models.engine.impacts import ask, describe
from models.engine.motion import POTTED, pot
from models.engine.touch import BALL, CUSHION, MOUTH_DEPTH_M, POCKET
from models.shot import GRAVITY

CONTACT_RANGE_M = 1e-3  # gap up to which a contact is checked in every step [m]
CROWD_GAP_M = 1e-6  # gap of a third body below which there is a cluster at any speed [m]


@compiled_in_place
def _meets(b, i, j, radius, limits, half, mouths, jaws):  # type: ignore[no-untyped-def]
    """Gap, approach speed and normal of balls i and j, or of ball i and rail or jaw -1 - j where j < 0."""
    if j >= 0:
        x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
        d2, touch = x * x + y * y, 2.0 * radius + CONTACT_GAP_M
        if d2 > touch * touch:
            return np.inf, 0.0, 1.0, 0.0
        d = math.sqrt(d2)
        x, y = x / d, y / d
        return d - 2.0 * radius, (b[i, col.VX] - b[j, col.VX]) * x + (b[i, col.VY] - b[j, col.VY]) * y, x, y
    rail = -1 - j
    gap = rail_gap(b[i], rail, jaws, limits, half, mouths)
    if gap > CONTACT_GAP_M:
        return np.inf, 0.0, 1.0, 0.0
    x, y = outward(rail, b[i, col.X], b[i, col.Y], jaws)
    return gap, b[i, col.VX] * x + b[i, col.VY] * y, x, y


@compiled_in_place
def _line_gap(b, rail, jaws, limits):  # type: ignore[no-untyped-def]
    """Distance of a ball from a jaw, or from a rail's line of contact, also where that is open."""
    if rail >= 4:
        return jaw_gap(jaws[rail - 4], b[col.X], b[col.Y])
    return limits[rail // 2] - (1.0 - 2.0 * (rail % 2)) * b[rail // 2]


@compiled_in_place
def rail_gap(b, rail, jaws, limits, half, mouths):  # type: ignore[no-untyped-def]
    """Distance of a ball from contact with a rail or a jaw; inf where that is open or elsewhere."""
    if rail < 4 and in_mouth(b[1 - rail // 2], rail, half, mouths):
        return math.inf
    return _line_gap(b, rail, jaws, limits)


@compiled_in_place
def _flow(b, i, r, at, own, forces, support, cloth, now, dv):  # type: ignore[no-untyped-def]
    """Add what cloth and effects do to ball i in a step to its changes dv (n, 5) of velocity and spin."""
    radius = r[rec.RADIUS]
    ux, uy = b[i, col.VX] - radius * b[i, col.WY], b[i, col.VY] + radius * b[i, col.WX]
    u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(b[i, col.VX] ** 2 + b[i, col.VY] ** 2)
    r[rec.X], r[rec.Y], r[rec.VX], r[rec.VY] = b[i, col.X], b[i, col.Y], b[i, col.VX], b[i, col.VY]
    r[rec.WX], r[rec.WY], r[rec.WZ], r[rec.SLIP_X], r[rec.SLIP_Y] = b[i, col.WX], b[i, col.WY], b[i, col.WZ], ux, uy
    r[rec.TIME], r[rec.ROLLED] = now, b[i, col.ROLLED]
    mode = SLIDING if u > STILL_SPEED else (ROLLING if v > STILL_SPEED else RESTING)
    r[rec.ROLLING] = 1.0 if mode == ROLLING else 0.0
    push(r, at, own, forces, support)
    over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / v if v > 0.0 else 0.0
    add_cloth(
        r,
        mode,
        u,
        ux * over,
        uy * over,
        b[i, col.VX] * per,
        b[i, col.VY] * per,
        b[i, col.WZ],
        cloth[0],
        cloth[1],
        cloth[2],
    )
    dv[i, 0], dv[i, 1] = r[rec.AX] * SPRING_STEP_S, r[rec.AY] * SPRING_STEP_S
    dv[i, 2], dv[i, 3], dv[i, 4] = r[rec.BX] * SPRING_STEP_S, r[rec.BY] * SPRING_STEP_S, r[rec.BZ] * SPRING_STEP_S
    if mode == ROLLING:
        b[i, col.ROLLED] += v / radius * SPRING_STEP_S
    # No friction turns a slip, a roll or a sidespin round within a step.
    if mode == SLIDING:
        ux, uy = ux + dv[i, 0] - radius * dv[i, 3], uy + dv[i, 1] + radius * dv[i, 2]
        if u <= 3.5 * cloth[0] * GRAVITY * SPRING_STEP_S:
            dv[i, 0], dv[i, 1] = dv[i, 0] - 2 / 7 * ux, dv[i, 1] - 2 / 7 * uy
            dv[i, 3] += 2.5 / radius * 2 / 7 * ux
            dv[i, 2] -= 2.5 / radius * 2 / 7 * uy
    if b[i, col.WZ] * (b[i, col.WZ] + dv[i, 4]) < 0.0:
        dv[i, 4] = -b[i, col.WZ]


@compiled_in_place
def press(  # type: ignore[no-untyped-def]
    b, i, j, nx, ny, dp, mu, cloth, heavier, mass, level, dv, work, down=0.0, sink=0.0, hold=NOT_HELD,
):  # fmt: skip
    """Add what a normal impulse dp and the friction with it do to the bodies of a contact to their changes dv (n, 5).

    `down`, `sink` and `hold` as in `cushion_step`; returns the speed at which the ball goes down after it.
    """
    radius = work[3, 0]
    cushion = j < 0
    ax, ay, bx, by = (ny, -nx, nx, ny) if cushion else (nx, ny, -ny, nx)
    s, out, after = work[0], work[1], work[2]
    for q in range(1 if cushion else 2):
        ball, o = (i if q == 0 else j), 5 * q
        s[o], s[o + 1] = b[ball, col.VX] * ax + b[ball, col.VY] * ay, b[ball, col.VX] * bx + b[ball, col.VY] * by
        s[o + 2], s[o + 3] = b[ball, col.WX] * ax + b[ball, col.WY] * ay, b[ball, col.WX] * bx + b[ball, col.WY] * by
        s[o + 4] = b[ball, col.WZ]
    if cushion:
        s[5] = down
    own = mass * heavier[i]
    other = own if cushion else mass * heavier[j]
    part = hold[0], hold[1] / SLIP_PARTS, hold[2] / SLIP_PARTS
    for x in range(10):
        out[x] = s[x]
    for _ in range(SLIP_PARTS):
        if cushion:
            cushion_step(out, dp / SLIP_PARTS, (mu[0], cloth, own, radius), after, mu[3], sink, part)
        else:
            ball_step(out, dp / SLIP_PARTS, (mu[0], mu[1], mu[2]), (cloth, own, other, radius), after)
        for x in range(10):
            out[x] = after[x]
    if cushion:
        out[1] += dp * (math.sqrt(1.0 - mu[3] * mu[3]) - level) / own
    for q in range(1 if cushion else 2):
        ball, o = (i if q == 0 else j), 5 * q
        va, vb, wa, wb = out[o] - s[o], out[o + 1] - s[o + 1], out[o + 2] - s[o + 2], out[o + 3] - s[o + 3]
        dv[ball, 0] += va * ax + vb * bx
        dv[ball, 1] += va * ay + vb * by
        dv[ball, 2] += wa * ax + wb * bx
        dv[ball, 3] += wa * ay + wb * by
        dv[ball, 4] += out[o + 4] - s[o + 4]
    return out[5] if cushion and sink > 0.0 else 0.0


@compiled_in_place
def _near(b, kind, first, second, radius, limits, half, mouths, jaws, near):  # type: ignore[no-untyped-def]
    """Fill `near` with the contacts within CONTACT_RANGE_M of closing, in order; returns how many there are."""
    n, found = b.shape[0], 0
    apart, pairs = 2.0 * radius + CONTACT_RANGE_M, n * (n - 1) // 2
    for c in range(first.size):
        i, j = first[c], second[c]
        if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
            continue
        if c < pairs:
            x, y = b[j, col.X] - b[i, col.X], b[j, col.Y] - b[i, col.Y]
            away = x * x + y * y > apart * apart
        else:
            away = _line_gap(b[i], -1 - j, jaws, limits) > CONTACT_RANGE_M  # a ball in a mouth may come sideways
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
def _note(log, who, logged, count, now, what, i, other):  # type: ignore[no-untyped-def]
    """Count an event of ball i, and log it where there is room; returns the number of the next."""
    count[what] += 1
    if logged < log.size:
        log[logged], who[logged, 0], who[logged, 1], who[logged, 2] = now, what, i, other
    return logged + 1


@compiled
def through(  # type: ignore[no-untyped-def]
    b, kind, stays, now, until, records, own, forces, support, impact, cloth, mass, radius, limits, half, mouths, jaws,
    session, hit, times, begin, out, log, who, logged, count,
):  # fmt: skip
    """Carry a shot through a cluster: returns when it has parted, the next sample's number and how much is logged.

    `stays` (n,): which balls no pocket takes. `records` (n, BALL_FIELDS) of the balls, `hit` (IMPACT_FIELDS,) for work.
    """
    n = b.shape[0]
    rails = 4 + jaws.shape[0]
    contacts = n * (n - 1) // 2 + rails * n
    bodies = np.empty(contacts, np.int64), np.empty(contacts, np.int64), np.empty(contacts, np.int64)
    springs = np.zeros(contacts), np.zeros((contacts, 4)), np.zeros(contacts), np.zeros(contacts), np.zeros(contacts)
    work = bodies, springs, np.zeros(contacts, np.bool_), np.ones(n), np.zeros((n, 5)), np.zeros((4, 10))
    return _through(
        work, b, kind, stays, now, until, records, own, forces, support, impact, cloth, mass, radius, limits, half,
        mouths, jaws, session, hit, times, begin, out, log, who, logged, count,
    )  # fmt: skip


@compiled_in_place
def _through(  # type: ignore[no-untyped-def]
    arrays, b, kind, stays, now, until, records, own, forces, support, impact, cloth, mass, radius, limits, half,
    mouths, jaws, session, hit, times, begin, out, log, who, logged, count,
):  # fmt: skip
    n = b.shape[0]
    (first, second, near), (gives_back, mu, peak, given, deepest), known, heavier, dv, work = arrays
    contacts = first.size
    at = 0
    for i in range(1, n):
        for j in range(i):
            first[at], second[at] = j, i
            at += 1
    for i in range(n):
        for rail in range(4 + jaws.shape[0]):
            first[at], second[at] = i, -1 - rail
            at += 1
    work[3, 0] = radius
    for c in range(contacts):
        i, j = first[c], second[c]
        if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
            continue
        gap, _, _, _ = _meets(b, i, j, radius, limits, half, mouths, jaws)
        if gap < 0.0:
            given[c] = depth_of(j < 0, gap, radius)[0]
    end, calm, room = now + MAX_CLUSTER_S, 0.0, CONTACT_RANGE_M
    looked = _near(b, kind, first, second, radius, limits, half, mouths, jaws, near)
    while True:
        for i in range(n):
            for x in range(5):
                dv[i, x] = 0.0
            if kind[i] != POTTED and (forces.shape[0] > 0 or not is_still(b[i])):
                _flow(b, i, records[i], records[i].ctypes.data, own, forces, support, cloth, now, dv)
        for c in near[:looked]:
            i, j = first[c], second[c]
            if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
                continue
            gap, approach, nx, ny = _meets(b, i, j, radius, limits, half, mouths, jaws)
            if gap > CONTACT_GAP_M:
                peak[c] = given[c] = deepest[c] = 0.0
                continue
            cushion = j < 0
            sudden = peak[c] == 0.0 and given[c] == 0.0
            if sudden and -gap > CROWD_GAP_M + 2.0 * SPRING_STEP_S * abs(approach):  # it came sideways
                given[c] = depth_of(cushion, gap, radius)[0]
                if cushion and gap < -MOUTH_DEPTH_M and jaws.shape[0] == 0 and not stays[i]:
                    pot(b, kind, i)
                    logged = _note(log, who, logged, count, now, POCKET, i, -1 - j)
                    continue
            if approach > max(peak[c], MIN_IMPACT_SPEED):
                peak[c] = approach
                other = -1 - j if cushion else j
                two = b[i if cushion else j]
                describe(hit, cushion, i, other, b[i], two, nx, ny, radius, session, now)
                ask(hit, hit.ctypes.data, own, impact)
                gives_back[c] = hit[rec.RESTITUTION]
                mu[c, 0], mu[c, 1], mu[c, 2] = hit[rec.FRICTION], hit[rec.GAIN], hit[rec.DECAY]
                mu[c, 3] = hit[rec.NOSE]
                heavier[i] = hit[rec.MASS_FIRST]
                if not cushion:
                    heavier[j] = hit[rec.MASS_SECOND]
                if not known[c]:
                    known[c] = True
                    what, other = (CUSHION, -1 - j) if cushion else (BALL, j)
                    logged = _note(log, who, logged, count, now, what, i, other)
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
            press(b, i, j, nx, ny, dp, mu[c], cloth[0], heavier, mass, level, dv, work)
        while begin < times.size and times[begin] <= min(now + SPRING_STEP_S, until):
            part = times[begin] - now
            for i in range(n):
                o = out[begin, i]
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
            begin += 1
        room = _go(b, dv, kind, room)
        if room <= 2.0 * CONTACT_GAP_M:
            looked, room = _near(b, kind, first, second, radius, limits, half, mouths, jaws, near), CONTACT_RANGE_M
        now += SPRING_STEP_S
        free, rests = True, True
        for c in near[:looked]:
            i, j = first[c], second[c]
            if kind[i] == POTTED or (j >= 0 and kind[j] == POTTED):
                continue
            gap, approach, _, _ = _meets(b, i, j, radius, limits, half, mouths, jaws)
            if gap > CONTACT_GAP_M:
                continue
            rests = rests and abs(approach) < DEAD_SPEED
            if approach > MIN_IMPACT_SPEED:
                free = False
                continue
            # A spring of little restitution is slower than what it has pushed: that leaves it before it has come back.
            depth = depth_of(j < 0, gap, radius)[0]
            free = free and depth - min(given[c], depth) <= CONTACT_GAP_M
        calm = calm + SPRING_STEP_S if rests else 0.0
        if free or calm >= CALM_TIME_S or now >= end or now >= until:
            return now, begin, logged
