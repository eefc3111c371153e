"""Shots on a model, many at a time over threads: effects and shots laid out, tracks or ends of shots handed back."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from models.analytic.pocket import NO_ARCS, Pockets, pockets_of, rail_of
from models.engine.columns import ROW_SIZE
from models.engine.loop import play_rows
from models.engine.touch import BALL, POCKET
from models.hooks import Array, Hooks, hooks_of
from models.shot import NOSE_COSINE, SESSION_FIELDS, Event, Shot, Track
from models.table.sizes import SIZE_NAMES, stated_size
from models.workers.threads import over_threads

if TYPE_CHECKING:
    from models.model_file import Model

EVENT_KINDS = ("ball", "cushion", "pocket")
CLOTH_CONSTANTS = ("slide", "roll", "spin")  # names of the cloth's constants
MAX_EVENTS = 1_000_000  # events after which a shot is given up; balls driven by a push may need nearly as many
LOG_ROOM = 64  # initial room for the events of a shot


class Game(NamedTuple):
    """A model laid out for a number of shots."""

    hooks: Hooks
    cloth: Array  # (n, 3): friction of sliding and rolling, deceleration of sidespin [rad/s^2]
    pockets: Pockets
    limits: Array  # (n, 2) largest |x|, |y| of a ball's centre [m]
    half: Array  # (n, 2) of length and width [m]
    mass: float  # [kg]
    radius: Array  # (n,) [m]


def lacking(model: Model) -> str:
    """Why the engine does not play a model; "" where it does."""
    stack = model.stack()
    found = {e.slot for e in stack} | {e.resolves for e in stack}
    missing = [k for k in ("cloth", "ball", "cushion") if k not in found]
    if missing:
        return f"it has no effect for {', '.join(missing)}"
    edits = [e.name() for e in stack[1:] if e.opens("edit") and e.slot != "cloth"]
    return f"{', '.join(edits)} edits the MJCF" if edits else ""


def lay_out(model: Model, count: int, jaws: bool = False, *, native: bool = False) -> Game:
    """A model for `count` shots; its parameters are numbers or (count,) arrays.

    `native`: whether it may lack effects for cloth and impacts, for which MuJoCo's own terms stand.

    Raises:
        ValueError: for a model that the engine does not play, and for tables of several sizes with jaws.
    """
    if not native and (why := lacking(model)):
        raise ValueError(f"the event engine does not play this model: {why}")
    stack = model.stack()[1:]
    cloth = next((e for e in stack if e.slot == "cloth"), None)
    laws = np.stack([np.broadcast_to(np.asarray(getattr(cloth, k, 0.0), float), (count,)) for k in CLOTH_CONSTANTS])
    sizes = np.empty((count, len(SIZE_NAMES)))
    for k, name in enumerate(SIZE_NAMES):
        sizes[:, k] = model.sizes.get(name, stated_size(name, model.table, model.ball))
    hooks = hooks_of([e for e in stack if e is not cloth], count)
    return _game(model, hooks, np.ascontiguousarray(laws.T), sizes, jaws)


def _game(model: Model, hooks: Hooks, cloth: Array, sizes: Array, jaws: bool) -> Game:
    """A game on tables of these sizes (n, 3), in the order of SIZE_NAMES [m]."""
    played = model.as_played() if jaws else model
    pockets = pockets_of(played.table, played.ball) if jaws else Pockets(model.table.mouths(), NO_ARCS, NO_ARCS)
    half, radius = sizes[:, :2] / 2, sizes[:, 2] / 2
    limits = half - NOSE_COSINE * radius[:, None]
    return Game(hooks, cloth, pockets, limits, half, float(model.ball.mass), radius)


class ShotRows(NamedTuple):
    """Shots of one number of balls, laid out."""

    start: Array  # (n, nball, 8) place, velocity, spin, angle turned; left as they end
    stays: NDArray[np.bool_]  # (n, nball) balls that no pocket takes
    struck: NDArray[np.bool_]  # (n,) by a cue, or in motion from the start
    session: Array  # (n, SESSION_FIELDS)
    until: Array  # (n,) [s]
    times: Array  # (n, m) of samples [s]


class LogRows(NamedTuple):
    """What is written of shots."""

    out: Array  # (n, m, nball, 8) samples
    event_time: Array  # as in `Result`
    event: NDArray[np.int64]
    counts: NDArray[np.int64]
    potted: NDArray[np.bool_]
    time: Array


class Layout:
    """A model laid out once for many calls, with the values of some of its constants in rows."""

    def __init__(self, model: Model, names: Sequence[str]) -> None:
        """Find where in a row of parameters each of the constants `names` stands."""
        self.model, self.effects = model, [e for e in model.effects if e.slot != "cloth"]
        cloth = next(e for e in model.effects if e.slot == "cloth")
        stated = {name: stated_size(name, model.table, model.ball) for name in SIZE_NAMES}
        self.sizes = np.array([[float((stated | dict(model.sizes))[name]) for name in SIZE_NAMES]])
        self.cloth = np.array([[float(getattr(cloth, k)) for k in CLOTH_CONSTANTS]])
        rows = [e.row(1) for e in self.effects]
        self.own = np.concatenate([*rows, np.zeros((1, 0))], axis=1)
        self.begins = np.cumsum([0, *(r.shape[1] for r in rows)])
        self.places: list[tuple[str, int]] = []  # of each constant: whether of cloth, sizes or effects, and its column
        self.offs: list[list[tuple[int, float]]] = [[] for _ in self.effects]  # column and off value of its switches
        owners = [e.name() for e in self.effects]
        for name in names:
            owner, key = name.split(".")
            if name in SIZE_NAMES:
                self.places.append(("sizes", SIZE_NAMES.index(name)))
            elif owner == cloth.name():
                self.places.append(("cloth", CLOTH_CONSTANTS.index(key)))
            else:
                n = owners.index(owner)
                self.places.append(("own", int(self.begins[n]) + self.effects[n].column(key)))
        for n, effect in enumerate(self.effects):
            for key, meta in effect.parameters().items():
                if meta["off"] is not None:
                    self.offs[n].append((int(self.begins[n]) + effect.column(key), meta["off"]))
        self.hooks: dict[tuple[bool, ...], Hooks] = {}  # by which effects are on

    def __getstate__(self) -> dict[str, Any]:
        """For another process: addresses of compiled hooks mean nothing there."""
        return {**vars(self), "hooks": {}}

    def game(self, c: Array) -> Game:
        """The model with constants c (n, q) for n shots; effects that are off in all of them are left out."""
        n = len(c)
        rows = {name: np.repeat(getattr(self, name), n, axis=0) for name in ("own", "cloth", "sizes")}
        for k, (name, column) in enumerate(self.places):
            rows[name][:, column] = c[:, k]
        own = rows["own"]
        on = tuple(not offs or any(bool((own[:, column] != off).any()) for column, off in offs) for offs in self.offs)
        if on not in self.hooks:
            some = [e for e, here in zip(self.effects, on, strict=True) if here]
            begins = [int(b) for b, here in zip(self.begins, on, strict=False) if here]
            self.hooks[on] = hooks_of(some, 1, begins)
        return _game(self.model, self.hooks[on]._replace(own=own), rows["cloth"], rows["sizes"], False)


@dataclass(frozen=True)
class Result:
    """How shots ended."""

    position: Array  # (n, nball, 2) [m]; of a potted ball where it fell
    velocity: Array  # (n, nball, 2) [m/s]
    spin: Array  # (n, nball, 3) [rad/s]
    potted: NDArray[np.bool_]  # (n, nball)
    time: Array  # (n,) [s], when everything had come to rest, spin too, or `until`; nan: given up after `most` events
    counts: NDArray[np.int64]  # (n, 4): impacts of balls, of cushions, balls potted, changes of motion
    event_time: Array  # (n, events) [s], inf beyond the last one
    # (n, events, 3): kind (0 ball, 1 cushion, 2 pocket), ball, and other ball, rail, 4 + jaw, or pocket where jaws are
    event: NDArray[np.int64]


def run(
    game: Game, shots: ShotRows, events: int, threads: int, most: int, clusters: bool
) -> tuple[Result, Array]:  # fmt: skip
    """Play laid-out shots, logging so many events of each; samples (n, m, nball, 8)."""
    start, (n, nball) = shots.start, shots.start.shape[:2]
    record = LogRows(
        np.empty((n, shots.times.shape[1], nball, ROW_SIZE)), np.full((n, events), np.inf),
        np.full((n, events, 3), -1), np.zeros((n, 4), np.int64), np.zeros((n, nball), np.bool_), np.zeros(n),
    )  # fmt: skip

    def part(first: int, last: int) -> None:
        record.out[first:last] = np.nan
        play_rows(first, last, game, shots, record, most, clusters)

    over_threads(part, n, threads)
    end = record.time
    if most >= MAX_EVENTS and np.isnan(end).any():
        raise RuntimeError(f"shot {int(np.flatnonzero(np.isnan(end))[0])} has not come to its end after {most} events")
    out, log, who, count, potted, _ = record
    return Result(start[..., :2], start[..., 2:4], start[..., 4:7], potted, end, count, log, who), out


def finish(
    model: Model, position: ArrayLike, velocity: ArrayLike, spin: ArrayLike, until: ArrayLike = np.inf, *,
    events: int = 0, threads: int = 0, jaws: bool = False, most: int = MAX_EVENTS, clusters: bool = True,
) -> Result:  # fmt: skip
    """Play many shots of one number of balls to rest, or until a time.

    Args:
        model: table, ball and effects; parameters are numbers or (n,) arrays.
        position: (n, nball, 2) [m].
        velocity: (n, nball, 2) [m/s], of the struck ball, number 0, as commanded.
        spin: (n, nball, 3) [rad/s].
        until: one time or (n,) [s].
        events: how many impacts and pots of a shot to log.
        threads: at most; 0 for all. The result does not depend on it, to the last bit.
        jaws: whether pockets have jaws and an edge; without, a mouth takes what comes into it.
        most: events (changes of motion too) after which a shot is given up. Below the default that is no error: its
            time is nan, and its balls are as they were then.
        clusters: whether several bodies that touch at once go through springs, or are taken two by two.

    Raises:
        ValueError: for shapes and numbers that do not fit, and for a model that the engine does not play.
        RuntimeError: for a shot that never ends.
    """
    p, v, w = (np.asarray(x, float) for x in (position, velocity, spin))
    n, nball = p.shape[:2]
    for name, value, size in (("position", p, 2), ("velocity", v, 2), ("spin", w, 3)):
        if value.shape != (n, nball, size):
            raise ValueError(f"{name} has shape {value.shape}; {n} shots of {nball} balls need {(n, nball, size)}")
        if not np.isfinite(value).all():
            raise ValueError(f"{name} holds {value[~np.isfinite(value)][0]}; give finite numbers")
    game = lay_out(model, n, jaws)
    end = np.broadcast_to(np.asarray(until, float), (n,)).copy()
    if np.isinf(end).any() and not (game.cloth[:, :2] > 0).all():
        raise ValueError(f"friction {game.cloth[:, :2].min()} of sliding or rolling: without any give a finite end")
    start = np.concatenate([p, v, w, np.zeros((n, nball, 1))], axis=2)
    stays, struck = np.zeros((n, nball), np.bool_), np.ones(n, np.bool_)
    session, times = np.zeros((n, SESSION_FIELDS)), np.zeros((n, 0))
    shots = ShotRows(start, stays, struck, session, end, times)
    return run(game, shots, events, threads, most, clusters)[0]


def play(
    model: Model, shots: Sequence[Shot], *, threads: int = 0, jaws: bool = False, clusters: bool = True
) -> list[Track]:
    """A track for every shot, in order; all shots of one number of balls go together."""
    tracks: list[Track | None] = [None] * len(shots)
    sizes = np.array([len(s.names) for s in shots], int)
    for size in np.unique(sizes):
        part = np.flatnonzero(sizes == size)
        some = [shots[int(k)] for k in part]
        own = model.select(part)
        game = lay_out(own, len(some), jaws)
        start = np.zeros((len(some), size, ROW_SIZE))
        times = np.full((len(some), max(len(s.times) for s in some)), np.inf)
        start[:, :, :2], start[:, :, 2:4] = [s.position for s in some], [s.velocity for s in some]
        start[:, :, 4:7] = [s.spin for s in some]
        for k, shot in enumerate(some):
            times[k, : len(shot.times)] = shot.times
        stays = np.array([[name in s.staying for name in s.names] for s in some])
        struck, session = np.array([s.struck for s in some]), np.array([s.session.row for s in some])
        end = np.array([s.times[-1] if len(s.times) else 0.0 for s in some])
        room = LOG_ROOM
        while True:
            rows = ShotRows(start.copy(), stays, struck, session, end, times)
            result, out = run(game, rows, room, threads, MAX_EVENTS, clusters)
            most = int(result.counts[:, :3].sum(axis=1).max(initial=0))
            if most <= room:
                break
            room = most
        over_threads(functools.partial(_tracks, tracks, part, some, out, result), len(some), threads)
    return [t for t in tracks if t is not None]


def _tracks(
    tracks: list[Track | None], part: NDArray[np.int64], shots: Sequence[Shot], out: Array, result: Result, first: int,
    last: int,
) -> None:  # fmt: skip
    """Put the tracks of some shots, first to last, where `part` says; what is copied is copied by many threads."""
    for k in range(first, last):
        tracks[int(part[k])] = _track(shots[k], out[k], result.event_time[k], result.event[k], result.position[k])


def _track(shot: Shot, out: Array, when: Array, who: NDArray[np.int64], last: Array) -> Track:
    data, names = out[: len(shot.times)].copy(), shot.names  # no part of what is laid out for the longest shot
    happened, count = [], int(np.count_nonzero(who[:, 0] >= 0))
    for t, (kind, i, j) in zip(when[:count].tolist(), who[:count].tolist(), strict=True):
        balls = (names[i], names[j]) if kind == BALL else (names[i],)
        rail = rail_of(j) if kind not in (BALL, POCKET) else ""
        place = (float(last[i, 0]), float(last[i, 1])) if kind == POCKET else None
        happened.append(Event(t, EVENT_KINDS[kind], balls, rail, place))
    return Track(
        names, shot.times, data[..., :2], data[..., 2:4], data[..., 4:7], data[..., 7], tuple(happened)
    )  # fmt: skip
