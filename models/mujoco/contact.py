"""An impact as MuJoCo's contact: the bodies, the normal force, and the friction with it.

The force of the spring (models/analytic/spring.py) is written into the contact's row before MuJoCo's solver takes it
up: at the low impedance of these contacts the solver applies what the row requests. Friction follows by the increments
of the impulse models.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

from models import record as rec
from models.analytic.compliant import MIN_COMPLIANCE, dragged
from models.analytic.events import DEAD_SPEED, MIN_IMPACT_SPEED
from models.analytic.increments import NOT_HELD
from models.analytic.spring import (
    CONTACT_GAP_M,
    CUSHION_TIME,
    NOSE_RADIUS,
    SPRING_STEP_S,
    depth_of,
    pushed,
)
from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.cluster import CROWD_GAP_M, ContactLaw, press
from models.engine.impacts import RAIL_OF_JAW, ask, describe, followed, is_pressed
from models.engine.workspace import Contact
from models.hooks import Array
from models.mujoco import layout as at
from models.mujoco.memory import (
    BALL,
    CLOTH_SHARE,
    CONTACT_MEMORY,
    DECAY,
    DEEPEST,
    DOWN,
    GAIN,
    GIVEN,
    GIVES_BACK,
    LOWERED,
    MU,
    NOSE,
    PART,
    PEAK,
    RAIL_COUNT,
    SINE,
    SINK,
    SOFT,
    STIFFNESS,
    STRETCH_ALONG,
    STRETCH_UP,
    TOOL,
    doubles,
    ints,
)
from models.shot import NOSE_COSINE, NOSE_SINE

FREE_ACCELERATION: Final = 1e9  # of a contact that does not act: the solver leaves it alone [m/s^2]


class Meeting(NamedTuple):
    """What meets in a contact of MuJoCo."""

    i: int  # ball, -1 for none
    j: int  # other ball, rail or jaw
    kind: int  # BALL if the other one is a ball, or what else it is (models/mujoco/memory.py)
    nx: float  # horizontal unit vector from the ball into the other
    ny: float
    level: float  # horizontal part of the normal
    gap: float  # [m]


class Step(NamedTuple):
    """The balls of a simulation in a step, n of them."""

    b: Array  # (n, COLUMN_COUNT) their rows, as the engine has them
    dv: Array  # (n, 5) changes of velocity and spin
    masses: Array  # (n,) [kg]
    slide_factors: Array  # (n,) on the cloth's sliding friction under each
    radius: float  # [m]
    now: float  # since the strike [s]
    length: float  # of the step [s]
    fresh: bool  # whether time has gone on since the last look
    hit: Array  # (IMPACT_FIELDS,) for work, as the next one (3, 10)
    work: Array


class SolverRow(NamedTuple):
    """The row of a contact in MuJoCo's solver."""

    kbip: Array  # (rows, 4) stiffness, damping, impedance of all rows
    weight: float  # inverse of the effective mass of this one
    number: int  # of this one, -1 for none


@compiled_in_place
def set_row(kbip, row, dist, acceleration):  # type: ignore[no-untyped-def]
    """Let a contact's row ask for this acceleration of its gap: a = -K I gap - B v."""
    kbip[row, 0] = -acceleration / (kbip[row, 2] * dist)
    kbip[row, 1] = 0.0


@compiled_in_place
def read_contact(place, o, geoms):  # type: ignore[no-untyped-def]
    """What meets in MuJoCo's contact at an address."""
    pair = ints(place + o[at.CONTACT_GEOM])
    dist = doubles(place + o[at.CONTACT_DIST])[0]
    normal = doubles(place + o[at.CONTACT_FRAME])
    one, two, sign = pair[0], pair[1], 1.0
    if one < 0 or two < 0:
        return Meeting(-1, 0, TOOL, 1.0, 0.0, 1.0, dist)
    if geoms[one, 0] < 0 or (geoms[two, 0] >= 0 and geoms[two, 0] < geoms[one, 0]):
        one, two, sign = two, one, -1.0
    i, other = geoms[one, 0], geoms[two, 0]
    if i < 0:
        return Meeting(-1, 0, TOOL, 1.0, 0.0, 1.0, dist)
    kind, j = (BALL, other) if other >= 0 else (-1 - other, geoms[two, 1])
    nx, ny = sign * normal[0], sign * normal[1]
    level = math.sqrt(nx * nx + ny * ny)
    if level > 0.0:
        nx, ny = nx / level, ny / level
    return Meeting(i, j, kind, nx, ny, level, dist)


@compiled_in_place
def slot(n, i, j, kind):  # type: ignore[no-untyped-def]
    """Where a contact is remembered: of balls i < j, or of ball i with rail j, or the rail that jaw j goes on from."""
    if kind == BALL:
        return j * (j - 1) // 2 + i
    return n * (n - 1) // 2 + i * RAIL_COUNT + (j if j < RAIL_COUNT else RAIL_OF_JAW[j - RAIL_COUNT])


@compiled_in_place
def _part(kept, meeting, solver):  # type: ignore[no-untyped-def]
    """Bodies that do not touch: nothing is remembered, unless a ball has gone on to another part of the rail."""
    _, j, kind, _, _, _, gap = meeting
    kbip, _, row = solver
    if kind == BALL or kept[PART] == j + 1:
        for k in range(CONTACT_MEMORY):
            kept[k] = 0.0
    if row >= 0 and gap < 0.0:
        set_row(kbip, row, gap, -FREE_ACCELERATION)


@compiled_in_place
def _flat_gap(gap, kind, radius):  # type: ignore[no-untyped-def]
    """The gap to a nose, which MuJoCo has along the normal, in the plane of the slate; any other as it is."""
    if kind != NOSE:
        return gap
    contact_radius = radius + NOSE_RADIUS
    return math.sqrt((contact_radius + gap) ** 2 - (contact_radius * NOSE_SINE) ** 2) - contact_radius * NOSE_COSINE


@compiled_in_place
def _ask_effects(kept, contact, laws, step):  # type: ignore[no-untyped-def]
    """Remember how the effects let an impact go."""
    hit = step.hit
    describe(hit, step.b, contact, step.radius, laws.session, step.now)
    ask(hit, laws.forces.own, laws.impact)
    e = hit[rec.RESTITUTION]
    kept[GIVES_BACK] = e
    kept[MU], kept[GAIN], kept[DECAY], kept[SINE] = hit[rec.FRICTION], hit[rec.GAIN], hit[rec.DECAY], hit[rec.NOSE]
    kept[SINK], kept[SOFT], kept[CLOTH_SHARE] = hit[rec.SINK], hit[rec.COMPLIANCE], hit[rec.CLOTH_SHARE]
    longer = 2.0 * hit[rec.CONTACT_TIME] / (1.0 + e) / CUSHION_TIME
    kept[STIFFNESS] = 1.0 / longer**2 if longer > 1.0 else 1.0


@compiled_in_place
def _hold_along_face(kept, contact, step, passes, force, moved):  # type: ignore[no-untyped-def]
    """The spring along a cushion's face, which friction holds (models/analytic/compliant.py): `hold` of the contact."""
    (i, _, _, nx, ny), radius = contact, step.radius
    bi, sine = step.b[i], kept[SINE]
    cosine = math.sqrt(1.0 - sine * sine)
    va, vb = bi[col.VX] * ny - bi[col.VY] * nx, bi[col.VX] * nx + bi[col.VY] * ny
    wa, wb = bi[col.WX] * ny - bi[col.WY] * nx, bi[col.WX] * nx + bi[col.WY] * ny
    along = passes * (va + radius * (wb * sine - bi[col.WZ] * cosine))
    up = passes * (-vb * sine - kept[DOWN] * cosine + radius * wa)
    stiffness = moved * kept[STIFFNESS] * (math.pi / CUSHION_TIME) ** 2 / kept[SOFT]
    q1, q2 = dragged(
        kept[STRETCH_ALONG] + along, kept[STRETCH_UP] + up, along, up, kept[MU] * force / stiffness
    )  # fmt: skip
    kept[STRETCH_ALONG], kept[STRETCH_UP] = q1, q2
    return True, -step.length * stiffness * q1, -step.length * stiffness * q2


@compiled_in_place
def _cloth_friction(kept, contact, laws, step):  # type: ignore[no-untyped-def]
    """Friction of the cloth under the ball that a contact presses onto it."""
    i, j, _, nx, ny = contact
    under = i if j < 0 or is_pressed(step.b[i], step.b[j], nx, ny) else j
    return followed(laws.cloth[0], step.slide_factors[under], kept[CLOTH_SHARE])


@compiled_in_place
def meet(kept, meeting, laws, step, solver):  # type: ignore[no-untyped-def]
    """Let two bodies push and rub each other in a step: the row of their contact, and changes dv of the balls.

    `kept` is what is remembered of the contact; the others: `Meeting`, `ShotLaws`, `Step` and `SolverRow`. Returns
    whether it is a new one.
    """
    i, j, kind, nx, ny, level, gap = meeting
    b, dv, masses, radius, fresh = step.b, step.dv, step.masses, step.radius, step.fresh
    kbip, weight, row = solver
    cushion = kind != BALL
    if gap > -CONTACT_GAP_M:
        _part(kept, meeting, solver)
        return False
    contact = Contact(i, -1 if cushion else j, j, nx, ny)
    new, passes = False, step.length if fresh else 0.0
    kept[PART] = j + 1
    approach = b[i, col.VX] * nx + b[i, col.VY] * ny
    if not cushion:
        approach -= b[j, col.VX] * nx + b[j, col.VY] * ny
    flat = _flat_gap(gap, kind, radius)
    depth, across = depth_of(cushion, flat, radius, kept[SINE] if kept[PEAK] > 0.0 else NOSE_SINE)
    if kept[PEAK] == 0.0 and kept[GIVEN] == 0.0 and -gap > CROWD_GAP_M + 2.0 * SPRING_STEP_S * abs(approach):
        kept[GIVEN] = depth  # they were put into each other: nobody's work is in that
    if approach > max(kept[PEAK], MIN_IMPACT_SPEED):
        new = fresh and kept[PEAK] <= DEAD_SPEED < approach  # what closes more slowly leans
        kept[PEAK] = approach
        _ask_effects(kept, contact, laws, step)
        if cushion:
            depth, across = depth_of(True, flat, radius, kept[SINE])
    kept[GIVEN] = min(kept[GIVEN], max(depth, 0.0))
    kept[LOWERED] += passes * kept[DOWN] * kept[SINE]
    pressed = max(depth - kept[GIVEN] - kept[LOWERED], 0.0)
    moved = masses[i] if cushion else masses[i] / (1.0 + masses[i] / masses[j])
    kept[DEEPEST] = max(kept[DEEPEST], pressed)
    force = moved * pushed(cushion, pressed, kept[DEEPEST], kept[GIVES_BACK], approach * across)
    if cushion:
        force *= kept[STIFFNESS]
    if row >= 0:
        wanted = force * across / level * (1.0 / weight + 1.0 / moved) if force > 0.0 else -FREE_ACCELERATION
        set_row(kbip, row, gap, wanted)
    if row < 0 or force == 0.0:
        return new
    dp = step.length * force
    hold = NOT_HELD
    if cushion and kept[SOFT] > MIN_COMPLIANCE:
        hold = _hold_along_face(kept, contact, step, passes, force, moved)
    cloth = _cloth_friction(kept, contact, laws, step)
    law = ContactLaw(
        kept[MU], kept[GAIN], kept[DECAY], kept[SINE], cloth, radius, across, kept[DOWN], kept[SINK], hold
    )  # fmt: skip
    down = press(b, contact, dp, (masses[i], masses[i] if cushion else masses[j]), law, dv, step.work)
    if fresh:
        kept[DOWN] = down
    dv[i, 0] += dp * across / masses[i] * nx  # what the normal force itself does is MuJoCo's
    dv[i, 1] += dp * across / masses[i] * ny
    if not cushion:
        dv[j, 0] -= dp / masses[j] * nx
        dv[j, 1] -= dp / masses[j] * ny
    return new
