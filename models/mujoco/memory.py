"""Layout of the memory of a world and of a simulation for compiled code: columns, and arrays behind addresses.

A world (models/mujoco/world.py) passes one table of integers with the number of items and where
arrays stand. A simulation keeps what it must remember from step to step in `userdata`: so mj_copyData takes it along,
and simulations of one model that run side by side share nothing.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numba import types
from numba.extending import intrinsic

from models import record as rec
from models.engine import columns as col
from models.shot import SESSION_FIELDS, Array, Session

ANY_SIZE: Final = 1 << 30  # size of an array whose real size is not needed

# The table of a world.
(
    BALLS, OWN, OWN_BYTES, CLOTH, FORCES, FORCE_COUNT, SUPPORT, HORIZON, HORIZON_COUNT, IMPACT, IMPACT_COUNT,
    GEOMS, JAWS, JAW_COUNT, HOLES, HOLE_COUNT, JOINTS, MASSES, NUMBERS, NATIVE_CLOTH, NATIVE_BALLS, NATIVE_CUSHIONS,
    FELT, TABLE_SIZE,
) = range(24)  # fmt: skip
# Its floats: metres and seconds. Straight cushions end at mouths or jaws, so far from a corner and from a middle.
RADIUS, BASE_STEP, HALF_X, HALF_Y, CORNER_MOUTH, MIDDLE_MOUTH, NET_DEPTH, NUMBER_COUNT = range(8)
# Of a geom: the number of its ball, or -1 - kind; then the number of the rail, or 4 + that of the jaw. A post is an
# upright cylinder. BALL is the kind of a contact between two balls.
BALL, SLATE, NOSE, POST, TOOL = -1, 0, 1, 2, 3
RAIL_COUNT: Final = 4

# The memory of a simulation begins with: the row of its parameters, the address of what records it, or 0, the time and
# step of its last look, the step before that, its longest step, or 0 for that of the world, when the strike was, its
# speed, and the shot's session.
ROW, RECORD, STATE_TIME, STEP, STEP_BEFORE, LONGEST, STRUCK_AT, LAUNCH, SESSION = range(9)
HEAD_SIZE: Final = SESSION + SESSION_FIELDS
# Of each ball: angles rolled and turned, by how much more after this step, whether it has no slate below it, whether no
# pocket takes it.
ROLLED, MORE_ROLLED, TURNED, SUNK, STAYS, BALL_MEMORY = range(6)
# Of each contact: of a rail, what part of it touches, 1 + its number; largest approach speed [m/s], overlap that is
# nobody's work and largest depth [m], restitution, stiffness over the usual; share of a push that the slate does not
# return, the speed [m/s] and way [m] down that this stands for; compliance and extensions [m] along the face; friction,
# nose; how the cloth's friction follows what changes it.
(
    PART, PEAK, GIVEN, DEEPEST, GIVES_BACK, STIFFNESS, SINK, DOWN, LOWERED, SOFT, STRETCH_ALONG, STRETCH_UP, MU, GAIN,
    DECAY, SINE, CLOTH_SHARE, CONTACT_MEMORY,
) = range(18)  # fmt: skip
WORK_SIZE: Final = 3 * 10

# A record: how many samples and events there is room for, how many there are; then times, samples, events of the kinds
# of models/engine/touch.py.
TIME_COUNT, NEXT_TIME, EVENT_ROOM, EVENT_COUNT, RECORD_HEAD = range(5)
EVENT_SIZE: Final = 6  # time, kind, ball, other, place of the ball


def contact_count(balls: int) -> int:
    """Number of remembered contacts: of each two balls, of each ball with each rail and its continuation."""
    return balls * (balls - 1) // 2 + balls * RAIL_COUNT


def memory_size(balls: int) -> int:
    """Size of the memory of a simulation, with work space."""
    each = BALL_MEMORY + col.ROW_SIZE + col.COLUMN_COUNT + 5 + 1
    work = rec.BALL_FIELDS + rec.IMPACT_FIELDS + WORK_SIZE
    return HEAD_SIZE + balls * each + contact_count(balls) * CONTACT_MEMORY + work


def record_size(times: int, balls: int, events: int) -> int:
    """Size of a record."""
    return RECORD_HEAD + times * (1 + balls * col.ROW_SIZE) + events * EVENT_SIZE


def at_strike(row: int, struck_at: float, launch: float, session: Session, size: int) -> Array:
    """The memory of a simulation at a strike: (size,)."""
    kept = np.zeros(size)
    kept[ROW], kept[STATE_TIME], kept[STRUCK_AT], kept[LAUNCH] = row, np.nan, struck_at, launch
    kept[SESSION:HEAD_SIZE] = session.row
    return kept


@intrinsic
def doubles(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to floats."""
    return types.CPointer(types.float64)(types.int64), _as_pointer


@intrinsic
def longs(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to integers of 8 bytes."""
    return types.CPointer(types.int64)(types.int64), _as_pointer


@intrinsic
def ints(context, address):  # type: ignore[no-untyped-def]
    """An address as a pointer to integers of 4 bytes."""
    return types.CPointer(types.int32)(types.int64), _as_pointer


def _as_pointer(context, builder, signature, args):  # type: ignore[no-untyped-def]
    return builder.inttoptr(args[0], context.get_value_type(signature.return_type))
