"""Search for forces that jump along a ball's path without an announcement by the effect's `horizon`.

In: an effect. Out: a state at which its compiled `forces` jump, if one is met.

The event engine takes steps as its error estimate allows for smooth forces, and ends a step where `horizon` says. A
jump within a step is an error that depends on where the steps happen to end: it falsifies shots, and makes derivatives
of a fit noise. So paths are drawn through the space of states. Where the forces change most between two points of a
path, the interval is halved, always keeping the half that changes more: a change that remains as its length vanishes
is a jump. Left out: jumps that no path meets, such as those within a very small area.
"""

from __future__ import annotations

import ctypes
import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.hooks import BallState, address, fields_of
from models.shot import Array, Ball, Table

PATHS, POINTS, HALVINGS = 300, 64, 44  # halvings leave 1e-13 of a step, a few of the last bits of a float
PATHS_SEED = 1
MAX_SPEED_M_S, MAX_SIDESPIN, MAX_TIME_S = 4.0, 100.0, 12.0
MIN_JUMP_SHARE = 0.5  # share of the change between two points of a path that must remain for a jump
STATE_FIELDS = fields_of(BallState)
ACTING_FIELDS = tuple(STATE_FIELDS.index(name) for name in STATE_FIELDS[STATE_FIELDS.index("weight") :])


@dataclass(frozen=True)
class Jump:
    """A force that jumps."""

    field: str  # the field of BallState that it changes
    size: float
    state: BallState  # the state at the jump


def jump_of(effect: Effect, table: Table, ball: Ball) -> Jump | None:
    """The largest jump of an effect's forces on any of the paths; None if there is none.

    Args:
        effect: one number a parameter.
        table: of the paths.
        ball: that moves along them.

    Raises:
        HookError: its forces do not compile.
    """
    function = ctypes.CFUNCTYPE(None, ctypes.c_void_p, ctypes.c_void_p)(
        address(type(effect).forces, "forces", type(effect).layout())
    )
    own = np.ascontiguousarray(effect.row(1)[0])

    def acting(states: Array) -> Array:
        """Forces at states (n, fields): (n, k)."""
        rows = np.ascontiguousarray(states)
        for row in rows:
            function(own.ctypes.data, row.ctypes.data)
        return np.asarray(rows[:, ACTING_FIELDS])

    rng, found = np.random.default_rng(PATHS_SEED), list[Jump]()
    for _ in range(PATHS):
        begin, end = _way(rng, table, ball)
        jump = _jump_between(begin, end, acting)
        found += [] if jump is None else [jump]
    return min(found, key=lambda jump: (STATE_FIELDS.index(jump.field), -jump.size), default=None)


def _jump_between(begin: Array, end: Array, acting: Callable[[Array], Array]) -> Jump | None:
    """The jump between two states in the first field that has one: a push comes before its torque."""
    values = acting(begin + np.linspace(0.0, 1.0, POINTS)[:, None] * (end - begin))
    change = np.abs(np.diff(values, axis=0))
    for k in np.flatnonzero(change.max(axis=0) > 0).tolist():
        first = int(change[:, k].argmax())
        low, high = first / (POINTS - 1), (first + 1) / (POINTS - 1)
        a, b = values[first, k], values[first + 1, k]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            m = acting((begin + middle * (end - begin))[None])[0, k]
            low, high, a, b = (low, middle, a, m) if abs(m - a) >= abs(b - m) else (middle, high, m, b)
        if abs(b - a) > MIN_JUMP_SHARE * change[first, k]:
            state = BallState(*(begin + high * (end - begin)).tolist())
            return Jump(STATE_FIELDS[ACTING_FIELDS[k]], float(abs(b - a)), state)
    return None


def _way(rng: np.random.Generator, table: Table, ball: Ball) -> tuple[Array, Array]:
    """Two random states of a rolling or sliding ball, the ends of a path: two rows of BallState."""
    limits, rolls = table.centre_limits(ball), rng.random() < 0.5
    heading, turn = rng.uniform(-math.pi, math.pi), rng.uniform(-0.3, 0.3) if rolls else rng.uniform(-math.pi, math.pi)
    shared = {"launch": rng.uniform(0.1, MAX_SPEED_M_S), "order": rng.random(), "warmth": rng.uniform(-5.0, 10.0),
              "cloth_age": rng.uniform(0.0, 200.0), "table": 1.0, "player": 1.0, "number": float(rng.integers(2)),
              "radius": ball.radius, "mass": ball.mass, "rolling": float(rolls)}  # fmt: skip
    rows = []
    for k, late in enumerate(np.sort(rng.random(2)).tolist()):
        x, y = rng.uniform(-limits, limits).tolist()
        speed = rng.uniform(0.01, MAX_SPEED_M_S)
        vx, vy = speed * math.cos(heading + k * turn), speed * math.sin(heading + k * turn)
        slides = rng.uniform(-MAX_SIDESPIN, MAX_SIDESPIN, 2).tolist()
        wx, wy = (-vy / ball.radius, vx / ball.radius) if rolls else slides
        state = BallState(
            x=x, y=y, vx=vx, vy=vy, wx=wx, wy=wy, wz=rng.uniform(0.1, MAX_SIDESPIN), time=late * MAX_TIME_S,
            slip_x=vx - ball.radius * wy, slip_y=vy + ball.radius * wx, hour=12.0 + late * MAX_TIME_S / 3600.0,
            rolled=late * MAX_TIME_S * MAX_SPEED_M_S / ball.radius, **shared,
        )  # fmt: skip
        rows.append(np.array(dataclasses.astuple(state)))
    return rows[0], rows[1]
