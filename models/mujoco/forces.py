"""What a table does to balls that `mj_step` moves: the passive forces of MuJoCo's state, in one compiled callback.

Cloth and effects push and turn a ball as in the event engine (models/hooks.py). A step is no longer than the model's,
and shrinks towards a touch, each by at most half, down to STEP_S, in which springs are resolved; the callback says so
in `opt.timestep`. As MuJoCo moves balls with the velocity at the end of a step, a step's push is that of the time from
the middle of the step before to its own middle (a leapfrog): positions are then right to second order, and velocities
are those half a step before.

An impact is MuJoCo's contact. Its spring and damper are those of models/analytic/spring.py for the restitution that the
effects ask for, which are written into the contact's row before the solver takes it up; its friction, and that of the
cloth under a ball that it presses down, follow from its force by the increments of the impulse models, as generalised
forces. The slate is a plane that MuJoCo holds balls up with, but where it has holes.
"""

from __future__ import annotations

import math
from typing import Final

from numba import carray, types
from numba.extending import intrinsic

from models import record as rec
from models.analytic.cloth import RESTING, ROLLING, SLIDING, STILL_SPEED, STILL_SPIN, add_cloth
from models.analytic.compliant import MIN_COMPLIANCE, dragged
from models.analytic.events import DEAD_SPEED, MIN_IMPACT_SPEED
from models.analytic.increments import NOT_HELD
from models.analytic.spring import CONTACT_GAP_M, CUSHION_TIME, NOSE_RADIUS, SPRING_STEP_S, damping_of, depth_of, spring
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, press
from models.engine.curve import push
from models.engine.impacts import ask, describe
from models.hooks import call_horizon
from models.mujoco import layout as at
from models.shot import NOSE_COSINE, NOSE_SINE, SESSION_FIELDS

STEP_S: Final = SPRING_STEP_S  # in an impact [s]
TOOL_STEP_S: Final = 1e-5  # while something else touches a ball [s]
TOOL_SPEED: Final = 5.0  # at which that may come, at most [m/s]
CALM_STEP_S: Final = 2e-5  # while balls only lean on each other or on a cushion [s]
NEAR_M: Final = 0.02  # gap up to which MuJoCo reports what may meet: faster than any ball in a step [m]
MAX_PHASES: Final = 6  # of a step: the ends of a slide, of a roll, of sidespin
MIN_GIVEN_BACK: Final = 0.1  # restitution below which a damper takes the work, not a spring that unloads more stiffly
LIFTED_M: Final = 1e-6  # below its height on the slate, to which a ball that falls must come back to lie there again [m]
SUNK_M: Final = 3e-3  # below its height on the slate, from which a ball is the pocket's [m]
NET_TIME_S: Final = 0.03  # in which a net stops what falls into it [s]
FREE_ACCELERATION: Final = 1e9  # of a contact that does not act: the solver leaves it alone [m/s^2]

# What a table of numbers (int64) says of a world: how many, and where arrays stand.
(
    BALLS, OWN, OWN_BYTES, CLOTH, FORCES, FORCE_COUNT, SUPPORT, HORIZON, HORIZON_COUNT, IMPACT, IMPACT_COUNT,
    DAMPING, DAMPING_COUNT, GEOMS, GEOM_COUNT, HOLES, HOLE_COUNT, JOINTS, MASSES, NUMBERS, RAILS, TABLE_SIZE,
) = range(22)  # fmt: skip
RADIUS, BASE_STEP, HALF_X, HALF_Y, NET_DEPTH, NUMBER_COUNT = range(6)  # floats: metres and seconds
# What a geom is: the number of its ball, or for what balls meet -1 - kind; then the rail or jaw.
BALL, SLATE, NOSE, POST, TOOL = -1, 0, 1, 2, 3  # a post is an upright cylinder

# What a simulation remembers, in `userdata`.
ROW, STATE_TIME, STEP, STEP_BEFORE, STRUCK_AT, LAUNCH, SESSION = range(7)
HEAD: Final = SESSION + SESSION_FIELDS
ROLLED, MORE_ROLLED, SUNK, BALL_MEMORY = range(4)
(
    PEAK, GIVEN, DEEPEST, GIVES_BACK, DAMP, STIFFNESS, SINK, DOWN, LOWERED, SOFT, STRETCH_ALONG, STRETCH_UP, MU, GAIN, DECAY,
    SINE, CONTACT_MEMORY,
) = range(17)  # fmt: skip
WORK: Final = 4 * 10
ALL: Final = 1 << 30  # size of an array whose own is not asked for


@intrinsic
def _pointer(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to floats."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.float64)(types.int64), codegen


@intrinsic
def _long_pointer(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to integers of 8 bytes."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.int64)(types.int64), codegen


@intrinsic
def _int_pointer(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to integers of 4 bytes."""

    def codegen(context, builder, signature, args):  # type: ignore[no-untyped-def]
        return builder.inttoptr(args[0], context.get_value_type(signature.return_type))

    return types.CPointer(types.int32)(types.int64), codegen


def contact_count(balls: int, rails: int) -> int:
    """How many contacts are remembered: of each two balls, and of each ball with each rail and jaw."""
    return balls * (balls - 1) // 2 + balls * rails


def memory_size(balls: int, rails: int) -> int:
    """How many numbers a simulation remembers, with room for work."""
    work = balls * (col.COLUMN_COUNT + 5) + rec.BALL_FIELDS + rec.IMPACT_FIELDS + WORK
    return HEAD + balls * BALL_MEMORY + contact_count(balls, rails) * CONTACT_MEMORY + work


@compiled_in_place
def _coast(r, where, b, own, forces, support, horizon, cloth, h, dv):  # type: ignore[no-untyped-def]
    """What cloth and effects change of one ball's velocity and spin within h, into dv (5,); returns whether it rolls."""
    radius = r[rec.RADIUS]
    vx, vy, wx, wy, wz = b[col.VX], b[col.VY], b[col.WX], b[col.WY], b[col.WZ]
    rolls, left = False, h
    for phase in range(MAX_PHASES):
        ux, uy = vx - radius * wy, vy + radius * wx
        u, v = math.sqrt(ux * ux + uy * uy), math.sqrt(vx * vx + vy * vy)
        mode = SLIDING if u > STILL_SPEED else (ROLLING if v > STILL_SPEED else RESTING)
        r[rec.VX], r[rec.VY], r[rec.WX], r[rec.WY], r[rec.WZ] = vx, vy, wx, wy, wz
        r[rec.SLIP_X], r[rec.SLIP_Y], r[rec.ROLLING] = ux, uy, (1.0 if mode == ROLLING else 0.0)
        push(r, where, own, forces, support)
        rolls = rolls or mode == ROLLING
        over, per = 1.0 / u if u > 0.0 else 0.0, 1.0 / v if v > 0.0 else 0.0
        add_cloth(r, mode, u, ux * over, uy * over, vx * per, vy * per, wz, cloth[0], cloth[1], cloth[2])
        ax, ay, bx, by, bz = r[rec.AX], r[rec.AY], r[rec.BX], r[rec.BY], r[rec.BZ]
        span, slides, stops, spins = left, False, False, False
        if mode == SLIDING:
            closing = -(ux * (ax - radius * by) + uy * (ay + radius * bx))
            if closing > 0.0 and u * u <= closing * span:
                span, slides = u * u / closing, True
        elif mode == ROLLING:
            closing = -(vx * ax + vy * ay)
            if closing > 0.0 and v * v <= closing * span:
                span, stops = v * v / closing, True
        elif ax == 0.0 and ay == 0.0:
            stops = True  # what is left of a motion is none
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
        if left <= 0.0 or phase == MAX_PHASES - 1:
            break
    dv[0] += vx - b[col.VX]
    dv[1] += vy - b[col.VY]
    dv[2] += wx - b[col.WX]
    dv[3] += wy - b[col.WY]
    dv[4] += wz - b[col.WZ]
    return rolls


@compiled_in_place
def _gather(qpos, qvel, joints, b, n):  # type: ignore[no-untyped-def]
    """The balls' states in the frame of the table, as the engine has them: b (n, COLUMN_COUNT)."""
    for i in range(n):
        p, v = joints[i, 0], joints[i, 1]
        qw, x, y, z = qpos[p + 3], qpos[p + 4], qpos[p + 5], qpos[p + 6]
        w0, w1, w2 = qvel[v + 3], qvel[v + 4], qvel[v + 5]
        tx, ty, tz = 2.0 * (y * w2 - z * w1), 2.0 * (z * w0 - x * w2), 2.0 * (x * w1 - y * w0)
        b[i, col.X], b[i, col.Y], b[i, col.VX], b[i, col.VY] = qpos[p], qpos[p + 1], qvel[v], qvel[v + 1]
        b[i, col.WX] = w0 + qw * tx + y * tz - z * ty
        b[i, col.WY] = w1 + qw * ty + z * tx - x * tz
        b[i, col.WZ] = w2 + qw * tz + x * ty - y * tx


@compiled_in_place
def _deliver(qpos, passive, joints, i, b, dv, h, mass, radius):  # type: ignore[no-untyped-def]
    """The changes dv (5,) of a ball within h as generalised forces."""
    p, v = joints[i, 0], joints[i, 1]
    passive[v] += mass * dv[0] / h
    passive[v + 1] += mass * dv[1] / h
    turn = 0.4 * mass * radius * radius / h
    w0, w1, w2 = turn * dv[2], turn * dv[3], turn * dv[4]
    qw, x, y, z = qpos[p + 3], -qpos[p + 4], -qpos[p + 5], -qpos[p + 6]
    tx, ty, tz = 2.0 * (y * w2 - z * w1), 2.0 * (z * w0 - x * w2), 2.0 * (x * w1 - y * w0)
    passive[v + 3] += w0 + qw * tx + y * tz - z * ty
    passive[v + 4] += w1 + qw * ty + z * tx - x * tz
    passive[v + 5] += w2 + qw * tz + x * ty - y * tx


@compiled_in_place
def _set_row(kbip, row, dist, acceleration):  # type: ignore[no-untyped-def]
    """Let a contact's row ask for this acceleration of its gap: a = -K I gap - B v."""
    kbip[row, 0] = -acceleration / (kbip[row, 2] * dist)
    kbip[row, 1] = 0.0


@compiled_in_place
def _is_still(b):  # type: ignore[no-untyped-def]
    """Whether nothing of a ball moves."""
    return b[col.VX] == 0.0 and b[col.VY] == 0.0 and b[col.WX] == 0.0 and b[col.WY] == 0.0 and b[col.WZ] == 0.0


@compiled_in_place
def _contact(place, o, geoms):  # type: ignore[no-untyped-def]
    """What meets in MuJoCo's contact at an address: ball i (-1 for none), the other ball, rail or jaw j, its kind
    (BALL for a ball), the horizontal unit vector from i into it, the horizontal part of the normal, and the gap.
    """
    pair = _int_pointer(place + o[at.CONTACT_GEOM])
    dist = _pointer(place + o[at.CONTACT_DIST])[0]
    normal = _pointer(place + o[at.CONTACT_FRAME])
    one, two, sign = pair[0], pair[1], 1.0
    if one < 0 or two < 0:
        return -1, 0, TOOL, 1.0, 0.0, 1.0, dist
    if geoms[one, 0] < 0 or (geoms[two, 0] >= 0 and geoms[two, 0] < geoms[one, 0]):
        one, two, sign = two, one, -1.0
    i, other = geoms[one, 0], geoms[two, 0]
    if i < 0:
        return -1, 0, TOOL, 1.0, 0.0, 1.0, dist
    kind, j = (BALL, other) if other >= 0 else (-1 - other, geoms[two, 1])
    nx, ny = sign * normal[0], sign * normal[1]
    level = math.sqrt(nx * nx + ny * ny)
    if level > 0.0:
        nx, ny = nx / level, ny / level
    return i, j, kind, nx, ny, level, dist


@compiled_in_place
def _which(n, rails, i, j, kind):  # type: ignore[no-untyped-def]
    """Where a contact is remembered: of balls i < j, or of ball i with rail or jaw j."""
    return j * (j - 1) // 2 + i if kind == BALL else n * (n - 1) // 2 + i * rails + j


@compiled_in_place
def _meet(  # type: ignore[no-untyped-def]
    kept, b, i, j, kind, nx, ny, level, gap, hit, hit_at, own, impact, dampings, session, now, radius, slide, masses,
    step, dv, work, kbip, weight, row,
):  # fmt: skip
    """Let two bodies push and rub each other in a step: the row of their contact, and changes dv of the balls."""
    cushion = kind != BALL
    if gap > -CONTACT_GAP_M:
        for k in range(CONTACT_MEMORY):
            kept[k] = 0.0
        if row >= 0 and gap < 0.0:
            _set_row(kbip, row, gap, -FREE_ACCELERATION)
        return
    approach = b[i, col.VX] * nx + b[i, col.VY] * ny
    if not cushion:
        approach -= b[j, col.VX] * nx + b[j, col.VY] * ny
    flat = gap
    if kind == NOSE:  # the gap along the normal, as MuJoCo has it, in the plane of the slate
        contact_radius = radius + NOSE_RADIUS
        flat = math.sqrt((contact_radius + gap) ** 2 - (contact_radius * NOSE_SINE) ** 2) - contact_radius * NOSE_COSINE
    depth, across = depth_of(cushion, flat, radius, kept[SINE] if kept[PEAK] > 0.0 else NOSE_SINE)
    if kept[PEAK] == 0.0 and kept[GIVEN] == 0.0 and -gap > CROWD_GAP_M + 2.0 * STEP_S * abs(approach):
        kept[GIVEN] = depth  # they were put into each other: nobody's work is in that
    if approach > max(kept[PEAK], MIN_IMPACT_SPEED):
        kept[PEAK] = approach
        describe(hit, cushion, i, j, b[i], b[i if cushion else j], nx, ny, radius, session, now)
        ask(hit, hit_at, own, impact)
        e = hit[rec.RESTITUTION]
        kept[GIVES_BACK], kept[DAMP] = e, damping_of(cushion, e, dampings)
        kept[MU], kept[GAIN], kept[DECAY], kept[SINE] = hit[rec.FRICTION], hit[rec.GAIN], hit[rec.DECAY], hit[rec.NOSE]
        kept[SINK], kept[SOFT] = hit[rec.SINK], hit[rec.COMPLIANCE]
        if cushion:
            depth, across = depth_of(True, flat, radius, kept[SINE])
        longer = 2.0 * hit[rec.CONTACT_TIME] / (1.0 + e) / CUSHION_TIME
        kept[STIFFNESS] = 1.0 / longer**2 if longer > 1.0 else 1.0
    kept[GIVEN] = min(kept[GIVEN], max(depth, 0.0))
    kept[LOWERED] += step * kept[DOWN] * kept[SINE]
    pressed = max(depth - kept[GIVEN] - kept[LOWERED], 0.0)
    moved = masses[i] if cushion else masses[i] / (1.0 + masses[i] / masses[j])
    kept[DEEPEST] = max(kept[DEEPEST], pressed)
    if kept[GIVES_BACK] > MIN_GIVEN_BACK:
        pressed = max(kept[DEEPEST] - (kept[DEEPEST] - pressed) / kept[GIVES_BACK] ** 2, 0.0)
        k, damp = spring(cushion, pressed, 0.0)
    else:
        k, damp = spring(cushion, pressed, kept[DAMP])
    k *= kept[STIFFNESS] if cushion else 1.0
    force = moved * max(k * pressed + damp * approach * across, 0.0)
    if row >= 0:
        wanted = force * across / level * (1.0 / weight + 1.0 / moved) if force > 0.0 else -FREE_ACCELERATION
        _set_row(kbip, row, gap, wanted)
    if row < 0 or force == 0.0:
        return
    dp = step * force
    hold = NOT_HELD
    if cushion and kept[SOFT] > MIN_COMPLIANCE:
        # The spring along the face, which friction holds: models/analytic/compliant.py.
        bi, sine = b[i], kept[SINE]
        cosine = math.sqrt(1.0 - sine * sine)
        va, vb = bi[col.VX] * ny - bi[col.VY] * nx, bi[col.VX] * nx + bi[col.VY] * ny
        wa, wb = bi[col.WX] * ny - bi[col.WY] * nx, bi[col.WX] * nx + bi[col.WY] * ny
        along = step * (va + radius * (wb * sine - bi[col.WZ] * cosine))
        up = step * (-vb * sine - kept[DOWN] * cosine + radius * wa)
        stiffness = moved * kept[STIFFNESS] * (math.pi / CUSHION_TIME) ** 2 / kept[SOFT]
        q1, q2 = dragged(
            kept[STRETCH_ALONG] + along, kept[STRETCH_UP] + up, along, up, kept[MU] * force / stiffness
        )  # fmt: skip
        kept[STRETCH_ALONG], kept[STRETCH_UP] = q1, q2
        hold = True, -step * stiffness * q1, -step * stiffness * q2
    kept[DOWN] = press(
        b, i, -1 - j if cushion else j, nx, ny, dp, kept[MU:], slide, masses, 1.0, across, dv, work, kept[DOWN],
        kept[SINK], hold,
    )  # fmt: skip
    dv[i, 0] += dp * across / masses[i] * nx  # what the normal force itself does is MuJoCo's
    dv[i, 1] += dp * across / masses[i] * ny
    if not cushion:
        dv[j, 0] -= dp / masses[j] * nx
        dv[j, 1] -= dp / masses[j] * ny


@compiled_in_place
def _sinks(table, numbers, holes, x, y, z):  # type: ignore[no-untyped-def]
    """Whether a ball's centre has no slate below it, or is below where it holds one."""
    if z < numbers[RADIUS] - SUNK_M:
        return True
    if table[HOLE_COUNT] == 1 and holes[0, 2] < 0.0:  # all beyond the nose lines
        return abs(x) > numbers[HALF_X] or abs(y) > numbers[HALF_Y]
    for k in range(table[HOLE_COUNT]):
        dx, dy = x - holes[k, 0], y - holes[k, 1]
        if dx * dx + dy * dy < holes[k, 2] * holes[k, 2]:
            return True
    return False


@compiled
def act(model, data, where, table_address):  # type: ignore[no-untyped-def]
    """Add what acts on the balls of one simulation to its passive forces, and choose its step.

    `model`, `data`: addresses of an mjModel and its mjData. `where`: address of the offsets of models/mujoco/layout.py.
    `table_address`: of the table of numbers above.
    """
    o = carray(_long_pointer(where), at.OFFSETS)
    table = carray(_long_pointer(table_address), TABLE_SIZE)
    numbers = carray(_pointer(table[NUMBERS]), NUMBER_COUNT)
    n, radius = table[BALLS], numbers[RADIUS]
    qpos = carray(_pointer(carray(_long_pointer(data + o[at.DATA_QPOS]), 1)[0]), ALL)
    qvel = carray(_pointer(carray(_long_pointer(data + o[at.DATA_QVEL]), 1)[0]), ALL)
    passive = carray(_pointer(carray(_long_pointer(data + o[at.DATA_PASSIVE]), 1)[0]), ALL)
    memory_at = carray(_long_pointer(data + o[at.DATA_USERDATA]), 1)[0]
    head = carray(_pointer(memory_at), HEAD)
    now = carray(_pointer(data + o[at.DATA_TIME]), 1)[0]
    timestep = carray(_pointer(model + o[at.MODEL_TIMESTEP]), 1)
    joints = carray(_long_pointer(table[JOINTS]), (n, 2))
    masses = carray(_pointer(table[MASSES]), n)
    row = int(head[ROW])
    own = table[OWN] + row * table[OWN_BYTES]
    cloth = carray(_pointer(table[CLOTH] + 24 * row), 3)
    forces = carray(_long_pointer(table[FORCES]), (table[FORCE_COUNT], 2))
    horizon = carray(_long_pointer(table[HORIZON]), (table[HORIZON_COUNT], 2))
    impact = carray(_long_pointer(table[IMPACT]), (table[IMPACT_COUNT], 2))
    dampings = carray(_pointer(table[DAMPING]), (3, table[DAMPING_COUNT]))
    geoms = carray(_long_pointer(table[GEOMS]), (table[GEOM_COUNT], 2))
    holes = carray(_pointer(table[HOLES]), (max(table[HOLE_COUNT], 1), 3))
    rails = table[RAILS]
    # Memory of balls and contacts, then room for work.
    contacts = n * (n - 1) // 2 + n * rails
    begin = memory_at + 8 * HEAD
    balls = carray(_pointer(begin), (n, BALL_MEMORY))
    begin += 8 * n * BALL_MEMORY
    kept = carray(_pointer(begin), (contacts, CONTACT_MEMORY))
    begin += 8 * contacts * CONTACT_MEMORY
    b = carray(_pointer(begin), (n, col.COLUMN_COUNT))
    begin += 8 * n * col.COLUMN_COUNT
    dv = carray(_pointer(begin), (n, 5))
    begin += 8 * n * 5
    record_at = begin
    r = carray(_pointer(begin), rec.BALL_FIELDS)
    begin += 8 * rec.BALL_FIELDS
    hit_at = begin
    hit = carray(_pointer(begin), rec.IMPACT_FIELDS)
    work = carray(_pointer(begin + 8 * rec.IMPACT_FIELDS), (4, 10))

    # A step has passed since the last look if the time is where that was to lead; otherwise it is the same look again.
    if now != head[STATE_TIME]:
        passed = abs(now - head[STATE_TIME] - head[STEP]) <= 1e-9
        head[STEP_BEFORE] = head[STEP] if passed else 0.0
        for i in range(n):
            balls[i, ROLLED] += balls[i, MORE_ROLLED] if passed else 0.0
        head[STATE_TIME] = now
    _gather(qpos, qvel, joints, b, n)
    for i in range(n):
        p = joints[i, 0]
        falling = balls[i, SUNK] > 0.0 and qpos[p + 2] < radius - LIFTED_M
        sinks = falling or _sinks(table, numbers, holes, qpos[p], qpos[p + 1], qpos[p + 2])
        balls[i, SUNK] = 1.0 if sinks else 0.0
        for k in range(5):
            dv[i, k] = 0.0
    session = head[SESSION:HEAD]

    # The step: as far as the nearest touch lets it.
    ncon = carray(_int_pointer(data + o[at.DATA_NCON]), 1)[0]
    contact_at = carray(_long_pointer(data + o[at.DATA_CONTACT]), 1)[0]
    kbip = carray(_pointer(carray(_long_pointer(data + o[at.DATA_KBIP]), 1)[0]), (ALL, 4))
    weights = carray(_pointer(carray(_long_pointer(data + o[at.DATA_D]), 1)[0]), ALL)
    step = numbers[BASE_STEP]
    if head[STEP_BEFORE] > 0.0:
        step = min(step, 2.0 * head[STEP_BEFORE])
    for c in range(ncon):
        i, j, kind, nx, ny, level, dist = _contact(contact_at + c * o[at.CONTACT_SIZE], o, geoms)
        if i < 0 or kind == SLATE or balls[i, SUNK] > 0.0 or (kind == BALL and balls[j, SUNK] > 0.0):
            continue
        if kind == TOOL:
            step = min(step, max(0.5 * dist / TOOL_SPEED, TOOL_STEP_S))
            continue
        closing = (b[i, col.VX] * nx + b[i, col.VY] * ny) * level
        if kind == BALL:
            closing -= (b[j, col.VX] * nx + b[j, col.VY] * ny) * level
        if dist < -CONTACT_GAP_M:
            which = _which(n, rails, i, j, kind)
            if closing > DEAD_SPEED or -dist - kept[which, GIVEN] > CONTACT_GAP_M:
                calm = abs(closing) < DEAD_SPEED and kept[which, PEAK] < DEAD_SPEED
                fine = STEP_S / math.sqrt(kept[which, STIFFNESS]) if kept[which, STIFFNESS] > 0.0 else STEP_S
                step = min(step, CALM_STEP_S if calm else fine)
        elif closing > 0.0:
            step = min(step, max(0.5 * dist / closing, STEP_S))
    head[STEP] = step
    timestep[0] = step
    flows = 0.5 * (head[STEP_BEFORE] + step)

    # Cloth and effects.
    r[rec.RADIUS], r[rec.TIME], r[rec.LAUNCH] = radius, now - head[STRUCK_AT], head[LAUNCH]
    for k in range(SESSION_FIELDS):
        r[rec.SESSION + k] = session[k]
    for i in range(n):
        balls[i, MORE_ROLLED] = 0.0
        if balls[i, SUNK] > 0.0:
            p, v = joints[i, 0], joints[i, 1]
            pull = masses[i] / NET_TIME_S
            if qpos[p + 2] < radius - SUNK_M:
                passive[v] -= pull * qvel[v]
                passive[v + 1] -= pull * qvel[v + 1]
            rest = -numbers[NET_DEPTH] - 4.0 * radius * i
            if qpos[p + 2] < rest:
                passive[v + 2] += pull * ((rest - qpos[p + 2]) / NET_TIME_S - 2.0 * qvel[v + 2]) + masses[i] * 9.81
            continue
        if forces.shape[0] == 0 and _is_still(b[i]):
            continue
        r[rec.X], r[rec.Y], r[rec.NUMBER], r[rec.MASS] = b[i, col.X], b[i, col.Y], i, masses[i]
        r[rec.ROLLED] = balls[i, ROLLED]
        rolls = _coast(r, record_at, b[i], own, forces, table[SUPPORT], horizon, cloth, flows, dv[i])
        if rolls:
            balls[i, MORE_ROLLED] = step * math.sqrt(b[i, col.VX] ** 2 + b[i, col.VY] ** 2) / radius

    # Impacts.
    work[3, 0] = radius
    for c in range(ncon):
        place = contact_at + c * o[at.CONTACT_SIZE]
        i, j, kind, nx, ny, level, dist = _contact(place, o, geoms)
        if i < 0 or kind == TOOL:
            continue
        line = carray(_int_pointer(place + o[at.CONTACT_ROW]), 1)[0]
        if kind == SLATE or balls[i, SUNK] > 0.0 or (kind == BALL and balls[j, SUNK] > 0.0):
            if line >= 0 and dist < 0.0 and (kind != SLATE or balls[i, SUNK] > 0.0):
                _set_row(kbip, line, dist, -FREE_ACCELERATION)
            continue
        which = _which(n, rails, i, j, kind)
        _meet(kept[which], b, i, j, kind, nx, ny, level, dist, hit, hit_at, own, impact, dampings, session, r[rec.TIME],
              radius, cloth[0], masses, step, dv, work, kbip, weights[max(line, 0)], line)  # fmt: skip
    for i in range(n):
        _deliver(qpos, passive, joints, i, b, dv[i], step, masses[i], radius)
