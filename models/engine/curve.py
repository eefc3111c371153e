"""Where effects push a ball: its motion as polynomials in time, in steps as long as their error allows.

The steps are those of Dormand and Prince (models/engine/dense.py). A step ends where the ball changes: a slide or a
roll ends, sidespin dies, a push switches. Inside a step friction keeps the direction in which it began to be reversed:
a step that would pass through zero is cut. The last bit of a slide or of a roll is taken at a constant acceleration;
what a ball rolls with at the end of a slide, v - 2/7 u, does not depend on how the slip dies. A ball that is pushed by
hardly more or less than what resists it creeps at a constant acceleration, too.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models import record as rec
from models.analytic.cloth import (
    LAST_SLIP_MARGIN,
    LAST_SLIP_S,
    RESTING,
    ROLLING,
    SLIDING,
    STILL_SPEED,
    STILL_SPIN,
    ClothPhase,
    add_cloth,
    rolling_resistance,
)
from models.compiled import compiled_in_place
from models.effect import STILL
from models.engine import columns as col
from models.engine.dense import (
    SAFETY_FACTOR,
    STAGE_NODES,
    STAGE_WEIGHTS,
    STEP_TOLERANCE_M,
    error_weights,
    first_share,
    smooth,
    step_error,
    straight_on,
)
from models.engine.motion import CURVE, GOES_ON, REST, SLIDE_ENDS, STOPS
from models.hooks import call_hook, call_horizon
from models.shot import GRAVITY, SESSION_FIELDS

SHORT_SLIDE_S = 1e-3  # rest of a slide that is computed with constant friction [s]
SHORT_SOFT_SLIDE_S = 1e-4  # the same where friction is not the full one [s]
SHORT_ROLL_S = 0.03  # rest of a roll that is computed as a straight line [s]
LAST_TURN = 0.5  # largest turn in one step of a roll that is turned more than slowed [rad]
END_SHARE = 0.995  # largest part of the rest of a roll or a slide in one step
END_SHARE_SOFT = 0.9  # the same for a slide whose friction is not the full one
MAX_STEP_RATIO = 9.0  # ratio of a step to the rest of a motion above which errors no longer grow with it
MAX_REMAINING_S = 1e3  # longest rest of a motion [s]
LAST_STAGE_LEAD_S = 1e-9  # time from the last stage of a step to its end, where a push may switch [s]
CREEP_SPEED = 3e-3  # largest speed of a creeping ball: within SHORT_ROLL_S its forces do not change [m/s]
CREEP_SHARE = 0.1  # largest difference between push and rolling resistance of a creeping ball, over the resistance
NO_RESISTANCE = 1e-6  # rolling resistance below which there is none [m/s^2]
MAX_GROWTH, MIN_GROWTH = 5.0, 0.2  # of a step
MAX_STEP_S = 2.0  # longest step [s]
MIN_STEP_S = 1e-7  # step that is accepted whatever its error [s]


class Room(NamedTuple):
    """How far a step may go [s]."""

    step: float  # its length, at most
    left: float  # of the slide or the roll
    until: float  # of the shot: errors count no longer


@compiled_in_place
def push(r, forces):  # type: ignore[no-untyped-def]
    """Ask the effects (`Forces`) what acts on the ball in record r beside the cloth."""
    r[rec.AX] = r[rec.AY] = r[rec.BX] = r[rec.BY] = r[rec.BZ] = r[rec.DRAG] = r[rec.ACROSS] = 0.0
    r[rec.SLIDE_FACTOR] = r[rec.ROLL_FACTOR] = r[rec.SPIN_FACTOR] = r[rec.WEIGHT] = 1.0
    for k in range(forces.hooks.shape[0]):
        if k == forces.support and r[rec.WEIGHT] <= 0.0:
            r[rec.ROLLING] = 0.0
        call_hook(forces.hooks[k, 0], forces.own + 8 * forces.hooks[k, 1], r.ctypes.data)


@compiled_in_place
def _rates(y, t, way, r, forces, cloth, rate):  # type: ignore[no-untyped-def]
    """Derivatives `rate` of the state y, both (STATE_SIZE,), of a ball; False where friction would have to turn round.

    `way`: its `ClothPhase` at the beginning of the step.
    """
    mode = way.mode
    radius, fine = r[rec.RADIUS], True
    ux = uy = u = vx = vy = speed = 0.0
    r[rec.X], r[rec.Y], r[rec.VX], r[rec.VY], r[rec.WZ] = y[col.X], y[col.Y], y[col.VX], y[col.VY], y[col.WZ]
    r[rec.TIME], r[rec.ROLLED], r[rec.ROLLING] = t, y[col.ROLLED], 0.0
    if mode == ROLLING:
        r[rec.ROLLING] = 1.0
        r[rec.WX], r[rec.WY] = -y[col.VY] / radius, y[col.VX] / radius
        speed = math.sqrt(y[col.VX] * y[col.VX] + y[col.VY] * y[col.VY])
        if y[col.VX] * way.x + y[col.VY] * way.y <= 0.0:
            fine, vx, vy = False, way.x, way.y
        else:
            vx, vy = y[col.VX] / speed, y[col.VY] / speed
    else:
        r[rec.WX], r[rec.WY] = y[col.WX], y[col.WY]
        ux, uy = y[col.VX] - radius * y[col.WY], y[col.VY] + radius * y[col.WX]
    r[rec.SLIP_X], r[rec.SLIP_Y] = ux, uy
    push(r, forces)
    if mode == SLIDING:
        u = math.sqrt(ux * ux + uy * uy)
        if r[rec.WEIGHT] > 0.0 and ux * way.slip_x + uy * way.slip_y <= 0.0:
            fine, ux, uy, u = False, way.slip_x, way.slip_y, 1.0
        else:
            over = 1.0 / u if u > 0.0 else 0.0
            ux, uy = ux * over, uy * over
    add_cloth(r, ClothPhase(mode, u, ux, uy, speed, vx, vy, way.spin), cloth)
    rate[col.X], rate[col.Y] = y[col.VX], y[col.VY]
    rate[col.VX], rate[col.VY] = r[rec.AX], r[rec.AY]
    rate[col.WX], rate[col.WY], rate[col.WZ] = r[rec.BX], r[rec.BY], r[rec.BZ]
    if mode == RESTING:  # until it is next asked whether it sets off
        rate[col.X] = rate[col.Y] = rate[col.VX] = rate[col.VY] = rate[col.WX] = rate[col.WY] = 0.0
    rate[col.TURN] = y[col.WZ]
    rate[col.ROLLED] = speed / radius
    return fine


@compiled_in_place
def _sets_off(r, forces, roll):  # type: ignore[no-untyped-def]
    """Whether a ball at rest rolls off and goes on to roll, and the unit vector along which it is pushed.

    What acts on it may depend on where it goes: a grain resists more one way, and a pull across the way turns it
    until the force along the way is sqrt(force^2 - pull^2), or on the spot where the pull is the stronger.
    """
    radius = r[rec.RADIUS]
    r[rec.VX] = r[rec.VY] = r[rec.WX] = r[rec.WY] = r[rec.SLIP_X] = r[rec.SLIP_Y] = r[rec.ROLLING] = 0.0
    push(r, forces)
    px, py = 5.0 * r[rec.AX] + 2.0 * radius * r[rec.BY], 5.0 * r[rec.AY] - 2.0 * radius * r[rec.BX]
    force = math.sqrt(px * px + py * py)
    if force / 7.0 <= roll * r[rec.ROLL_FACTOR] * r[rec.WEIGHT] * GRAVITY:
        return False, 0.0, 0.0
    nx, ny = px / force, py / force
    r[rec.VX], r[rec.VY] = 2.0 * STILL * nx, 2.0 * STILL * ny
    r[rec.WX], r[rec.WY], r[rec.ROLLING] = -r[rec.VY] / radius, r[rec.VX] / radius, 1.0
    push(r, forces)
    px, py = 5.0 * r[rec.AX] + 2.0 * radius * r[rec.BY], 5.0 * r[rec.AY] - 2.0 * radius * r[rec.BX]
    pull, resistance = nx * py - ny * px, 7.0 * roll * r[rec.ROLL_FACTOR] * r[rec.WEIGHT] * GRAVITY
    return force * force > resistance * resistance + pull * pull, nx, ny


@compiled_in_place
def see(b, r, now):  # type: ignore[no-untyped-def]
    """Put what effects see of a ball in row b, as it slides, into its record r."""
    radius = r[rec.RADIUS]
    r[rec.X], r[rec.Y], r[rec.VX], r[rec.VY] = b[col.X], b[col.Y], b[col.VX], b[col.VY]
    r[rec.WX], r[rec.WY], r[rec.WZ], r[rec.ROLLED] = b[col.WX], b[col.WY], b[col.WZ], b[col.ROLLED]
    r[rec.SLIP_X], r[rec.SLIP_Y] = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    r[rec.TIME], r[rec.ROLLING] = now, 0.0


@compiled_in_place
def slide_factor_in_impact(b, r, lost, forces, now):  # type: ignore[no-untyped-def]
    """Factor on the cloth's sliding friction under a ball in row b while it is in an impact.

    Its slip is that of the greatest compression, by when the impact has taken `lost` (x, y) [m/s] of its velocity.
    """
    see(b, r, now)
    r[rec.SLIP_X], r[rec.SLIP_Y] = r[rec.SLIP_X] - lost[0], r[rec.SLIP_Y] - lost[1]
    push(r, forces)
    return r[rec.SLIDE_FACTOR]


@compiled_in_place
def _begin(b, r, forces, cloth):  # type: ignore[no-untyped-def]
    """Whether a ball slides, rolls or rests from its clock on, and the velocity and spin that it does so with."""
    radius = r[rec.RADIUS]
    # What the ball does is decided with what the cloth carries of it.
    see(b, r, b[col.CLOCK])
    ux, uy = r[rec.SLIP_X], r[rec.SLIP_Y]
    u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY])
    mode = SLIDING if u > STILL_SPEED else (ROLLING if v > STILL_SPEED else RESTING)
    r[rec.ROLLING] = 1.0 if mode == ROLLING else 0.0
    push(r, forces)
    if r[rec.WEIGHT] <= 0.0:
        mode = SLIDING  # in flight
    elif mode != SLIDING:
        px, py = r[rec.AX] - radius * r[rec.BY], r[rec.AY] + radius * r[rec.BX]  # what would make it slip
        need = math.sqrt(px * px + py * py)
        if 2 / 7 * need > cloth[0] * r[rec.WEIGHT] * GRAVITY * (1.0 + 1e-9):
            b[col.VX] += 2.0 * STILL_SPEED * px / need
            b[col.VY] += 2.0 * STILL_SPEED * py / need
            mode = SLIDING
    if mode == RESTING or (mode == ROLLING and v <= STILL):
        sets_off, nx, ny = _sets_off(r, forces, cloth[1])
        if not sets_off:
            mode, b[col.VX], b[col.VY] = RESTING, 0.0, 0.0
        else:  # whichever way it has come, it goes where it is pushed
            v = max(v, 2.0 * STILL_SPEED)
            mode, b[col.VX], b[col.VY] = ROLLING, v * nx, v * ny
    if mode != SLIDING:
        b[col.WX], b[col.WY] = -b[col.VY] / radius, b[col.VX] / radius
    return mode


@compiled_in_place
def curve(b, m, r, laws, until, work):  # type: ignore[no-untyped-def]
    """Lay a curve from a ball's clock on: fills b and its polynomials m; returns CURVE, or REST where nothing changes.

    Errors count up to the time `until`; no step is longer than MAX_STEP_S, unless it is the last of a slide or a roll.
    r (BALL_FIELDS,) holds what stays constant; `laws`: `ShotLaws`; `work`: `CurveWork`.
    """
    radius, now, forces, cloth, (y, k) = r[rec.RADIUS], b[col.CLOCK], laws.forces, laws.cloth, work
    mode = _begin(b, r, forces, cloth)
    ux, uy = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY])
    over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / v if v > 0.0 else 0.0
    way = ClothPhase(mode, u, ux * over, uy * over, v, b[col.VX] * per, b[col.VY] * per, b[col.WZ])
    for x in range(col.STATE_SIZE):
        y[x] = b[x]
    _rates(y, now, way, r, forces, cloth, k[0])
    creeps = mode == ROLLING and _creep(b, way, r, cloth, k)
    if creeps:
        way = ClothPhase(mode, u, 0.0, 0.0, v, b[col.VX] * per, b[col.VY] * per, b[col.WZ])
    b[col.AX], b[col.AY], b[col.MODE], b[col.LAST] = k[0, col.VX], k[0, col.VY], mode, GOES_ON
    h, left, straight = _room(b, way, r, laws, k)
    if mode == RESTING and b[col.WZ] == 0.0:
        b[col.AX] = b[col.AY] = b[col.BOUND] = 0.0
        b[col.END] = now + h if h < MAX_STEP_S else np.inf
        return REST
    if straight or creeps:
        h = h if straight else min(h, MAX_STEP_S, SHORT_ROLL_S)
        straight_on(b, m, h, k)
    else:
        h = _step(b, m, way, Room(min(h, MAX_STEP_S), left, until - now), r, laws, work)
    b[col.BEGIN], b[col.SPAN], b[col.END] = now, h, now + h
    most_x = most_y = 0.0
    for n in range(1, 5):
        most_x, most_y = most_x + n * abs(m[col.VX, n]), most_y + n * abs(m[col.VY, n])
    b[col.BOUND] = math.sqrt(most_x * most_x + most_y * most_y) / h
    return CURVE


@compiled_in_place
def _creep(b, way, r, cloth, k):  # type: ignore[no-untyped-def]
    """Whether a ball creeps: then it is turned to where it is pushed, and k[0] with it, at the speed v that it has.

    Its direction follows the push within v / resistance [s], sideways by less than STEP_TOLERANCE_M: steps would have
    to be as short, and be off by more than what drives or stops it.
    """
    against, v = rolling_resistance(r, cloth[1]), way.speed
    if v > CREEP_SPEED or against <= 0.0:
        return False
    px, py = k[0, col.VX] + against * way.x, k[0, col.VY] + against * way.y
    force, along, across = math.sqrt(px * px + py * py), way.x * px + way.y * py, abs(way.x * py - way.y * px)
    if abs(force - against) > CREEP_SHARE * against or along <= 0.0:
        return False
    if across > CREEP_SHARE * against or v * v * across > STEP_TOLERANCE_M * against * against:
        return False
    nx, ny = px / force, py / force
    b[col.VX], b[col.VY] = v * nx, v * ny
    b[col.WX], b[col.WY] = -b[col.VY] / r[rec.RADIUS], b[col.VX] / r[rec.RADIUS]
    k[0, col.X], k[0, col.Y] = b[col.VX], b[col.VY]
    k[0, col.VX], k[0, col.VY] = (force - against) * nx, (force - against) * ny
    return True


@compiled_in_place
def _room(b, way, r, laws, k):  # type: ignore[no-untyped-def]
    """How far a step may go: to the next switch, and to where the ball changes; what is left of its slide or roll [s].

    The third says whether it comes to that end, at its first acceleration; b[LAST] says what happens there.
    """
    radius, h, left, horizon = r[rec.RADIUS], MAX_STEP_S, MAX_REMAINING_S, laws.horizon
    mode, u, v = way.mode, way.slip, way.speed
    for n in range(horizon.shape[0]):
        free = call_horizon(horizon[n, 0], laws.forces.own + 8 * horizon[n, 1], r.ctypes.data)
        if free == free:
            h = min(h, max(free, MIN_STEP_S))
    if b[col.WZ] * k[0, col.WZ] < 0.0:
        h = min(h, -b[col.WZ] / k[0, col.WZ])
    short, spare, last = SHORT_ROLL_S, END_SHARE, STOPS
    if mode == SLIDING and r[rec.WEIGHT] > 0.0:
        slip_rate_x, slip_rate_y = k[0, col.VX] - radius * k[0, col.WY], k[0, col.VY] + radius * k[0, col.WX]
        rate = -(way.slip_x * slip_rate_x + way.slip_y * slip_rate_y)
        full = 3.5 * laws.cloth[0] * r[rec.WEIGHT] * GRAVITY * LAST_SLIP_S
        short, last = SHORT_SLIDE_S, SLIDE_ENDS
        if r[rec.SLIDE_FACTOR] != 1.0:
            short = SHORT_SOFT_SLIDE_S
            if u > full * (1.0 + LAST_SLIP_MARGIN):
                u, spare, last = u - full, END_SHARE_SOFT, GOES_ON
        if rate > 0.0:
            left = min(u / rate, MAX_REMAINING_S)
    elif mode == ROLLING:
        rate = -(way.x * k[0, col.VX] + way.y * k[0, col.VY])
        if rate > 0.0:
            left = min(v / rate, MAX_REMAINING_S)
        across = abs(way.x * k[0, col.VY] - way.y * k[0, col.VX])
        if across > rate:  # it is turned more than slowed: the end is not straight
            short, h = 0.0, min(h, max(LAST_TURN * v / across, MIN_STEP_S))
    if left > short:
        return min(h, spare * left), left, False
    if left <= h:
        b[col.LAST] = last
        return left, left, True
    return h, left, False


@compiled_in_place
def _stages(b, way, h, r, laws, work):  # type: ignore[no-untyped-def]
    """The stages of a step h: fills the state y at its end and the rates k; False where friction would turn round."""
    y, k = work
    for stage in range(6):
        for x in range(col.STATE_SIZE):
            total = 0.0
            for n in range(stage + 1):
                total += STAGE_WEIGHTS[stage, n] * k[n, x]
            y[x] = b[x] + h * total
        t = b[col.CLOCK] + min(STAGE_NODES[stage] * h, max(h - LAST_STAGE_LEAD_S, 0.0))
        if not _rates(y, t, way, r, laws.forces, laws.cloth, k[stage + 1]):
            return False
    return True


@compiled_in_place
def _step(b, m, way, room, r, laws, work):  # type: ignore[no-untyped-def]
    """A step within its `Room` whose error is small, from k[0] on: fills the polynomials m, returns its length.

    A push across the way turns a motion the faster the less of it is left: at a step h of what is `left` the error
    grows as the fourth power of h / (left - h), at first. That is what is asked of a step, and remembered in b[TRY].
    """
    (h, left, until), mode, cloth, (y, k) = room, way.mode, laws.cloth, work
    radius, v = r[rec.RADIUS], math.sqrt(b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY])
    weights = error_weights(b, radius, cloth[1], until, k)
    resistance = rolling_resistance(r, cloth[1]) if mode == ROLLING else 0.0
    share = b[col.TRY]
    if share == 0.0 and left < MAX_REMAINING_S:
        share = first_share(way, left, radius, weights, k)
    if share > 0.0:
        h = min(h, left * share / (1.0 + share))
    while True:
        if not _stages(b, way, h, r, laws, work):
            if h <= MIN_STEP_S:  # nothing is left of the motion
                straight_on(b, m, h, k)
                return h
            h = max(0.5 * h, MIN_STEP_S)
            continue
        error = step_error(h, way, max(v, math.sqrt(y[col.VX] * y[col.VX] + y[col.VY] * y[col.VY])), radius, weights, k)
        # Sidespin or rolling resistance that would pass through zero ends the step there.
        part = 1.0
        if b[col.WZ] != 0.0 and way.spin * y[col.WZ] < 0.0 and abs(y[col.WZ]) > STILL_SPIN:
            part = b[col.WZ] / (b[col.WZ] - y[col.WZ])
        if abs(resistance) > NO_RESISTANCE:
            after = rolling_resistance(r, cloth[1])
            if resistance * after < 0.0 and abs(after) > NO_RESISTANCE:
                part = min(part, resistance / (resistance - after))
        crossed = part < 1.0
        share = h / (left - h) if h < left else MAX_STEP_RATIO
        if (error <= STEP_TOLERANCE_M and not crossed) or h <= MIN_STEP_S:
            grow = SAFETY_FACTOR * (STEP_TOLERANCE_M / error) ** 0.2 if error > 0.0 else MAX_GROWTH
            b[col.TRY] = share * grow if grow < MAX_GROWTH else 0.0
            break
        if crossed and error <= STEP_TOLERANCE_M:
            h = max(h * part, MIN_STEP_S)
        else:
            share = min(share, MAX_STEP_RATIO) * max(MIN_GROWTH, SAFETY_FACTOR * (STEP_TOLERANCE_M / error) ** (1 / 3))
            h = max(left * share / (1.0 + share), MIN_STEP_S)
    smooth(b, m, h, k)
    return h


@compiled_in_place
def lay_record(r, number, radius, laws):  # type: ignore[no-untyped-def]
    """What of a ball's record does not change along its way."""
    r[rec.NUMBER], r[rec.LAUNCH], r[rec.RADIUS], r[rec.MASS] = number, laws.launch, radius, laws.mass
    for k in range(SESSION_FIELDS):
        r[rec.SESSION + k] = laws.session[k]
