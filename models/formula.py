"""A formula for structure outside the catalogue: a few terms as numbers, each a coefficient times a factor on one hook.

A term says by codes what it changes (its door) and by which factor of place, motion, time or impact, with up to four
constants, and may act for one ball, rail, table or player alone, or on one side of a value of any variable. Doors: a
drag on rolling balls along their way, a pull to the left of it (models.hooks.push_along); a push along x or y on a ball
that the cloth carries, 5/7 of it where that rolls; a relative change of the sliding friction, or of how
fast sidespin dies; a change of restitution or friction at cushions or between balls; a shift of the image, or a picture
that is late. The hooks are compiled once and read the terms from the effect's row of parameters: another formula
compiles nothing. Where forces switch at lines and at the edges of cells of the cloth, or bend, `horizon` says when a
ball gets there. Where a step lies, over what a decay falls, and where a term begins to act may be parameters as well. A
curve is a sum of hats, and linear between the places where these lie.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, make_dataclass
from functools import cache
from typing import Any, ClassVar, NamedTuple

import numpy as np

from models.analytic.crossings import NearestLines, nearer, until_bend, until_nearest
from models.analytic.crossings import until_edge as until_edge  # also for files of effects that name them here
from models.analytic.crossings import until_line as until_line
from models.analytic.factors import ABOVE, BEND, BOX, HAT, FactorArguments, TermRow, factor_value
from models.compiled import compiled
from models.effect import (
    MIN_FRICTION_SHARE,
    Array,
    BallState,
    Effect,
    ImageState,
    ImpactState,
    param,
    push_along,
)
from models.hooks import Layout
from models.variables import NONE, X, Y, of_ball, of_image, of_impact

MAX_TERMS = 64
MAX_CONSTANTS = 4

TERM_HOOKS = (
    "drag", "grip", "spin", "push_x", "push_y", "side", "cushion_e", "cushion_mu", "ball_e", "ball_mu",
    "image_x", "image_y", "clock",
)  # fmt: skip
(
    DRAG, GRIP, SPIN, PUSH_X, PUSH_Y, SIDE, CUSHION_E, CUSHION_MU, BALL_E, BALL_MU, IMAGE_X, IMAGE_Y, CLOCK,
) = range(1, 14)  # fmt: skip
CLOTH, IMPACTS, IMAGE = range(DRAG, SIDE + 1), range(CUSHION_E, BALL_MU + 1), range(IMAGE_X, CLOCK + 1)
HOOK_RANGES = {"forces": CLOTH, "impact": IMPACTS, "observe": IMAGE}

TERM_FIELDS = TermRow._fields
TERM_SIZE = len(TERM_FIELDS)
TERM_LAYOUT = (("terms", MAX_TERMS * TERM_SIZE),)


@dataclass(frozen=True)
class MovingPlace:
    """Where a step, a bend or the side of a condition lies, or over what a decay falls, where that is a parameter."""

    name: str
    unit: str
    default: float
    bounds: tuple[float, float]
    field: str = "b"  # of `TermRow`


class Only(NamedTuple):
    """The condition under which a term acts."""

    variable: int = NONE
    which: float = 0.0
    side: float = 0.0  # see `TermRow`


EVERYWHERE = Only()


@dataclass(frozen=True)
class Part:
    """One term of a formula, with what its coefficient's parameter declares."""

    name: str  # of the coefficient
    door: int
    factor: int
    constants: tuple[float, ...]
    unit: str
    default: float
    bounds: tuple[float, float]
    source: str
    places: tuple[MovingPlace, ...] = ()
    only: Only = EVERYWHERE
    times: int = NONE  # code of a variable with which the factor is multiplied

    @property
    def has_line(self) -> bool:
        """Whether it steps, bends or ends at a line of the table."""
        return (self.factor in (ABOVE, BEND) and self.constants[0] in (X, Y)) or self.only.variable in (X, Y)


@compiled
def _term(own: Any, k: int) -> TermRow:
    """The fields of a term; the door of those behind the last is 0."""
    t, n = own.terms, k * TERM_SIZE
    return TermRow(
        t[n],
        t[n + 1],
        t[n + 2],
        t[n + 3],
        t[n + 4],
        t[n + 5],
        t[n + 6],
        t[n + 7],
        t[n + 8],
        t[n + 9],
        t[n + 10],
    )


@compiled
def _acts(term: TermRow, value: float) -> bool:
    """Whether the condition of a term holds at a value of its variable."""
    return value == term.which if term.side == 0.0 else term.side * (value - term.which) > 0.0


@compiled
def push(door: float, value: float, ball: BallState) -> None:
    """Change what acts on a ball on the cloth by a quantity's value."""
    if door == GRIP:
        ball.slide_factor = max(ball.slide_factor * (1.0 + value), MIN_FRICTION_SHARE)
    elif door == SPIN:
        ball.spin_factor = max(ball.spin_factor * (1.0 + value), MIN_FRICTION_SHARE)
    elif door == PUSH_X and ball.weight > 0.0:
        ball.ax += value
    elif door == PUSH_Y and ball.weight > 0.0:
        ball.ay += value
    elif door == DRAG and ball.rolling > 0.0:
        push_along(ball, -value, 0.0)
    elif door == SIDE and ball.rolling > 0.0:
        push_along(ball, 0.0, value)


@compiled
def is_met(door: float, hit: ImpactState) -> bool:
    """Whether a quantity is one of this contact."""
    if hit.cushion > 0.0:
        return CUSHION_E <= door <= CUSHION_MU
    return BALL_E <= door <= BALL_MU


@compiled
def change(door: float, value: float, hit: ImpactState) -> None:
    """Change how a contact goes by a quantity's value."""
    if door in (CUSHION_E, BALL_E):
        hit.restitution += value
    else:
        hit.friction += value


@compiled
def shift(door: float, value: float, image: ImageState) -> tuple[float, float]:
    """By how much a quantity's value moves an image: itself, or the ball for as long as the picture is late."""
    if door == CLOCK:
        return value * image.vx, value * image.vy
    return (value, 0.0) if door == IMAGE_X else (0.0, value)


@compiled
def _of_ball(term: TermRow, ball: BallState) -> float:
    if term.within != NONE and not _acts(term, of_ball(term.within, ball)):
        return 0.0
    v = of_ball(term.a, ball)
    value = factor_value(term, FactorArguments(v, ball.x, ball.y, ball.vx, ball.vy, ball.wz, ball.number, -1.0))
    return value if term.times == NONE else value * of_ball(term.times, ball)


@compiled
def _of_impact(term: TermRow, hit: ImpactState) -> float:
    if term.within != NONE and not _acts(term, of_impact(term.within, hit)):
        return 0.0
    v = of_impact(term.a, hit)
    value = factor_value(term, FactorArguments(v, hit.x, hit.y, hit.vx, hit.vy, hit.wz, hit.first, hit.second))
    return value if term.times == NONE else value * of_impact(term.times, hit)


@compiled
def _of_image(term: TermRow, image: ImageState) -> float:
    if term.within != NONE and not _acts(term, of_image(term.within, image)):
        return 0.0
    v = of_image(term.a, image)
    value = factor_value(term, FactorArguments(v, image.x, image.y, image.vx, image.vy, 0.0, image.number, -1.0))
    return value if term.times == NONE else value * of_image(term.times, image)


@dataclass(frozen=True)
class Formula(Effect):
    """Base of all formulas: `formula` makes one, whose parameters are the coefficients of its terms."""

    called: ClassVar[str] = "formula"
    parts: ClassVar[tuple[Part, ...]] = ()

    @classmethod
    def name(cls) -> str:
        """The name given to `formula`."""
        return cls.called

    @classmethod
    def opens(cls, *hooks: str) -> bool:
        """Whether a term of it is on any of these hooks."""
        cells = any(p.door in CLOTH and (p.factor in (BOX, HAT) or p.has_line) for p in cls.parts)
        return ("horizon" in hooks and cells) or any(
            p.door in HOOK_RANGES.get(hook, ()) for hook in hooks for p in cls.parts
        )

    @classmethod
    def impacts(cls) -> tuple[str, ...] | None:
        """Kinds of impacts at which alone it acts."""
        kinds = {"cushion" if p.door <= CUSHION_MU else "ball" for p in cls.parts}
        return tuple(sorted(kinds)) if all(p.door in IMPACTS for p in cls.parts) else None

    @classmethod
    def layout(cls) -> Layout:
        """The same for every formula, so that all share the compiled hooks."""
        return TERM_LAYOUT

    @classmethod
    def column(cls, key: str) -> int:
        """Where in `row` a coefficient, or a place, stands."""
        columns = {}
        for k, part in enumerate(cls.parts):
            columns[part.name] = k * TERM_SIZE
            columns |= {place.name: k * TERM_SIZE + TERM_FIELDS.index(place.field) for place in part.places}
        return columns[key]

    def row(self, count: int) -> Array:
        """Coefficients, then codes and constants of every term: (count, k)."""
        out = np.zeros((count, MAX_TERMS, TERM_SIZE))
        for k, part in enumerate(self.parts):
            numbers = (part.door, part.factor, *part.constants)
            out[:, k, 0] = getattr(self, part.name)
            out[:, k, 1 : 1 + len(numbers)] = numbers
            out[:, k, TERM_FIELDS.index("within") :] = (*part.only, part.times)
            for place in part.places:
                out[:, k, TERM_FIELDS.index(place.field)] = getattr(self, place.name)
        return out.reshape(count, -1)

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        """Pickle what makes the class, and the values."""
        return _remade, (self.called, self.parts, tuple(getattr(self, key) for key in self.parameters()))

    def forces(self, ball: BallState) -> None:
        """What acts on a ball on the cloth."""
        for k in range(MAX_TERMS):
            term = _term(self, k)
            if term.door == 0.0:
                break
            if DRAG <= term.door <= SIDE:
                push(term.door, term.coefficient * _of_ball(term, ball), ball)

    def horizon(self, ball: BallState) -> float:
        """Until it crosses the edge of a cell, a line, or where a curve bends [s]."""
        nowhere = NearestLines(math.inf, -math.inf)
        left, across_x, across_y = math.inf, nowhere, nowhere
        for k in range(MAX_TERMS):
            _, door, factor, a, b, c, d, within, which, _, _ = _term(self, k)
            if door == 0.0:
                break
            if not DRAG <= door <= SIDE:
                continue
            if within == X:
                across_x = nearer(across_x, which - ball.x)
            elif within == Y:
                across_y = nearer(across_y, which - ball.y)
            if factor == BOX:
                across_x = nearer(nearer(across_x, a - b - ball.x), a + b - ball.x)
                across_y = nearer(nearer(across_y, c - d - ball.y), c + d - ball.y)
            elif factor in (ABOVE, BEND, HAT):
                half = c if factor == HAT else 0.0
                if a == X:
                    across_x = nearer(nearer(nearer(across_x, b - half - ball.x), b - ball.x), b + half - ball.x)
                elif a == Y:
                    across_y = nearer(nearer(nearer(across_y, b - half - ball.y), b - ball.y), b + half - ball.y)
                elif factor == HAT:
                    left = min(left, until_bend(ball, a, b, c))
        if ball.vx * ball.vx + ball.vy * ball.vy > 0.0:
            left = min(left, until_nearest(across_x, ball.vx, ball.ax))
            left = min(left, until_nearest(across_y, ball.vy, ball.ay))
        return left

    def impact(self, hit: ImpactState) -> None:
        """What changes at contacts."""
        for k in range(MAX_TERMS):
            term = _term(self, k)
            if term.door == 0.0:
                break
            if is_met(term.door, hit):
                change(term.door, term.coefficient * _of_impact(term, hit), hit)

    def observe(self, image: ImageState) -> None:
        """What the camera reports."""
        dx, dy = 0.0, 0.0
        for k in range(MAX_TERMS):
            term = _term(self, k)
            if term.door == 0.0:
                break
            if IMAGE_X <= term.door <= CLOCK:
                along_x, along_y = shift(term.door, term.coefficient * _of_image(term, image), image)
                dx, dy = dx + along_x, dy + along_y
        image.x += dx
        image.y += dy


@cache
def formula(name: str, parts: tuple[Part, ...]) -> type[Formula]:
    """The class of effects with these terms; the same one for the same terms.

    Raises:
        ValueError: for terms that do not fit in a row, or are named alike.
    """
    if not 0 < len(parts) <= MAX_TERMS:
        raise ValueError(f"{name}: {len(parts)} terms; give 1 to {MAX_TERMS}")
    if len({p.name for p in parts}) < len(parts) or any(len(p.constants) > MAX_CONSTANTS for p in parts):
        raise ValueError(f"{name}: terms named alike, or with more than {MAX_CONSTANTS} constants")
    fields = []
    for p in parts:
        fields.append((p.name, float, param(p.default, off=0.0, unit=p.unit, bounds=p.bounds, source=p.source)))
        for at in p.places:
            fields.append(
                (at.name, float, param(at.default, off=None, unit=at.unit, bounds=at.bounds, source=p.source))
            )
    title = "".join(word.capitalize() for word in name.split("_"))
    own = {"__doc__": "A formula on trial.", "__module__": __name__, "called": name, "parts": parts}
    return make_dataclass(title, fields, bases=(Formula,), namespace=own, frozen=True)


def _remade(name: str, parts: tuple[Part, ...], values: tuple[Any, ...]) -> Formula:
    return formula(name, parts)(*values)
