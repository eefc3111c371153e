"""A free form: one quantity as an unknown smooth function of one or two variables, where no law is known.

The function is a tensor product of uniform cubic B-splines, periodic ones for a heading, of steps for what is counted
(rails, balls), and of a variable itself: linear in its coefficients, so that a fit knows its derivatives by one probe
each. Outside its range it goes on as at the end. The hooks are compiled once; which quantity and variables they read
stands, with the splines, in the effect's row of parameters behind the coefficients (compare models/formula.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, make_dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np

from models.compiled import compiled
from models.effect import Array, BallState, Effect, ImageState, ImpactState, param
from models.formula import CLOCK, CUSHION_MU, DRAG, HOOK_RANGES, IMAGE_X, IMPACTS, SIDE, change, is_met, push, shift
from models.hooks import Layout
from models.variables import NONE, VARIABLES, of_ball, of_image, of_impact

MAX_COEFFICIENTS = 32
STEPS, SPLINE, PERIODIC, LINE = range(4)  # kinds of axes
SPLINE_REACH = 3  # number of coefficients of a spline beyond its intervals
AXIS_FIELDS = ("variable", "low", "step", "count", "kind")
LAYOUT: Layout = (
    ("coefficients", MAX_COEFFICIENTS), "door", *(f"{field}_{number}" for number in (1, 2) for field in AXIS_FIELDS),
)  # fmt: skip


@dataclass(frozen=True)
class Axis:
    """A variable of a free form, and the pieces of its splines or steps."""

    variable: int
    low: float
    step: float  # between nodes
    count: int  # of coefficients
    kind: int

    @classmethod
    def over(cls, variable: str, low: float, high: float, intervals: int) -> Axis:
        """Splines of a variable over a range."""
        step = (high - low) / intervals
        return cls(VARIABLES.index(variable), low, step, intervals + SPLINE_REACH, SPLINE)

    @classmethod
    def around(cls, variable: str, intervals: int) -> Axis:
        """Splines over a full turn."""
        return cls(VARIABLES.index(variable), -math.pi, 2 * math.pi / intervals, intervals, PERIODIC)

    @classmethod
    def counted(cls, variable: str, count: int) -> Axis:
        """A step for each of so many rails or balls."""
        return cls(VARIABLES.index(variable), 0.0, 1.0, count, STEPS)

    @classmethod
    def along(cls, variable: str, unit: float) -> Axis:
        """A line through 0, which is 1 at one unit: the function is in proportion to the variable."""
        return cls(VARIABLES.index(variable), 0.0, unit, 1, LINE)

    @property
    def intervals(self) -> int:
        """Between its nodes."""
        return self.count - SPLINE_REACH if self.kind == SPLINE else self.count

    def weights(self, values: Array) -> Array:
        """Weights (n, count) of the coefficients at values (n,) of the variable."""
        out = np.zeros((len(values), self.count))
        for row, value in zip(out, values.tolist(), strict=True):
            first, *parts = _weights(value, self.low, self.step, float(self.count), float(self.kind))
            for k, part in enumerate(parts):
                row[(first + k) % self.count] += part
        return out


ALONE = Axis(NONE, 0.0, 1.0, 1, STEPS)  # second axis of a function of one variable


@compiled
def _weights(
    value: float, low: float, step: float, count: float, kind: float
) -> tuple[int, float, float, float, float]:
    """The first of four coefficients that count at a value, and their weights."""
    at = (value - low) / step
    if kind == LINE:
        return 0, at, 0.0, 0.0, 0.0
    if kind == STEPS:
        return min(max(math.floor(at + 0.5), 0), int(count) - 1), 1.0, 0.0, 0.0, 0.0
    if kind == PERIODIC:
        at -= count * math.floor(at / count)
    else:
        at = min(max(at, 0.0), count - SPLINE_REACH)
    first = math.floor(at)
    if kind == SPLINE:
        first = min(first, int(count) - SPLINE_REACH - 1)
    f = at - first
    g = 1.0 - f
    return (
        first, g * g * g / 6.0, (3.0 * f * f * f - 6.0 * f * f + 4.0) / 6.0,
        (3.0 * g * g * g - 6.0 * g * g + 4.0) / 6.0, f * f * f / 6.0,
    )  # fmt: skip


@compiled
def _surface(own: Any, one: float, two: float) -> float:
    """The function at values of its variables."""
    i, a0, a1, a2, a3 = _weights(one, own.low_1, own.step_1, own.count_1, own.kind_1)
    j, b0, b1, b2, b3 = _weights(two, own.low_2, own.step_2, own.count_2, own.kind_2)
    a, b, c = (a0, a1, a2, a3), (b0, b1, b2, b3), own.coefficients
    rows, columns, total = int(own.count_1), int(own.count_2), 0.0
    for p in range(4):
        if a[p] != 0.0:
            for q in range(4):
                if b[q] != 0.0:
                    total += a[p] * b[q] * c[(i + p) % rows * columns + (j + q) % columns]
    return total


@compiled
def _for_ball(own: Any, ball: BallState) -> float:
    return _surface(own, of_ball(own.variable_1, ball), of_ball(own.variable_2, ball))


@compiled
def _for_impact(own: Any, hit: ImpactState) -> float:
    return _surface(own, of_impact(own.variable_1, hit), of_impact(own.variable_2, hit))


@compiled
def _for_image(own: Any, image: ImageState) -> float:
    return _surface(own, of_image(own.variable_1, image), of_image(own.variable_2, image))


@dataclass(frozen=True)
class FreeForm(Effect):
    """Base of all free forms: `free_form` makes one, whose parameters are the coefficients of its function."""

    called: ClassVar[str] = "free_form"
    door: ClassVar[int] = 0
    axes: ClassVar[tuple[Axis, Axis]] = (ALONE, ALONE)

    @classmethod
    def name(cls) -> str:
        """The name given to `free_form`."""
        return cls.called

    @classmethod
    def opens(cls, *hooks: str) -> bool:
        """Whether its quantity is on any of these hooks."""
        return any(cls.door in HOOK_RANGES.get(hook, ()) for hook in hooks)

    @classmethod
    def impacts(cls) -> tuple[str, ...] | None:
        """Kinds of impacts at which alone it acts."""
        return None if cls.door not in IMPACTS else ("cushion",) if cls.door <= CUSHION_MU else ("ball",)

    @classmethod
    def layout(cls) -> Layout:
        """The same for every free form, so that all share the compiled hooks."""
        return LAYOUT

    def row(self, count: int) -> Array:
        """Coefficients, then the quantity's code and the axes: (count, k)."""
        out = np.zeros((count, MAX_COEFFICIENTS + len(LAYOUT) - 1))
        for k, key in enumerate(self.parameters()):
            out[:, k] = getattr(self, key)
        numbers = [getattr(axis, field) for axis in self.axes for field in AXIS_FIELDS]
        out[:, MAX_COEFFICIENTS:] = (self.door, *numbers)
        return out

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Pickle what makes the class, and the coefficients."""
        width = max(abs(v) for v in next(iter(self.parameters().values()))["bounds"])
        return _remade, (self.called, self.door, self.axes, width, tuple(getattr(self, k) for k in self.parameters()))

    def forces(self, ball: BallState) -> None:
        """Add the function to the forces on a ball on the cloth."""
        if DRAG <= self.door <= SIDE:
            push(self.door, _for_ball(self, ball), ball)

    def impact(self, hit: ImpactState) -> None:
        """Add the function to the law of contacts."""
        if is_met(self.door, hit):
            change(self.door, _for_impact(self, hit), hit)

    def observe(self, image: ImageState) -> None:
        """Add the function to the reported place."""
        if IMAGE_X <= self.door <= CLOCK:
            dx, dy = shift(self.door, _for_image(self, image), image)
            image.x += dx
            image.y += dy


@cache
def free_form(name: str, door: int, one: Axis, two: Axis, width: float) -> type[FreeForm]:
    """The class of free forms of a quantity over these axes, coefficients within +- `width`; the same for the same.

    Raises:
        ValueError: for more coefficients than a row has.
    """
    count = one.count * two.count
    if not 0 < count <= MAX_COEFFICIENTS:
        raise ValueError(f"{name}: {count} coefficients; give 1 to {MAX_COEFFICIENTS}")
    source = "a free form: no law is known"
    fields = [
        (f"c{k}", float, param(0.1 * width, off=0.0, unit="1", bounds=(-width, width), source=source))
        for k in range(count)
    ]
    own = {"__doc__": "A free form on trial.", "__module__": __name__, "called": name, "door": door, "axes": (one, two)}
    title = "".join(word.capitalize() for word in name.split("_"))
    return make_dataclass(title, fields, bases=(FreeForm,), namespace=own, frozen=True)


def _remade(name: str, door: int, axes: tuple[Axis, Axis], width: float, values: tuple[Any, ...]) -> FreeForm:
    return free_form(name, door, *axes, width)(*values)
