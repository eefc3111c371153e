"""Variables that residuals may depend on, and their groups with descriptions.

In: samples, or values with edges. Out: a `Variable`: the group of every sample, with a description of each group.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from models.shot import RAIL_NAMES, Table
from sysid.residuals.samples import Array, Samples

Index = NDArray[np.int64]
Group = NDArray[np.int8]  # few groups, many samples, many variables

SPEED_EDGES_M_S = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, np.inf)
SIDESPIN_EDGES_RAD_S = (-np.inf, -20.0, -5.0, 5.0, 20.0, np.inf)
SLIP_EDGES_M_S = (0.0, 0.5, 1.0, 2.0, np.inf)
TIME_EDGES_S = (0.0, 0.5, 1.0, 2.0, 4.0, np.inf)
SINCE_EVENT_EDGES_S = (0.0, 0.25, 0.5, 1.0, 2.0, np.inf)
APPROACH_EDGES_M_S = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, np.inf)
ANGLE_EDGES_DEG = (0.0, 20.0, 45.0, 90.0)  # from the normal
TABLE_CELLS = (6, 3)  # along and across the table
TABLE_HEADINGS = ("+x", "+x +y", "+y", "-x +y", "-x", "-x -y", "-y", "+x -y")
MIN_CLIPS_FOR_ORDER = 6  # fewest clips whose thirds are compared


@dataclass(frozen=True)
class Variable:
    """A variable cut into groups."""

    name: str
    words: tuple[str, ...]  # description of each group
    group: Group  # (n,) index of each sample's group, -1 for none
    middle: Array  # middle of each group, for drawing; NaN if it is meaningless
    unit: str = ""


def variables(samples: Samples, table: Table, clips: int) -> tuple[Variable, ...]:
    """Variables that the residuals of moving balls may depend on."""
    s = samples
    octant = np.round(s.heading / (np.pi / 4)).astype(np.int8) % 8
    found = [
        Variable("everywhere", ("",), np.zeros(len(s.time), dtype=np.int8), np.full(1, np.nan)),
        Variable("heading", tuple(f"heading {h}" for h in TABLE_HEADINGS), octant,
                 np.linspace(0.0, 315.0, 8), "degrees"),
        cut("speed", s.speed, SPEED_EDGES_M_S, "at {} m/s", "m/s"),
        cut("sidespin", s.spin, SIDESPIN_EDGES_RAD_S, "with sidespin {} rad/s", "rad/s"),
        cut("slip", s.slip, SLIP_EDGES_M_S, "slipping at {} m/s", "m/s"),
        cut("time", s.time, TIME_EDGES_S, "{} s after the clip's start", "s"),
        cut("time since event", s.since, SINCE_EVENT_EDGES_S, "{} s after the event before", "s"),
        place(s.xy, table),
        chosen("ball", ("the struck ball", "another ball"), np.where(s.struck, 0, 1)),
        chosen("event before", ("after the strike", "after a ball", "after a cushion"),
               _index(s.last, ("strike", "ball", "cushion"))),
        chosen("rail before", tuple(f"after rail {r}" for r in RAIL_NAMES), _index(s.rail, RAIL_NAMES)),
    ]  # fmt: skip
    return (*found, *order(s.clip, clips))


def cut(name: str, values: Array, edges: Sequence[float], words: str, unit: str) -> Variable:
    """A variable with groups between edges."""
    group = np.clip(np.searchsorted(edges, np.nan_to_num(values), side="right") - 1, 0, len(edges) - 2)
    ends = np.array(edges)
    middle = np.where(np.isinf(ends[1:]), ends[:-1] * 1.25, np.where(np.isinf(ends[:-1]), ends[1:] * 1.25, 0.0))
    inner = np.isfinite(ends[1:]) & np.isfinite(ends[:-1])
    middle[inner] = (0.5 * (ends[1:] + ends[:-1]))[inner]
    named = tuple(words.format(span(edges, k)) for k in range(len(edges) - 1))
    return Variable(name, named, group.astype(np.int8), middle, unit)


def chosen(name: str, words: tuple[str, ...], group: NDArray[np.int_]) -> Variable:
    """A variable with named groups."""
    return Variable(name, words, group.astype(np.int8), np.full(len(words), np.nan))


def place(xy: Array, table: Table) -> Variable:
    """A variable with the cells of the table as groups."""
    size = np.array([table.length, table.width])
    cells = np.array(TABLE_CELLS)
    at = np.clip(((xy / size + 0.5) * cells).astype(np.int64), 0, cells - 1)
    words = []
    for i in range(TABLE_CELLS[0]):
        for j in range(TABLE_CELLS[1]):
            low, high = (np.array([i, j]) / cells - 0.5) * size, (np.array([i + 1, j + 1]) / cells - 0.5) * size
            words.append(f"at x {low[0]:.2f} to {high[0]:.2f} m, y {low[1]:.2f} to {high[1]:.2f} m")
    group = at[:, 0] * TABLE_CELLS[1] + at[:, 1]
    return Variable("place", tuple(words), group.astype(np.int8), np.full(len(words), np.nan))


def order(clip: Index, clips: int) -> list[Variable]:
    """A variable with thirds of the clips, in order; empty for few clips."""
    if clips < MIN_CLIPS_FOR_ORDER:
        return []
    edges = [round(clips * k / 3) for k in range(4)]
    words = tuple(f"in clips {a + 1} to {b}" for a, b in pairwise(edges))
    group = np.clip(np.searchsorted(edges, clip, side="right") - 1, 0, 2)
    middle = np.array([0.5 * (a + b + 1) for a, b in pairwise(edges)])
    return [Variable("clip order", words, group.astype(np.int8), middle, "number of the clip")]


def span(edges: Sequence[float], k: int) -> str:
    """A group's range in words."""
    low, high = edges[k], edges[k + 1]
    if np.isinf(high):
        return f"over {low:g}"
    return f"below {high:g}" if np.isinf(low) else f"{low:g} to {high:g}"


def _index(values: Sequence[str], known: Sequence[str]) -> NDArray[np.int_]:
    place = {v: k for k, v in enumerate(known)}
    return np.array([place.get(v, -1) for v in values], dtype=np.int64)
