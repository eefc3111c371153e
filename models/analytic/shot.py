"""Whole shots, from event to event: slide, roll, rest, ball on ball, cushion, pocket.

Motion between events is the closed form of the cloth (models/analytic/cloth.py), events are landed on to rounding
(models/analytic/events.py), impacts are those of models/analytic/impulse.py and cushion.py. `play` gives the tracks
that models.simulate gives; `finish` plays thousands of shots to their end and builds nothing else. Sources: Robotic
Billiards (2015) for cloth and pockets; Mathavan, Jackson, Parkin 2009, 2010, 2014 for figures and impacts; Han 2005.
Pockets are mouths, or have jaws (models/analytic/pocket.py). Leaves out jumps, and impacts of three at once, which are
taken two by two (see models/analytic/engine.py).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.analytic.cushion import law_of
from models.analytic.engine import BALL, MOST, POCKET, play_rows
from models.analytic.pocket import NONE, Pockets, pockets_of, rail_of
from models.shot import Ball, Event, Shot, Table, Track

Array = NDArray[np.float64]
Number = float | Array
KINDS = ("ball", "cushion", "pocket")


@dataclass(frozen=True)
class Constants:
    """The constants of a table; each one number or (n,) for n shots."""

    slide: Number = 0.2  # friction of sliding [1], bounds 0 to 0.6; Mathavan 2009: 0.178 to 0.245
    roll: Number = 0.0127  # rolling deceleration over g [1], bounds 0 to 0.05; Mathavan 2009: 0.0126 to 0.0128
    spin: Number = 22.0  # deceleration of sidespin [rad/s^2], bounds 0 to 80; Robotic Billiards 2015
    ball_restitution: Number = 0.89  # [1], bounds 0 to 1; Mathavan 2014
    ball_friction: Number = 0.05  # [1], bounds 0 to 0.5; Mathavan 2014
    cushion_restitution: Number = 0.98  # [1], bounds 0 to 1; Mathavan 2010, below 1.5 m/s
    cushion_friction: Number = 0.14  # [1], bounds 0 to 0.43; Mathavan 2010
    cushion_law: str = "mathavan2010"  # or "han2005"

    def rows(self, n: int) -> Array:
        """The numbers for each of n shots: (n, 7)."""
        out = np.empty((n, 7))
        for k, f in enumerate(dataclasses.fields(self)[:7]):
            value = np.asarray(getattr(self, f.name), float)
            if value.shape not in ((), (n,)):
                raise ValueError(f"{f.name} has shape {value.shape}; give one number, or one for each of {n} shots")
            if not (np.isfinite(value).all() and (value >= 0).all()):
                raise ValueError(f"{f.name} is {value.min()}; give finite numbers of 0 or more")
            out[:, k] = value
        return out


@dataclass(frozen=True)
class Result:
    """How shots ended."""

    position: Array  # (n, nball, 2) [m]; of a potted ball where it fell
    velocity: Array  # (n, nball, 2) [m/s]
    spin: Array  # (n, nball, 3) [rad/s]
    potted: NDArray[np.bool_]  # (n, nball)
    time: Array  # (n,) [s], when everything had come to rest, spin too, or `until`; nan: given up after `most` events
    counts: NDArray[np.int64]  # (n, 4): impacts of balls, of cushions, balls potted, changes of phase
    event_time: Array  # (n, events) [s], inf beyond the last one
    # (n, events, 3): kind (0 ball, 1 cushion, 2 pocket), ball, and other ball, rail, 4 + jaw, or pocket where jaws are
    event: NDArray[np.int64]


def _run(
    table: Table, ball: Ball, constants: Constants, start: Array, until: Array, times: Array, events: int, threads: int,
    jaws: bool, most: int,
) -> tuple[Result, Array]:  # fmt: skip
    n, nball = start.shape[:2]
    rows = constants.rows(n)
    if np.isinf(until).any() and not (rows[:, :2] > 0).all():
        raise ValueError(f"slide {rows[:, 0].min()}, roll {rows[:, 1].min()}: without friction give a finite end")
    out, end = np.full((n, times.shape[1], nball, 8), np.nan), np.zeros(n)
    log, who, count = np.full((n, events), np.inf), np.full((n, events, 3), -1), np.zeros((n, 4), np.int64)
    potted = np.zeros((n, nball), np.bool_)
    pockets = pockets_of(table, ball) if jaws else Pockets(table.mouths(), NONE, NONE)
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads or before, numba.config.NUMBA_NUM_THREADS))
    try:
        play_rows(
            start, rows, int(law_of(constants.cushion_law)), ball.mass, ball.radius, table.reach(ball),
            np.array([table.length / 2, table.width / 2]), pockets.ends, pockets.jaws, pockets.falls, until, most,
            times, out, log, who, count, end, potted,
        )  # fmt: skip
    finally:
        numba.set_num_threads(before)
    if most >= MOST and np.isnan(end).any():
        raise RuntimeError(f"shot {int(np.flatnonzero(np.isnan(end))[0])} has not come to its end after {most} events")
    return Result(start[..., :2], start[..., 2:4], start[..., 4:7], potted, end, count, log, who), out


def finish(
    table: Table, ball: Ball, constants: Constants, position: ArrayLike, velocity: ArrayLike, spin: ArrayLike,
    until: ArrayLike = np.inf, *, events: int = 0, threads: int = 0, jaws: bool = False, most: int = MOST,
) -> Result:  # fmt: skip
    """Play many shots to rest, or until a time.

    Args:
        table: the table.
        ball: all the balls.
        constants: numbers, or (n,) arrays.
        position: (n, nball, 2) [m].
        velocity: (n, nball, 2) [m/s].
        spin: (n, nball, 3) [rad/s].
        until: one time or (n,) [s].
        events: how many impacts and pots of a shot to log.
        threads: at most; 0 for all. The result does not depend on it, to the last bit.
        jaws: whether pockets have jaws and an edge; without, a mouth takes what comes into it.
        most: events (changes of phase too) after which a shot is given up. Below the default that is no error: its
            time is nan, and its balls are as they were then.

    Raises:
        ValueError: for shapes and numbers that do not fit.
        RuntimeError: for a shot that never ends.
    """
    p, v, w = (np.asarray(x, float) for x in (position, velocity, spin))
    n, nball = p.shape[:2]
    for name, value, size in (("position", p, 2), ("velocity", v, 2), ("spin", w, 3)):
        if value.shape != (n, nball, size):
            raise ValueError(f"{name} has shape {value.shape}; {n} shots of {nball} balls need {(n, nball, size)}")
        if not np.isfinite(value).all():
            raise ValueError(f"{name} holds {value[~np.isfinite(value)][0]}; give finite numbers")
    start = np.concatenate([p, v, w, np.zeros((n, nball, 1))], axis=2)
    end = np.broadcast_to(np.asarray(until, float), (n,)).copy()
    return _run(table, ball, constants, start, end, np.zeros((n, 0)), events, threads, jaws, most)[0]


def play(
    table: Table, ball: Ball, constants: Constants, shots: Sequence[Shot], *, events: int = 64, threads: int = 0,
    jaws: bool = False,
) -> list[Track]:  # fmt: skip
    """A track for every shot, in order, as models.simulate gives; all shots of one number of balls go together.

    `events`: room for the log to begin with; it grows where a shot has more. `jaws`: as in `finish`.
    """
    tracks: list[Track | None] = [None] * len(shots)
    sizes = np.array([len(s.names) for s in shots], int)
    rows = constants.rows(len(shots))
    fields = [f.name for f in dataclasses.fields(constants)[:7]]
    for size in np.unique(sizes):
        part = np.flatnonzero(sizes == size)
        order: list[int] = part.tolist()
        own = dataclasses.replace(constants, **{name: rows[part, k] for k, name in enumerate(fields)})
        start = np.zeros((part.size, size, 8))
        times = np.full((part.size, max((len(shots[r].times) for r in order), default=0)), np.inf)
        for k, r in enumerate(order):
            start[k, :, :2], start[k, :, 2:4], start[k, :, 4:7] = shots[r].position, shots[r].velocity, shots[r].spin
            times[k, : len(shots[r].times)] = shots[r].times
        end = np.array([shots[r].times[-1] if len(shots[r].times) else 0.0 for r in order])
        room = events
        while True:
            result, out = _run(table, ball, own, start.copy(), end, times, room, threads, jaws, MOST)
            most = int(result.counts[:, :3].sum(axis=1).max(initial=0))
            if most <= room:
                break
            room = most
        for k, r in enumerate(order):
            tracks[r] = _track(shots[r], out[k], result.event_time[k], result.event[k], result.position[k])
    return [t for t in tracks if t is not None]


def _track(shot: Shot, out: Array, when: Array, who: NDArray[np.int64], last: Array) -> Track:
    data, names = out[: len(shot.times)], shot.names
    happened = []
    for t, (kind, i, j) in zip(when, who, strict=True):
        if kind < 0:
            break
        balls = (names[i], names[j]) if kind == BALL else (names[i],)
        rail = rail_of(int(j)) if kind not in (BALL, POCKET) else ""
        place = (float(last[i, 0]), float(last[i, 1])) if kind == POCKET else None
        happened.append(Event(float(t), KINDS[kind], balls, rail, place))
    return Track(
        names, shot.times, data[..., :2], data[..., 2:4], data[..., 4:7], data[..., 7], tuple(happened)
    )  # fmt: skip
