"""The change of one ball by cloth and effects in a step, in which it may cease to slide, to roll or to spin."""

from __future__ import annotations

import math
from typing import Final

from models import record as rec
from models.analytic.cloth import RESTING, ROLLING, SLIDING, STILL_SPEED, STILL_SPIN, ClothPhase, add_cloth
from models.compiled import compiled_in_place
from models.effect import STILL as NATIVE_SLIP
from models.engine import columns as col
from models.engine.curve import push
from models.hooks import call_horizon

NATIVE_CLOTH: Final = -1  # motion of a ball on MuJoCo's own cloth, which needs nothing else
MAX_PHASES: Final = 6  # of a step: the ends of a slide, of a roll, of sidespin, and where a push switches


@compiled_in_place
def _look(r, forces, cloth, mode, velocity, spin):  # type: ignore[no-untyped-def]
    """Let cloth and effects act on a ball of this velocity (2) and spin (3): the record's AX to BZ."""
    (vx, vy), (wx, wy, wz) = velocity, spin
    ux, uy = vx - r[rec.RADIUS] * wy, vy + r[rec.RADIUS] * wx
    u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
    r[rec.VX], r[rec.VY], r[rec.WX], r[rec.WY], r[rec.WZ] = vx, vy, wx, wy, wz
    r[rec.SLIP_X], r[rec.SLIP_Y], r[rec.ROLLING] = ux, uy, (1.0 if mode == ROLLING else 0.0)
    push(r, forces)
    if mode == NATIVE_CLOTH:
        return
    over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / v if v > 0.0 else 0.0
    add_cloth(r, ClothPhase(mode, u, ux * over, uy * over, v, vx * per, vy * per, wz), cloth)


@compiled_in_place
def _until_switch(r, forces, horizon, left):  # type: ignore[no-untyped-def]
    """Time until what acts on a ball switches, at most what is left of the step [s]."""
    span = left
    for k in range(horizon.shape[0]):
        until = call_horizon(horizon[k, 0], forces.own + 8 * horizon[k, 1], r.ctypes.data)
        if 0.0 < until < span:
            span = until
    return span


@compiled_in_place
def coast(r, b, laws, native, h, dv):  # type: ignore[no-untyped-def]
    """What cloth and effects change of one ball's velocity and spin within h, into dv (5,); returns whether it rolls.

    r (BALL_FIELDS,) is its record, b its row, `laws` are `ShotLaws`. `native`: whether the cloth is MuJoCo's own
    contact. Where effects push, they are looked at in the middle again.
    """
    forces, horizon, cloth = laws.forces, laws.horizon, laws.cloth
    radius, looks = r[rec.RADIUS], 2 if forces.hooks.shape[0] > 0 else 1
    vx, vy, wx, wy, wz = b[col.VX], b[col.VY], b[col.WX], b[col.WY], b[col.WZ]
    rolls, left = False, h
    for _ in range(MAX_PHASES):
        ux, uy = vx - radius * wy, vy + radius * wx
        u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
        mode = SLIDING if u > STILL_SPEED else (ROLLING if v > STILL_SPEED else RESTING)
        if native:
            rolls = rolls or (u <= NATIVE_SLIP < v)
            mode = NATIVE_CLOTH
        rolls = rolls or mode == ROLLING
        ax = ay = bx = by = bz = 0.0
        span, slides, stops, spins = 0.0, False, False, False
        for _ in range(looks):
            f = 0.5 * span  # at the beginning, then in the middle
            _look(r, forces, cloth, mode, (vx + f * ax, vy + f * ay), (wx + f * bx, wy + f * by, wz + f * bz))
            ax, ay, bx, by, bz = r[rec.AX], r[rec.AY], r[rec.BX], r[rec.BY], r[rec.BZ]
            span, slides, stops, spins = _until_switch(r, forces, horizon, left), False, False, False
            if mode == SLIDING:
                closing = -(ux * (ax - radius * by) + uy * (ay + radius * bx))
                if closing > 0.0 and u * u <= closing * span:
                    span, slides = u * u / closing, True
            elif mode == ROLLING:
                closing = -(vx * ax + vy * ay)
                if closing > 0.0 and v * v <= closing * span:
                    span, stops = v * v / closing, True
            elif mode == RESTING and ax == 0.0 and ay == 0.0:
                stops = True  # what is left of a motion is none
            if mode != NATIVE_CLOTH:
                if abs(wz) > STILL_SPIN and wz * bz < 0.0 and abs(wz) <= abs(bz) * span:
                    span, slides, stops, spins = abs(wz / bz), False, stops and mode == RESTING, True
                elif abs(wz) <= STILL_SPIN and bz == 0.0:
                    spins = True
        vx, vy, wx, wy, wz = vx + span * ax, vy + span * ay, wx + span * bx, wy + span * by, wz + span * bz
        if slides:
            wx, wy = -vy / radius, vx / radius
        if stops:
            vx = vy = wx = wy = 0.0
        if spins:
            wz = 0.0
        left -= span
        r[rec.TIME] += span
        if left <= 0.0:
            break
    dv[0] += vx - b[col.VX]
    dv[1] += vy - b[col.VY]
    dv[2] += wx - b[col.WX]
    dv[3] += wy - b[col.WY]
    dv[4] += wz - b[col.WZ]
    return rolls
