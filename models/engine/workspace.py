"""What compiled code passes together: the balls of a shot, the laws that they follow, and what is recorded of it.

Shots of n balls. Rows of balls have the columns of models/engine/columns.py, `records` and `hit` those of
models/record.py.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from models import record as rec
from models.compiled import compiled
from models.engine import columns as col
from models.hooks import Array, Table

Index = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Motion(NamedTuple):
    """How one ball moves."""

    ball: Array  # (COLUMN_COUNT,)
    curve: Array  # (STATE_SIZE, TERM_COUNT) polynomials in time, where it is on a curve
    kind: int  # what it does (models/engine/motion.py)


class Chord(NamedTuple):
    """The chord of a curve."""

    x: float  # of its end [m]
    y: float
    sagitta: float  # by which the curve leaves it at most [m]
    end: float  # when the ball is there [s]


class Balls(NamedTuple):
    """The balls of a shot, and how each moves."""

    rows: Array  # (n, COLUMN_COUNT)
    curves: Array  # (n, STATE_SIZE, TERM_COUNT); (n, 1, TERM_COUNT) where no effect pushes
    kind: Index  # (n,)
    stays: Flags  # (n,) which no pocket takes
    records: Array  # (n, BALL_FIELDS) as hooks see them


class Notes(NamedTuple):
    """What is known of the balls until an event changes it."""

    what: Index  # (n, 2) what a ball meets of the table at its time MEET: kind of event, number of rail, jaw or pocket
    leans: Array  # (n,) time until which it is known to lean on something [s]
    quiet: Array  # (n,) time until which it is not looked for at cushions that it leans on; inf: just pressed [s]
    still: Array  # (n, 2, 3) where a leaning ball moved last, and when (models/engine/leaning.py)
    todo: Flags  # (n,) which are worked out anew
    touched: Flags  # (n,) which an event has moved
    held: Flags  # (n,) which are held
    pair: Array  # (n (n - 1) / 2,) time at which two balls meet [s]
    again: Flags  # of the same pairs, whether they are pressed together, and only looked at again then


class ImpactWork(NamedTuple):
    """Arrays that an impact is worked out in."""

    state: Array  # (10,) of models/analytic/impulse.py
    hit: Array  # (IMPACT_FIELDS,)


class CurveWork(NamedTuple):
    """Arrays that a step along a curve is worked out in."""

    y: Array  # (STATE_SIZE,) state of a stage
    k: Array  # (7, STATE_SIZE) rates of change in the stages


class Workspace(NamedTuple):
    """Everything that a shot is played in, one shot after the other."""

    balls: Balls
    notes: Notes
    impact: ImpactWork
    curve: CurveWork
    cursor: Index  # (2,) number of the next sample, and of the next event to log


class Forces(NamedTuple):
    """The effects that push balls: hooks `forces` (models/hooks.py)."""

    own: int  # address of the effects' parameters in this shot
    hooks: Table  # (k, 2)
    support: int  # how many of them say what the cloth carries


class ShotLaws(NamedTuple):
    """What acts on the balls of a shot, and what the effects know of it."""

    forces: Forces
    horizon: Table  # (k, 2) hooks that say for how long a push goes on
    impact: Table  # (k, 2) hooks that say how an impact goes
    cloth: Array  # (3,) friction of sliding and of rolling, deceleration of sidespin [rad/s^2]
    mass: float  # [kg]
    session: Array  # (SESSION_FIELDS,) of models/shot.py
    launch: float  # speed of the struck ball at t = 0, 0 if it was not struck [m/s]


class Pair(NamedTuple):
    """Two bodies: balls i and j, or ball i and a cushion (j < 0): rail +x, -x, +y, -y, or 4 + jaw."""

    i: int
    j: int
    rail: int


class Contact(NamedTuple):
    """The same where they touch."""

    i: int
    j: int
    rail: int
    nx: float  # horizontal unit vector from the first into the second
    ny: float


class Options(NamedTuple):
    """How far and how a shot is played."""

    until: float  # [s]
    most: int  # events after which it is given up
    clusters: bool  # whether several bodies that touch at once go through springs, or are taken two by two


class ShotLog(NamedTuple):
    """What is written of a shot."""

    times: Array  # (m,) at which it is sampled [s]
    out: Array  # (m, n, ROW_SIZE) samples
    log: Array  # (events,) times of events [s]
    who: Index  # (events, 3) kind, ball, other ball, rail or pocket
    counts: Index  # (4,) events of each kind, also of those that there is no room for
    potted: Flags  # (n,)
    cursor: Index  # (2,) of the workspace


@compiled
def workspace(n, curved):  # type: ignore[no-untyped-def]
    """A `Workspace` for n balls; `curved`: whether effects push them."""
    pairs = n * (n - 1) // 2
    balls = Balls(
        np.zeros((n, col.COLUMN_COUNT)),
        np.zeros((n, col.STATE_SIZE if curved else 1, col.TERM_COUNT)),
        np.zeros(n, np.int64),
        np.zeros(n, np.bool_),
        np.zeros((n, rec.BALL_FIELDS)),
    )
    notes = Notes(
        np.zeros((n, 2), np.int64), np.zeros(n), np.zeros(n), np.zeros((n, 2, 3)),
        np.zeros(n, np.bool_), np.zeros(n, np.bool_), np.zeros(n, np.bool_),
        np.zeros(pairs), np.zeros(pairs, np.bool_),
    )  # fmt: skip
    impact = ImpactWork(np.zeros(10), np.zeros(rec.IMPACT_FIELDS))
    curve = CurveWork(np.zeros(col.STATE_SIZE), np.zeros((7, col.STATE_SIZE)))
    return Workspace(balls, notes, impact, curve, np.zeros(2, np.int64))
