"""Random models and shots: constants and effects anywhere within their bounds, balls anywhere that they may lie.

Tables are those that ship, and any others that a file may describe: sizes, balls and pockets within what is allowed.

A batch is shots of one number of balls on one table with the same effects; constants, places and strokes differ from
shot to shot.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from models.analytic.pocket import pockets_of
from models.effect import Effect
from models.effect_catalogue import catalogue
from models.errors import BadInput
from models.files.decode import Allowed
from models.model_file import Model, full_model
from models.shot import Array, Ball, Session, Shot, Table
from models.table.pocket_shape import SHAPE_BOUNDS, read_pockets
from models.table.presets import TABLE_SETS

MAX_BALLS, MAX_EFFECTS = 22, 4
MAX_SPEED, MAX_SPIN = 10.0, 250.0  # of a struck ball [m/s], [rad/s]
LAST_TIME_S, SAMPLE_STEP_S = 12.0, 0.03
GAPS_M = (0.0, 1e-12, 1e-9, 1e-7, 1e-5, 5e-4)  # between balls that were laid against each other
LAYOUTS = ("spread", "rack", "row", "rail", "jammed")
AT_BOUND_SHARE = 0.15  # of the values, those that lie at a bound
SLOW_SHARE = 0.15  # of the shots, those with a push instead of a stroke
MOST_TRIES = 400
LATER = ("cushion_contact_time",)  # effects that came after shots were noted by seed and row
LATER_SHARE = 0.2  # of the batches, that have one of them beside the others
OTHER_TABLES_SHARE = 0.3  # of the batches, on tables that do not ship
FILLED_SHARE = 0.3  # of such a cloth, that balls cover at most


@dataclass(frozen=True)
class Batch:
    """Shots that are played together."""

    seed: int
    layout: str
    jaws: bool
    model: Model  # constants are (n,) arrays
    shots: list[Shot]


def physical() -> dict[str, type[Effect]]:
    """The effects that act on the table, by name; the camera's do not."""
    kinds = catalogue()
    return {
        name: kind for name, kind in kinds.items()
        if not kind.slot and kind.opens("forces", "horizon", "impact", "strike")
    }  # fmt: skip


def values(kind: type[Effect], n: int, rng: np.random.Generator) -> dict[str, Any]:
    """Every parameter of an effect anywhere within its bounds, some at them: (n,) each."""
    found = {}
    for key, meta in kind.parameters().items():
        low, high = meta["bounds"]
        at = rng.uniform(low, high, n)
        edge = np.where(rng.random(n) < 0.5, low, high)
        found[key] = np.where(rng.random(n) < AT_BOUND_SHARE, edge, at)
    return found


def allowed(kind: type, key: str) -> Allowed:
    """What a file may say of a field of Table or Ball."""
    [found] = [a for a in get_type_hints(kind, include_extras=True)[key].__metadata__ if isinstance(a, Allowed)]
    return found


def other_table(rng: np.random.Generator) -> tuple[Table, Ball]:
    """Any table and ball that a file may describe."""

    def size(kind: type, key: str) -> float:
        one = allowed(kind, key)
        low, high = float(one.low), float(one.high)
        return float(np.clip(np.exp(rng.uniform(np.log(low), np.log(high))), low, high))

    pockets: Any = bool(rng.random() < 0.5)
    if rng.random() < 0.5:
        pockets = {
            which: {key: float(rng.uniform(low, high)) for key, (_, low, high) in SHAPE_BOUNDS.items()}
            for which in ("corner", "middle")
        }
    table = Table(size(Table, "length"), size(Table, "width"), read_pockets(pockets))
    return table, Ball(size(Ball, "diameter"), size(Ball, "mass"))


def has_jaws(table: Table, ball: Ball) -> bool:
    """Whether a table has pockets whose jaws can be played with a ball; others are refused in a line."""
    try:
        return len(pockets_of(table, ball).jaws) > 0
    except BadInput:
        return False


def batch(seed: int, n: int, later: Sequence[str] = LATER, others: float = OTHER_TABLES_SHARE) -> Batch:
    """The batch of a seed, of n shots; without `later` effects and `others` of tables it is as it was before them."""
    rng = np.random.default_rng([seed, 22])
    shipped = list(TABLE_SETS.values())[rng.integers(len(TABLE_SETS))]
    which = (shipped.table, shipped.ball)
    balls = int(rng.choice([1, 2, 3, 4, 6, 10, 16, MAX_BALLS]))
    tables = np.random.default_rng([seed, 24])
    if tables.random() < others:
        which = other_table(tables)
        room = 4 * np.prod(which[0].centre_limits(which[1])) / which[1].diameter ** 2
        balls = min(balls, max(int(FILLED_SHARE * room), 1))
    layout = LAYOUTS[rng.integers(len(LAYOUTS))]
    kinds = physical()
    chosen = rng.choice(sorted(set(kinds) - set(LATER)), int(rng.integers(0, MAX_EFFECTS + 1)), replace=False)
    model = full_model(*which)
    model = dataclasses.replace(model, effects=tuple(type(e)(**values(type(e), n, rng)) for e in model.effects))
    for name in chosen:
        model = model.add(kinds[str(name)](**values(kinds[str(name)], n, rng)))
    jaws = bool(which[0].pockets) and bool(rng.random() < 0.5) and has_jaws(*which)
    more = np.random.default_rng([seed, 23])
    for name in later:
        if more.random() < LATER_SHARE:
            model = model.add(kinds[name](**values(kinds[name], n, more)))
    return Batch(seed, layout, jaws, model, [shot(*which, layout, balls, rng) for _ in range(n)])


def shot(table: Table, ball: Ball, layout: str, balls: int, rng: np.random.Generator) -> Shot:
    """One shot: the struck ball, which is the first, goes for another one or anywhere."""
    places = laid(table, ball, layout, balls, rng)
    v, w = np.zeros((balls, 2)), np.zeros((balls, 3))
    slow = rng.random() < SLOW_SHARE
    speed = rng.uniform(0.0, 0.05) if slow else rng.uniform(0.05, MAX_SPEED)
    heading = rng.uniform(-np.pi, np.pi)
    if balls > 1 and rng.random() < 0.8:
        to = places[int(rng.integers(1, balls))] - places[0]
        off = rng.uniform(-1, 1) * ball.diameter / max(float(np.hypot(*to)), ball.diameter)
        heading = float(np.arctan2(to[1], to[0])) + float(np.arcsin(np.clip(off, -1, 1)))
    v[0] = speed * np.array([np.cos(heading), np.sin(heading)])
    w[0] = rng.uniform(-1, 1, 3) * rng.choice([0.0, 20.0, 80.0, MAX_SPIN])
    if rng.random() < 0.3:  # it rolls
        w[0, :2] = [-v[0, 1] / ball.radius, v[0, 0] / ball.radius]
    order = rng.permutation(balls)
    order = np.concatenate([[0], order[order != 0]]).astype(int)
    return Shot(
        tuple(f"ball {k}" for k in range(balls)), places[order], v, w, np.arange(0.0, LAST_TIME_S, SAMPLE_STEP_S),
        session=Session(float(rng.random())),
    )  # fmt: skip


def laid(table: Table, ball: Ball, layout: str, balls: int, rng: np.random.Generator) -> Array:
    """Places of balls (n, 2) [m] that neither overlap nor stand in a cushion, the struck one first."""
    limits, d = table.centre_limits(ball), ball.diameter
    step = d + float(rng.choice(GAPS_M))
    jitter = 0.0 if rng.random() < 0.5 else 1e-9
    if layout == "rack":
        pattern = np.array([(r * np.sqrt(0.75), k - r / 2) for r in range(7) for k in range(r + 1)])[: balls - 1]
    elif layout == "row":
        pattern = np.array([(float(k), 0.0) for k in range(balls - 1)])
    elif layout == "jammed":  # square packing: contacts that a break loads all at once
        side = int(np.ceil(np.sqrt(max(balls - 1, 1))))
        pattern = np.array([(float(k // side), float(k % side)) for k in range(balls - 1)])
    else:
        pattern = np.zeros((0, 2))
    found: list[Array] = []
    turn = float(rng.choice([0.0, np.pi / 2, rng.uniform(-np.pi, np.pi)]))
    m = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    group = step * (1 + 1e-15) * pattern.reshape(-1, 2) @ m.T
    if len(group):
        room = limits - np.abs(group).max(axis=0)
        if (room > 0).all():
            group = group + rng.uniform(-room, room)
            if rng.random() < 0.3:  # against a cushion
                k, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
                group[:, k] += sign * (limits[k] - float((sign * group[:, k]).max()))
            found = list(group + rng.uniform(-jitter, jitter, group.shape))
    if layout == "rail":  # frozen to cushions, or nearly
        for _ in range(balls - 1):
            k, sign = int(rng.integers(2)), float(rng.choice([-1.0, 1.0]))
            p = rng.uniform(-limits, limits)
            p[k] = sign * (limits[k] - float(rng.choice(GAPS_M)))
            if is_free(p, found, d):
                found.append(p)
    found = [p for k, p in enumerate(found) if (np.abs(p) <= limits).all() and is_free(p, found[:k], d)][: balls - 1]
    for _ in range(MOST_TRIES * balls):
        if len(found) == balls:
            break
        p = rng.uniform(-limits, limits)
        if len(found) == balls - 1 and found and rng.random() < 0.15:  # the struck ball lies against another
            angle = rng.uniform(-np.pi, np.pi)
            p = found[int(rng.integers(len(found)))] + d * (1 + 1e-15) * np.array([np.cos(angle), np.sin(angle)])
        if (np.abs(p) <= limits).all() and is_free(p, found, d):
            found.append(p)
    if len(found) < balls:
        raise RuntimeError(f"no room for {balls} balls of {d} m on {table}")
    return np.array(found[::-1])


def is_free(p: Array, others: list[Array], diameter: float) -> bool:
    """Whether a ball at p (2,) overlaps none of the others."""
    return all(float(np.hypot(*(p - q))) >= diameter for q in others)


def picked(one: Batch, index: NDArray[np.int64]) -> Batch:
    """Some shots of a batch."""
    return dataclasses.replace(one, model=one.model.select(index), shots=[one.shots[int(k)] for k in index])
