"""Unknown functions that a fit may lack: of every quantity, over what its hook sees of balls, impacts and sessions.

In: what the clips have seen of each variable, and a formula. Out: `Block`s: free forms (models/free_form.py) to score,
with the shapes that each may turn out to be.

A quantity may depend on one variable, on two of which one is known to matter, or on one in proportion to another: what
an effect of the latter does may drift over a session. A function is a Gaussian process of unknown size and smoothness.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from models import formula as doors
from models.free_form import (
    ALONE,
    LINE,
    MAX_COEFFICIENTS,
    PERIODIC,
    SPLINE,
    SPLINE_REACH,
    STEPS,
    Axis,
    FreeForm,
    free_form,
)
from models.variables import SESSION_VARIABLES, VARIABLES
from sysid.clips import Clip
from sysid.estimation.problem import Array
from sysid.selection.formulas import families
from sysid.selection.formulas.factors import SEEN_BY
from sysid.selection.formulas.terms import (
    COEFFICIENT_WIDTHS,
    COUNTED_VARIABLES,
    DRIFT_VARIABLES,
    RAIL_NAMES,
    Shape,
    step,
    straight,
)
from sysid.selection.scoring.signatures import Candidate, candidate

MAX_PLACES = 40  # of a step between clips
INTERVALS, TURNS = 5, 8  # of splines over a range, over a full turn
FINE_INTERVALS = 24  # of the splines of what a formula already depends on
SHORTEST = 1.25  # length over which a function varies, at least, between the nodes of its splines
WITHIN_CLIPS = ("x", "y", "time")  # what runs through a range in every clip: others may stand for a clip's own law
FASTEST_QUANTILE = 0.95  # of the speeds of a track between frames, which beyond it may be outliers


@dataclass(frozen=True)
class Block:
    """A quantity as an unknown function of what its hook sees."""

    quantity: str
    variables: tuple[str, ...]  # one or two
    axes: tuple[Axis, Axis]
    known: tuple[Shape, ...] = ()  # of the first variable, beside which the second is sought

    @property
    def name(self) -> str:
        """Of the effect."""
        return "_".join(("free", self.quantity, "by", ("_times_" if self.is_drift else "_").join(self.variables)))

    @property
    def is_drift(self) -> bool:
        """Whether it is in proportion to its second variable, and how steep it is an unknown function of the first."""
        return self.axes[1].kind == LINE

    @property
    def width(self) -> float:
        """Size that the quantity may change by."""
        return COEFFICIENT_WIDTHS[self.quantity]

    def effect(self, name: str | None = None) -> type[FreeForm]:
        """Its class of effects, of its name or another."""
        return free_form(name or self.name, 1 + doors.TERM_HOOKS.index(self.quantity), *self.axes, 4 * self.width)

    def shapes(self, seen: Mapping[str, Span]) -> list[list[Shape]]:
        """Families of terms that it may be, over the ranges of what was seen."""
        variable, axis = self.variables[0], self.axes[0]
        if self.known:
            one, other = self.variables
            found = [family for shape in self.known for family in families.shapes_beyond(shape, other, *seen[other])]
            if one in seen:
                found += families.shapes_beyond(tuple(straight(self.quantity, other, 0)), one, *seen[one])
                line = any(term.factor == one for shape in self.known for term in shape)
                found += families.shapes_times(self.quantity, other, one, *seen[other][:2], beside=line)
                found += families.shapes_times(self.quantity, one, other, *seen[one][:2])
            return found
        if self.is_drift:
            one, other = self.variables
            return families.shapes_of_drift(self.quantity, other, one, seen[other][:2], *seen[one])
        if len(self.variables) > 1:
            over = self.variables[1]
            return families.shapes_at_one(self.quantity, variable, axis.count, over, *seen.get(over, AROUND))
        if axis.kind == STEPS:
            return families.counted_shapes(self.quantity, variable, axis.count)
        span = seen.get(variable, AROUND)
        fine = axis.kind == SPLINE and axis.intervals == FINE_INTERVALS  # it resolves a small part of its range
        local = families.local_curves(self.quantity, variable, span.low, span.high) if fine else []
        return [*families.shapes(self.quantity, variable, *span), *local]

    def correlations(self) -> list[Array]:
        """Of its coefficients (k, k), for each smoothness."""
        parts = [1.0]  # lengths over which it varies, of its range: halves, as far as its splines resolve them
        if any(axis.kind != STEPS for axis in self.axes):
            finest = SHORTEST / max(axis.intervals for axis in self.axes if axis.kind != STEPS)
            while parts[-1] / 2 >= finest:
                parts.append(parts[-1] / 2)
        found = [np.asarray(np.kron(*(_correlation(axis, part) for axis in self.axes)), float) for part in parts]
        return [_centred(one) for one in found] if self.is_drift else found


def _centred(covariance: Array) -> Array:
    """Of coefficients (k, k) without what is alike in all: in proportion to a variable alone is another function."""
    return np.asarray(covariance - covariance.mean(axis=0) - covariance.mean(axis=1)[:, None] + covariance.mean())


def _correlation(axis: Axis, part: float) -> Array:
    """Of the coefficients of an axis: squared exponential, round for a heading; steps are independent."""
    away = axis.step * np.abs(np.subtract.outer(np.arange(axis.count), np.arange(axis.count)))
    if axis.kind in (STEPS, LINE):
        return np.eye(axis.count)
    if axis.kind == PERIODIC:
        return np.asarray(np.exp(-0.5 * (2 * np.sin(away / 2) / (2 * np.pi * part)) ** 2))
    return np.asarray(np.exp(-0.5 * (away / (part * axis.step * axis.intervals)) ** 2))


class Span(NamedTuple):
    """What clips have seen of a variable."""

    low: float
    high: float
    places: tuple[float, ...] | None = None  # of steps, between values that clips have; None where each has many


AROUND = Span(-math.pi, math.pi)  # of a heading


def ranges(clips: Sequence[Clip], length: float, width: float, radius: float) -> dict[str, Span]:
    """What clips have seen of every variable."""
    tracks = [ball for clip in clips for ball in clip.balls.values() if len(ball.time) > 1]
    speeds = [np.hypot(*np.diff(ball.xy, axis=0).T) / np.diff(ball.time) for ball in tracks]
    speed = max(float(np.nanquantile(one, FASTEST_QUANTILE)) for one in speeds)
    duration = max(float(ball.time[-1]) for ball in tracks)
    half = max(length, width) / 2
    found = {
        "x": (-length / 2, length / 2), "y": (-width / 2, width / 2), "speed": (0.0, speed), "slip": (0.0, speed),
        "wz": (-speed / radius, speed / radius), "time": (0.0, duration), "along": (-half, half),
        "grazing": (0.0, 1.0), "approach": (0.0, speed),
    }  # fmt: skip
    return {name: Span(*span) for name, span in found.items()} | _ranges_of_sessions(clips)


def _ranges_of_sessions(clips: Sequence[Clip]) -> dict[str, Span]:
    """Of what differs from one clip to another; not of tables and players."""
    found = {}
    for name in SESSION_VARIABLES:
        values = sorted(float(getattr(clip.session, name)) for clip in clips)
        if name not in COUNTED_VARIABLES and values[-1] > values[0]:
            # Two clips at least on either side: one alone may depart for any reason.
            between = [(a + b) / 2 for a, b in itertools.pairwise(values[1:-1]) if b > a]
            few = between[:: math.ceil(len(between) / MAX_PLACES) or 1]
            found[name] = Span(values[0], values[-1], tuple(few))
    return found


def counts_of(clips: Sequence[Clip]) -> dict[str, int]:
    """How many rails, balls, tables and players a variable counts; none where there is but one."""
    counts = {"rail": len(RAIL_NAMES), "number": max(len(clip.balls) for clip in clips)}
    for name in ("table", "player"):
        values = {int(getattr(clip.session, name)) for clip in clips}
        counts[name] = max(values) + 1 if len(values) > 1 else 0
    return {name: count if count > 1 else 0 for name, count in counts.items()}


def blocks(
    seen: Mapping[str, Span], counted: dict[str, int], formula: Sequence[Shape] = (), *, joint: bool = False
) -> list[Block]:
    """All of one variable, and of those that a quantity may depend on together.

    Each rail is a body of its own, which may depend on anything. What is known to depend on a variable may do so for a
    single ball, table or player, or on one side of a value of another variable alone: other functions of two variables
    are sought if one of the two is known to matter.

    Args:
        seen: ranges of the variables.
        counted: numbers of what is counted.
        formula: shapes that a fit has; what these leave may vary over less.
        joint: whether every variable may matter for a single ball, table or player as well.
    """
    axes = {name: Axis.over(name, span.low, span.high, INTERVALS) for name, span in seen.items()}
    fine = {name: Axis.over(name, span.low, span.high, FINE_INTERVALS) for name, span in seen.items()}
    axes |= {name: Axis.counted(name, count) for name, count in counted.items() if count > 1}
    axes["heading"] = Axis.around("heading", TURNS)
    lines = {
        name: Axis.along(name, max(abs(seen[name].low), abs(seen[name].high))) for name in WITHIN_CLIPS if name in seen
    }
    plain = _without_conditions(formula)
    known = {(shape[0].quantity, shape[0].variable) for shape in plain}
    found = []
    for quantity, its in SEEN_BY.items():
        for name in its:
            if name in axes:
                axis = fine[name] if (quantity, name) in known and name in fine else axes[name]
                found.append(Block(quantity, (name,), (axis, ALONE)))
        at_one = [name for name in its if name in axes and name in COUNTED_VARIABLES]
        for pair in itertools.product(at_one, [name for name in its if name in axes and name not in COUNTED_VARIABLES]):
            few = math.prod(axes[name].count for name in pair) <= MAX_COEFFICIENTS
            beside = any((quantity, name) in known for name in pair)
            if (pair[0] == "rail" or joint or beside) and few:
                found.append(Block(quantity, pair, (axes[pair[0]], axes[pair[1]])))
        drifts = [] if _of_impacts(quantity) else [name for name in its if name in DRIFT_VARIABLES and name in seen]
        for pair in itertools.product(drifts, [name for name in its if name in lines]):
            found.append(Block(quantity, pair, (axes[pair[0]], lines[pair[1]])))
        for name in [name for name in its if (quantity, name) in known and name not in COUNTED_VARIABLES]:
            own = tuple(shape for shape in plain if (shape[0].quantity, shape[0].variable) == (quantity, name))
            for other in [other for other in its if other in seen and other != name]:
                found.append(Block(quantity, (name, other), (_coarse(name, seen), _coarse(other, seen)), own))
    return found


def _of_impacts(quantity: str) -> bool:
    return 1 + doors.TERM_HOOKS.index(quantity) in doors.IMPACTS


def _without_conditions(formula: Sequence[Shape]) -> list[Shape]:
    """Shapes without their conditions, and a step where such a condition begins."""
    found = list[Shape]()
    for shape in formula:
        found.append(tuple(term.everywhere for term in shape))
        only = shape[0].only
        if only is not None and only.side != 0.0:
            at = step(shape[0].quantity, VARIABLES[only.variable], only.which)
            found.append((dataclasses.replace(at, limits=shape[0].only_limits),))
    return list({tuple(term.name for term in shape): shape for shape in found}.values())


def _coarse(name: str, seen: Mapping[str, Span]) -> Axis:
    """The axis of one of two variables, neither of which is counted, with all coefficients that a free form has."""
    each = math.isqrt(MAX_COEFFICIENTS)
    if name == "heading":
        return Axis.around(name, MAX_COEFFICIENTS // each)
    return Axis.over(name, seen[name].low, seen[name].high, each - SPLINE_REACH)


def free_candidates(free: Sequence[Block]) -> list[Candidate]:
    """Each block as a candidate."""
    return [candidate(block.effect()) for block in free]
