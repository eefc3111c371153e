"""Which contacts of a simulation act on its balls, and how long its next step may be until one of them touches.

In: a world, what a simulation of it remembers, and MuJoCo's contacts. Out: whether a contact is idle or has MuJoCo's
own terms; the length of the step [s], which shrinks towards a touch, each by at most half.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from numba import carray

from models.analytic.events import DEAD_SPEED, in_mouth
from models.analytic.pocket import ARC_RAILS, jaw_gap
from models.analytic.spring import CONTACT_GAP_M, SPRING_STEP_S
from models.compiled import compiled, compiled_in_place
from models.engine import columns as col
from models.engine.cluster import is_still
from models.engine.impacts import RAIL_OF_JAW
from models.engine.workspace import Index
from models.hooks import Array
from models.mujoco import layout as at
from models.mujoco import memory as mem
from models.mujoco.contact import read_contact, slot

TOOL_STEP_S: Final = 1e-5  # while something else touches a ball [s]
TOOL_SPEED: Final = 5.0  # at which that may come, at most [m/s]
NATIVE_STEP_S: Final = 1e-4  # in contacts with MuJoCo's own terms [s]
LEAN_STEP_S: Final = 2e-4  # while what moves may be driven into what it all but touches, at no speed yet [s]
TOUCH_M: Final = 1e-6  # gap of such bodies [m]
CALM_STEP_S: Final = 2e-5  # while balls only lean on each other or on a cushion [s]
ARC_COUNT: Final = len(ARC_RAILS)  # number of arcs of a table with jaws; the facings follow them


class Contacts(NamedTuple):
    """MuJoCo's contacts of a simulation."""

    at: int  # address of the first
    total: int  # how many there are
    offsets: Index  # of models/mujoco/layout.py
    geoms: Index  # (geoms, 2) what each geom is (models/mujoco/memory.py)


class WorldView(NamedTuple):
    """A world, and what a simulation of it remembers."""

    table: Index  # of the world
    numbers: Array  # (NUMBER_COUNT,) of the world
    balls: Array  # (n, BALL_MEMORY)
    kept: Array  # (contacts, CONTACT_MEMORY)
    b: Array  # (n, COLUMN_COUNT) the balls' rows, as the engine has them


@compiled
def is_idle(view, i, j, kind):  # type: ignore[no-untyped-def]
    """Whether what meets does not act: balls in pockets, and a rail where it ends in a mouth."""
    table, numbers, balls, kept, b = view
    if balls[i, mem.SUNK] > 0.0 or (kind == mem.BALL and balls[j, mem.SUNK] > 0.0):
        return True
    if kind == mem.BALL or numbers[mem.CORNER_MOUTH] == 0.0:
        return False
    if balls[i, mem.STAYS] > 0.0:  # for it, cushions go on
        return j >= mem.RAIL_COUNT
    half, ends = numbers[mem.HALF_X : mem.HALF_Y + 1], numbers[mem.CORNER_MOUTH : mem.MIDDLE_MOUTH + 1]
    if j < mem.RAIL_COUNT:  # without jaws, what touches a cushion goes on to, also into a mouth
        touches = table[mem.JAW_COUNT] == 0 and kept[slot(b.shape[0], i, j, kind), mem.PEAK] > 0.0
        return not touches and in_mouth(b[i, 1 - j // 2], j, half, ends)
    arc = j - mem.RAIL_COUNT
    if arc >= ARC_COUNT:
        return False
    # An arc goes on from its cushion, and a facing from the arc: a ball meets one of them at a time.
    rail = RAIL_OF_JAW[arc]
    if not in_mouth(b[i, 1 - rail // 2], rail, half, ends):
        return True
    jaws = carray(mem.doubles(table[mem.JAWS]), (table[mem.JAW_COUNT], 5))
    return table[mem.JAW_COUNT] > ARC_COUNT and jaw_gap(jaws[arc + ARC_COUNT], b[i, col.X], b[i, col.Y]) < np.inf


@compiled_in_place
def is_native(table, kind):  # type: ignore[no-untyped-def]
    """Whether a contact has MuJoCo's own terms."""
    return table[mem.NATIVE_BALLS] > 0 if kind == mem.BALL else table[mem.NATIVE_CUSHIONS] > 0


@compiled_in_place
def choose_step(view, contacts, longest, before):  # type: ignore[no-untyped-def]
    """Length of the next step [s]: at most twice the one before, and half of the way to the next touch."""
    table, _, _, kept, b = view
    contact_at, ncon, o, geoms = contacts
    step = longest
    if before > 0.0:
        step = min(step, 2.0 * before)
    for c in range(ncon):
        i, j, kind, nx, ny, level, gap = read_contact(contact_at + c * o[at.CONTACT_SIZE], o, geoms)
        if i < 0 or kind == mem.SLATE:
            continue
        if kind == mem.TOOL:
            step = min(step, max(0.5 * gap / TOOL_SPEED, TOOL_STEP_S))
            continue
        if is_idle(view, i, j, kind):
            continue
        closing = (b[i, col.VX] * nx + b[i, col.VY] * ny) * level
        if kind == mem.BALL:
            closing -= (b[j, col.VX] * nx + b[j, col.VY] * ny) * level
        least = NATIVE_STEP_S if is_native(table, kind) else SPRING_STEP_S
        if gap >= -CONTACT_GAP_M:
            still = is_still(b[i]) and (kind != mem.BALL or is_still(b[j]))
            if gap < TOUCH_M and closing > -DEAD_SPEED and not still:
                step = min(step, LEAN_STEP_S)
            if closing > 0.0:
                step = min(step, max(0.5 * gap / closing, least))
        elif least == NATIVE_STEP_S:
            step = min(step, least)
        else:
            one = kept[slot(b.shape[0], i, j, kind)]
            if closing > DEAD_SPEED or -gap - one[mem.GIVEN] > CONTACT_GAP_M:
                calm = abs(closing) < DEAD_SPEED and one[mem.PEAK] < DEAD_SPEED
                slower = 1.0 / math.sqrt(one[mem.STIFFNESS]) if one[mem.STIFFNESS] > 0.0 else 1.0
                step = min(step, CALM_STEP_S if calm else SPRING_STEP_S * slower)
    return step
