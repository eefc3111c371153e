"""The table's forces on balls that `mj_step` moves: MuJoCo's passive forces, in one compiled callback.

Cloth and effects push and turn a ball as in the event engine (models/hooks.py). A step is no longer than the model's,
and shrinks towards a touch, each by at most half, down to SPRING_STEP_S, which springs are resolved in; the callback
says so in `opt.timestep`. As MuJoCo moves balls with the velocity at the end of a step, a step's push is that of the
time from the middle of the step before to its own middle (a leapfrog): positions are then right to second order, and
velocities are those half a step before.

An impact is MuJoCo's contact. The force of its spring (models/analytic/spring.py), for the restitution that the effects
ask for, is written into the contact's row before the solver takes it up; its friction, and that of the cloth under a
ball that it presses down, follow from that force by the increments of the impulse models, as generalised forces.
The slate is a plane that MuJoCo holds balls up with, but where it has holes.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from numba import carray

from models import record as rec
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine import touch
from models.engine.cluster import is_still
from models.engine.curve import lay_record
from models.engine.workspace import Forces, Index, ShotLaws
from models.hooks import Array
from models.mujoco import layout as at
from models.mujoco import memory as mem
from models.mujoco.coast import coast
from models.mujoco.contact import FREE_ACCELERATION, SolverRow, Step, meet, read_contact, set_row, slot
from models.mujoco.record import look_back, note
from models.mujoco.step import Contacts, WorldView, choose_step, is_idle, is_native
from models.shot import GRAVITY

SUPPORT_MARGIN_M: Final = 1e-7  # gap below which the slate carries a ball [m]
LIFTED_M: Final = 1e-6  # below its height on the slate: a ball that falls and comes back to this lies there again [m]
TAKEN_FROM_NOW: Final = 2.0  # value in the column SUNK of a ball that begins to fall with the next step
FALLING_SPEED: Final = 1e-5  # of a ball that has begun to fall, at least: gravity gives more in any step [m/s]
SUNK_M: Final = 3e-3  # below its height on the slate, from which a ball is the pocket's [m]
NET_TIME_S: Final = 0.03  # in which a net stops what falls into it [s]
SAME_TIME_S: Final = 1e-9  # by which the time may differ from where a step was to lead [s]


class Coordinates(NamedTuple):
    """MuJoCo's coordinates of a simulation."""

    qpos: Array
    qvel: Array
    passive: Array  # generalised forces
    joints: Index  # (n, 2) of each ball, where its position and its velocity begin


@compiled_in_place
def _turned(qpos, at, sign, a, b, c):  # type: ignore[no-untyped-def]
    """A vector (a, b, c) turned by the quaternion that begins at qpos[at], or back with a sign of -1."""
    w, x, y, z = qpos[at], sign * qpos[at + 1], sign * qpos[at + 2], sign * qpos[at + 3]
    tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * tx + y * tz - z * ty, b + w * ty + z * tx - x * tz, c + w * tz + x * ty - y * tx


@compiled_in_place
def _gather(coordinates, b):  # type: ignore[no-untyped-def]
    """The balls' states in the frame of the table, as the engine has them: b (n, COLUMN_COUNT)."""
    qpos, qvel, _, joints = coordinates
    for i in range(b.shape[0]):
        p, v = joints[i, 0], joints[i, 1]
        b[i, col.X], b[i, col.Y], b[i, col.VX], b[i, col.VY] = qpos[p], qpos[p + 1], qvel[v], qvel[v + 1]
        spin = _turned(qpos, p + 3, 1.0, qvel[v + 3], qvel[v + 4], qvel[v + 5])
        b[i, col.WX], b[i, col.WY], b[i, col.WZ] = spin


@compiled_in_place
def _deliver(coordinates, i, dv, h, mass, radius):  # type: ignore[no-untyped-def]
    """The changes dv (5,) of a ball within h as generalised forces."""
    qpos, _, passive, joints = coordinates
    p, v = joints[i, 0], joints[i, 1]
    passive[v] += mass * dv[0] / h
    passive[v + 1] += mass * dv[1] / h
    turn = 0.4 * mass * radius * radius / h
    tx, ty, tz = _turned(qpos, p + 3, -1.0, turn * dv[2], turn * dv[3], turn * dv[4])
    passive[v + 3] += tx
    passive[v + 4] += ty
    passive[v + 5] += tz


@compiled_in_place
def _has_no_slate(table, numbers, holes, x, y, z):  # type: ignore[no-untyped-def]
    """Whether a ball's centre has no slate below it, or is below where it holds one."""
    if z < numbers[mem.RADIUS] - SUNK_M:
        return True
    if (
        numbers[mem.CORNER_MOUTH] > 0.0
        and table[mem.JAW_COUNT] == 0
        and (abs(x) > numbers[mem.HALF_X] or abs(y) > numbers[mem.HALF_Y])
    ):
        return True  # without jaws, a pocket is all beyond the nose lines
    for k in range(table[mem.HOLE_COUNT]):
        dx, dy = x - holes[k, 0], y - holes[k, 1]
        if dx * dx + dy * dy < holes[k, 2] * holes[k, 2]:
            return True
    return False


@compiled_in_place
def _comes_from_a_mouth(table, numbers, ball, kept, kind, j, gap):  # type: ignore[no-untyped-def]
    """Whether a ball is suddenly deep in a rail: it comes sideways from a mouth, and the pocket takes it."""
    if kind != mem.NOSE or table[mem.JAW_COUNT] > 0 or numbers[mem.CORNER_MOUTH] == 0.0 or ball[mem.STAYS] > 0.0:
        return False
    return gap < -touch.MOUTH_DEPTH_M and kept[mem.PEAK] == 0.0 and kept[mem.GIVEN] == 0.0


@compiled_in_place
def _rub(b, load, friction, step, mass, radius, dv):  # type: ignore[no-untyped-def]
    """Let the cloth rub a ball that is pressed onto it by `load` [N] beyond its weight, against the slip below it."""
    sx, sy = b[col.VX] - radius * b[col.WY], b[col.VY] + radius * b[col.WX]
    slip = math.sqrt(sx * sx + sy * sy)
    if load <= 0.0 or slip == 0.0:
        return
    change = min(friction * load * step / mass, 2.0 / 7.0 * slip) / slip  # 2/7 of it stops the slip
    dv[0] -= change * sx
    dv[1] -= change * sy
    dv[2] -= 2.5 / radius * change * sy
    dv[3] += 2.5 / radius * change * sx


@compiled_in_place
def _hang(coordinates, i, mass, numbers):  # type: ignore[no-untyped-def]
    """Let a net stop a ball that has fallen into a pocket, and hold it."""
    qpos, qvel, passive, joints = coordinates
    p, v, radius = joints[i, 0], joints[i, 1], numbers[mem.RADIUS]
    pull = mass / NET_TIME_S
    if qpos[p + 2] < radius - SUNK_M:
        for k in range(2):
            passive[v + k] -= pull * qvel[v + k]
        for k in range(3, 6):
            passive[v + k] -= 0.4 * pull * radius * radius * qvel[v + k]
    rest = -numbers[mem.NET_DEPTH] - 4.0 * radius * i
    if qpos[p + 2] < rest:
        passive[v + 2] += pull * ((rest - qpos[p + 2]) / NET_TIME_S - 2.0 * qvel[v + 2]) + mass * GRAVITY


@compiled
def act(model, data, where, table_at):  # type: ignore[no-untyped-def]
    """Add what acts on the balls of one simulation to its passive forces, and choose its step.

    `model`, `data`: addresses of an mjModel and its mjData. `where`: address of the offsets of models/mujoco/layout.py.
    `table_at`: of the table of a world (models/mujoco/memory.py).
    """
    o, table = carray(mem.longs(where), at.OFFSETS), carray(mem.longs(table_at), mem.TABLE_SIZE)
    numbers = carray(mem.doubles(table[mem.NUMBERS]), mem.NUMBER_COUNT)
    n, radius = table[mem.BALLS], numbers[mem.RADIUS]
    qpos = carray(mem.doubles(mem.longs(data + o[at.DATA_QPOS])[0]), mem.ANY_SIZE)
    qvel = carray(mem.doubles(mem.longs(data + o[at.DATA_QVEL])[0]), mem.ANY_SIZE)
    passive = carray(mem.doubles(mem.longs(data + o[at.DATA_PASSIVE])[0]), mem.ANY_SIZE)
    memory_at = mem.longs(data + o[at.DATA_USERDATA])[0]
    head = carray(mem.doubles(memory_at), mem.HEAD_SIZE)
    now = mem.doubles(data + o[at.DATA_TIME])[0]
    joints = carray(mem.longs(table[mem.JOINTS]), (n, 2))
    row = int(head[mem.ROW])
    masses = carray(mem.doubles(table[mem.MASSES] + 8 * n * row), n)
    own = table[mem.OWN] + row * table[mem.OWN_BYTES]
    cloth = carray(mem.doubles(table[mem.CLOTH] + 24 * row), 3)
    forces = carray(mem.longs(table[mem.FORCES]), (table[mem.FORCE_COUNT], 2))
    horizon = carray(mem.longs(table[mem.HORIZON]), (table[mem.HORIZON_COUNT], 2))
    impact = carray(mem.longs(table[mem.IMPACT]), (table[mem.IMPACT_COUNT], 2))
    geoms = carray(mem.longs(table[mem.GEOMS]), (mem.ANY_SIZE, 2))
    felt = carray(mem.longs(table[mem.FELT]), n)
    holes = carray(mem.doubles(table[mem.HOLES]), (mem.ANY_SIZE, 3))
    contacts = n * (n - 1) // 2 + n * mem.RAIL_COUNT
    begin = memory_at + 8 * mem.HEAD_SIZE
    balls = carray(mem.doubles(begin), (n, mem.BALL_MEMORY))
    begin += 8 * n * mem.BALL_MEMORY
    past = carray(mem.doubles(begin), (n, col.ROW_SIZE))
    begin += 8 * n * col.ROW_SIZE
    kept = carray(mem.doubles(begin), (contacts, mem.CONTACT_MEMORY))
    begin += 8 * contacts * mem.CONTACT_MEMORY
    b = carray(mem.doubles(begin), (n, col.COLUMN_COUNT))
    begin += 8 * n * col.COLUMN_COUNT
    dv = carray(mem.doubles(begin), (n, 5))
    begin += 8 * n * 5
    slide_factors = carray(mem.doubles(begin), n)
    begin += 8 * n
    r = carray(mem.doubles(begin), rec.BALL_FIELDS)
    begin += 8 * rec.BALL_FIELDS
    hit = carray(mem.doubles(begin), rec.IMPACT_FIELDS)
    work = carray(mem.doubles(begin + 8 * rec.IMPACT_FIELDS), (3, 10))
    coordinates, view = Coordinates(qpos, qvel, passive, joints), WorldView(table, numbers, balls, kept, b)
    pushes = Forces(own, forces, table[mem.SUPPORT])
    # Every ball has a mass of its own here, and masses[0] is that of the struck one.
    laws = ShotLaws(pushes, horizon, impact, cloth, masses[0], head[mem.SESSION : mem.HEAD_SIZE], head[mem.LAUNCH])

    # A step has passed since the last look if the time is where that was to lead; otherwise it is the same look again.
    fresh = now != head[mem.STATE_TIME]
    passed = fresh and abs(now - head[mem.STATE_TIME] - head[mem.STEP]) <= SAME_TIME_S
    _gather(coordinates, b)
    if fresh:
        for i in range(n):
            if passed:
                balls[i, mem.ROLLED] += balls[i, mem.MORE_ROLLED]
                balls[i, mem.TURNED] += head[mem.STEP] * b[i, col.WZ]
    record_at = int(head[mem.RECORD])
    for i in range(n):
        p = joints[i, 0]
        falls = qpos[p + 2] < radius - LIFTED_M or qvel[joints[i, 1] + 2] < -FALLING_SPEED
        falling = balls[i, mem.SUNK] == TAKEN_FROM_NOW or (balls[i, mem.SUNK] > 0.0 and falls)
        sinks = falling or (
            balls[i, mem.STAYS] == 0.0
            and _has_no_slate(table, numbers, holes, qpos[p], qpos[p + 1], qpos[p + 2])
        )  # fmt: skip
        if sinks and balls[i, mem.SUNK] == 0.0 and record_at != 0 and fresh:
            note(record_at, n, now, touch.POCKET, i, 0, b[i])
        balls[i, mem.SUNK] = 1.0 if sinks else 0.0
        for k in range(5):
            dv[i, k] = 0.0
    if fresh:
        if record_at != 0:
            look_back(record_at, now, head[mem.STATE_TIME] if passed else now, head[mem.STEP_BEFORE], b, past, balls)
        head[mem.STEP_BEFORE] = head[mem.STEP] if passed else 0.0
        head[mem.STATE_TIME] = now

    ncon, contact_at = mem.ints(data + o[at.DATA_NCON])[0], mem.longs(data + o[at.DATA_CONTACT])[0]
    kbip = carray(mem.doubles(mem.longs(data + o[at.DATA_KBIP])[0]), (mem.ANY_SIZE, 4))
    weights = mem.doubles(mem.longs(data + o[at.DATA_D])[0])
    before = head[mem.STEP_BEFORE]
    longest = head[mem.LONGEST] if head[mem.LONGEST] > 0.0 else numbers[mem.BASE_STEP]
    step = choose_step(view, Contacts(contact_at, ncon, o, geoms), longest, before)
    head[mem.STEP] = step
    carray(mem.doubles(model + o[at.MODEL_TIMESTEP]), 1)[0] = step

    # Cloth and effects.
    since = now - head[mem.STRUCK_AT]
    for i in range(n):
        balls[i, mem.MORE_ROLLED] = 0.0
        slide_factors[i] = 1.0
        if balls[i, mem.SUNK] > 0.0:
            _hang(coordinates, i, masses[i], numbers)
            continue
        if forces.shape[0] == 0 and is_still(b[i]):
            continue
        lay_record(r, i, radius, laws)
        r[rec.X], r[rec.Y], r[rec.MASS] = b[i, col.X], b[i, col.Y], masses[i]
        r[rec.ROLLED] = balls[i, mem.ROLLED]
        flows, native = 0.5 * (before + step), table[mem.NATIVE_CLOTH] > 0
        r[rec.TIME] = since - 0.5 * before
        if native:
            flows, r[rec.TIME] = step, since
        if coast(r, b[i], laws, native, flows, dv[i]):
            balls[i, mem.MORE_ROLLED] = step * math.sqrt(b[i, col.VX] ** 2 + b[i, col.VY] ** 2) / radius
        slide_factors[i] = r[rec.SLIDE_FACTOR]
        if felt[i] >= 0 and not native:  # what the slate bore in the step before
            load = mem.doubles(mem.longs(data + o[at.DATA_SENSORDATA])[0] + 8 * felt[i])[0] - masses[i] * GRAVITY
            _rub(b[i], load, cloth[0], step, masses[i], radius, dv[i])

    # Impacts.
    now_step = Step(b, dv, masses, slide_factors, radius, since, step, fresh, hit, work)
    for c in range(ncon):
        place = contact_at + c * o[at.CONTACT_SIZE]
        meeting = read_contact(place, o, geoms)
        i, j, kind, _, _, _, gap = meeting
        if i < 0 or kind == mem.TOOL:
            continue
        line = mem.ints(place + o[at.CONTACT_ROW])[0]
        if kind == mem.SLATE:
            if balls[i, mem.SUNK] > 0.0 and line >= 0 and gap < SUPPORT_MARGIN_M:
                set_row(kbip, line, gap - SUPPORT_MARGIN_M, -FREE_ACCELERATION)
        elif is_idle(view, i, j, kind):
            if line >= 0 and gap < 0.0:
                set_row(kbip, line, gap, -FREE_ACCELERATION)
        elif before > 0.0 and _comes_from_a_mouth(table, numbers, balls[i], kept[slot(n, i, j, kind)], kind, j, gap):
            balls[i, mem.SUNK] = TAKEN_FROM_NOW  # from the next step on: this one's slate has carried it
            if fresh and record_at != 0:
                note(record_at, n, now, touch.POCKET, i, 0, b[i])
            if line >= 0:
                set_row(kbip, line, gap, -FREE_ACCELERATION)
        elif not is_native(table, kind):
            solver = SolverRow(kbip, weights[max(line, 0)], line)
            new = meet(kept[slot(n, i, j, kind)], meeting, laws, now_step, solver)
            if new and record_at != 0:
                note(record_at, n, now, touch.BALL if kind == mem.BALL else touch.CUSHION, i, j, b[i])
    for i in range(n):
        _deliver(coordinates, i, dv[i], step, masses[i], radius)
