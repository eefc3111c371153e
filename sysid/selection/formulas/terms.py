"""The library of terms for sparse formulas.

In: a table, or the terms of an earlier result.json. Out: the library of terms, or an `Effect` to fit.

A term is a factor on a quantity of the motion: a drag on rolling balls, a change of the sliding friction, a push, a
lateral acceleration, a change of restitution or friction at a cushion or between balls, a shift in the image. For every
variable that a quantity may depend on (`SEEN_BY`) there are lines, powers, bends, steps and decays, and if none of
these fits, a curve of piecewise linear hat functions (families.py). Each may act at one rail only (`only_at`), or on
one side of a value of another variable (`only_beyond`). A few further terms that physics suggests depend on two
variables. Terms are data: codes and constants for models/formula.py, and the same factor as text.
Texts of an earlier result are never evaluated: factors are parsed as numbers and variables.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from models import formula as doors
from models.analytic import factors as kinds
from models.effect import Effect
from models.formula import EVERYWHERE, MovingPlace, Only, Part, formula
from models.shot import Table
from models.variables import SESSION_VARIABLES, VARIABLES
from sysid.selection.formulas.factors import SEEN_BY, factor_code, times_of

CLOTH_CELLS = (6, 3)  # cells of the cloth with a drag of their own, along and across
RAIL_NAMES = ("+x", "-x", "+y", "-y")


Shape = tuple["Term", ...]  # terms that are added together


@dataclass(frozen=True)
class Term:
    """One term: coefficient times factor, added to a quantity."""

    name: str  # of its coefficient
    quantity: str  # "drag", "grip", "push_x", "push_y", "side", "cushion_e", ...
    factor: str  # as Python, in the variables of the quantity's hook
    unit: str
    width: float  # half of the coefficient's bounds
    where: str  # description
    depends_on: tuple[str, ...]
    place: tuple[float, float] | None = None  # centre of the cell [m]
    kind: int = kinds.ONE  # the factor's code in models.formula
    constants: tuple[float, ...] = ()
    limits: tuple[float, float] | None = None  # bounds of the place of a step or a bend, or of the scale of a decay
    only: Only | None = None  # where alone the term acts
    only_limits: tuple[float, float] | None = None  # bounds of the place where it begins to act
    only_moves: bool = False  # whether that place is a parameter
    plain: Term | None = None  # acting everywhere; None if it does
    times: str | None = None  # variable with which the factor is multiplied

    @property
    def group(self) -> str:
        """Name of the curve to which the hat belongs, or of the first of two steps; otherwise the term's own name."""
        if self.kind == kinds.HAT:
            return self.name.rpartition("_")[0]
        return self.name.removesuffix(SECOND_STEP) + FIRST_STEP if self.name.endswith(f"_{SECOND_STEP}") else self.name

    @property
    def variable(self) -> str | None:
        """The one variable of its factor; None if there are more, or none."""
        if self.times is not None:
            return None
        if self.kind in (kinds.COS, kinds.SIN):
            return "heading"
        one = self.kind in (kinds.VARIABLE, kinds.ABOVE, kinds.EQUAL, kinds.DECAY, kinds.HAT, kinds.BEND)
        return VARIABLES[int(self.constants[0])] if one else None

    @property
    def is_on_one_side(self) -> bool:
        """Whether it acts on one side of a value of another variable, which may be found."""
        return self.only is not None and self.only.side != 0.0 and self.only_limits is not None

    @property
    def places(self) -> tuple[MovingPlace, ...]:
        """Parameters of its step or bend, or of its decay scale, and of where it begins to act."""
        found = []
        if self.limits is not None:
            name = f"{self.name}_{'over' if self.kind == kinds.DECAY else 'at'}"
            unit = VARIABLE_UNITS.get(VARIABLES[int(self.constants[0])], "1")
            found.append(MovingPlace(name, unit, self.constants[1], self.limits))
        if self.only is not None and self.only_limits is not None and self.only_moves:
            unit = VARIABLE_UNITS.get(VARIABLES[self.only.variable], "1")
            found.append(MovingPlace(f"{self.name}_from", unit, self.only.which, self.only_limits, "which"))
        return tuple(found)

    def placed(self, values: Mapping[str, float]) -> Term:
        """The term with its places at these values, by name."""
        term = self
        for place in self.places:
            at = values[place.name]
            term = term.moved(at) if place.field == "b" else term.acting_from(at)
        return term

    @property
    def everywhere(self) -> Term:
        """The term without its condition."""
        return self if self.plain is None else dataclasses.replace(self.plain, limits=self.limits)

    def moved(self, at: float) -> Term:
        """The term with its step or bend at another place, or with another decay scale."""
        if self.plain is not None:
            return dataclasses.replace(only_as(self.plain.moved(at), self), name=self.name, limits=self.limits)
        variable = VARIABLES[int(self.constants[0])]
        if self.kind == kinds.DECAY:
            term = decay(self.quantity, variable, at)
        else:
            term = (step if self.kind == kinds.ABOVE else bend)(self.quantity, variable, at, *self.constants[2:])
        term = term if self.times is None else multiplied(term, self.times)
        return dataclasses.replace(term, name=self.name, limits=self.limits)

    def acting_from(self, at: float) -> Term:
        """The term, which acts on one side of a value of a variable, on that side of another value."""
        if self.only is None:
            raise ValueError(f"{self.name} acts everywhere")
        there = dataclasses.replace(self, only=self.only._replace(which=at))
        return dataclasses.replace(only_as(self.everywhere, there), name=self.name)

    def part(self, value: float, source: str) -> Part:
        """The term for a formula, with a value of its coefficient."""
        width = max(self.width, 2 * abs(value)) if math.isfinite(value) else self.width
        code, only = 1 + doors.TERM_HOOKS.index(self.quantity), self.only or EVERYWHERE
        bounds, times = (-width, width), VARIABLES.index(self.times or "none")
        return Part(
            self.name, code, self.kind, self.constants, self.unit, value, bounds, source, self.places, only, times
        )  # fmt: skip


QUANTITY_TEXTS = {
    "drag": "deceleration of rolling balls [m/s^2]",
    "grip": "relative change of the sliding friction",
    "spin": "relative change of the deceleration of sidespin",
    "push_x": "push along x [m/s^2], 5/7 of it on rolling balls",
    "push_y": "push along y [m/s^2], 5/7 of it on rolling balls",
    "side": "acceleration to the left of the motion of rolling balls [m/s^2]",
    "cushion_e": "change of the cushion's restitution",
    "cushion_mu": "change of the cushion's friction",
    "ball_e": "change of the restitution between balls",
    "ball_mu": "change of the friction between balls",
    "image_x": "shift of the image along x [m]",
    "image_y": "shift of the image along y [m]",
    "clock": "delay of the picture after its time stamp [s]",
}
QUANTITY_UNITS = {
    "drag": "m/s^2", "push_x": "m/s^2", "push_y": "m/s^2", "side": "m/s^2", "image_x": "m", "image_y": "m",
    "clock": "s",
}  # fmt: skip
COEFFICIENT_WIDTHS = {  # half of the bounds' width of a term without variables
    "drag": 0.1, "grip": 0.5, "spin": 0.5, "push_x": 0.1, "push_y": 0.1, "side": 0.1, "cushion_e": 0.3,
    "cushion_mu": 0.2, "ball_e": 0.2, "ball_mu": 0.2, "image_x": 0.05, "image_y": 0.05, "clock": 0.05,
}  # fmt: skip
PLACE_VARIABLES = ("x", "y")
PLACES_OF_ACTION = {  # the place at which each quantity acts
    "drag": "rolling on the cloth", "side": "rolling on the cloth", "grip": "sliding on the cloth",
    "spin": "sidespin on the cloth", "clock": "in the camera's clock",
    "push_x": "everywhere on the cloth", "push_y": "everywhere on the cloth", "cushion_e": "all cushions",
    "cushion_mu": "all cushions", "ball_e": "collisions of balls", "ball_mu": "collisions of balls",
    "image_x": "in the camera's image", "image_y": "in the camera's image",
}  # fmt: skip
VARIABLE_NAMES = {  # the names of variables in texts
    "x": "place", "y": "place", "along": "place", "heading": "heading", "speed": "speed", "approach": "speed",
    "slip": "slip", "wz": "spin", "time": "time", "order": "order of the clips", "number": "ball", "rail": "rail",
    "grazing": "angle", "hour": "time of day", "warmth": "temperature", "cloth_age": "age of the cloth",
    "table": "table", "player": "player",
}  # fmt: skip
VARIABLE_UNITS = {
    "x": "m", "y": "m", "along": "m", "speed": "m/s", "approach": "m/s", "slip": "m/s", "wz": "rad/s", "time": "s",
    "hour": "h", "warmth": "K", "cloth_age": "h",
}  # fmt: skip
USUAL_VALUES = {  # usual sizes of variables that are not about 1
    "time": 5.0, "wz": 20.0, "slip": 3.0, "approach": 3.0, "hour": 5.0, "warmth": 5.0, "cloth_age": 100.0,
}  # fmt: skip
SIZE_VARIABLES = ("wz", "along")  # variables whose absolute value may matter
COUNTED_VARIABLES = ("rail", "number", "table", "player")  # variables with a few discrete values
DRIFT_VARIABLES = tuple(name for name in SESSION_VARIABLES if name not in COUNTED_VARIABLES)  # of drifts
SHORT_OR_LONG = 1.5  # between the numbers of the short rails, at +x and -x, and those of the long ones
PLAIN_COUNTS = {"rail": len(RAIL_NAMES), "number": 2}  # for two balls
PLACE_DIGITS = 4
FIRST_STEP, SECOND_STEP = "above", "beyond"  # parts of the names of steps
WITHOUT_CONSTANT = ("push_x", "push_y", "side", "image_x", "image_y")  # quantities for which the model has no constant


def _term(quantity: str, name: str, factor: str, variables: Sequence[str], power: float = 1.0, where: str = "") -> Term:
    """A term of one or two of its quantity's variables."""
    code = factor_code(quantity, factor)
    if code is None:
        raise ValueError(f"{factor} is not a factor of {quantity}")
    units = [VARIABLE_UNITS[v] for v in variables if v in VARIABLE_UNITS] if power else []
    per, times = units[0] if units else "", power * len(units)
    if len(set(units)) > 1:
        per = " ".join(f"({unit})" if "/" in unit else unit for unit in units)
    elif times > 1:
        per = f"({per})^{times:.0f}" if "/" in per else f"{per}^{times:.0f}"
    size = math.prod(USUAL_VALUES.get(v, 1.0) for v in variables) ** power
    unit = QUANTITY_UNITS.get(quantity, "1") + (f" per {per}" if per else "")
    on = tuple(dict.fromkeys(VARIABLE_NAMES[v] for v in variables)) or ("nothing",)
    return Term(
        f"{quantity}_{name}", quantity, factor, unit, COEFFICIENT_WIDTHS[quantity] / size,
        where or PLACES_OF_ACTION[quantity], on, None, *code, times=times_of(factor),
    )  # fmt: skip


def straight(quantity: str, variable: str, count: int) -> list[Term]:
    """The simplest terms of a variable: a line, the first harmonics of a heading, or one for each of `count` values."""
    if variable == "heading":
        waves = {"cos": "cos(heading)", "sin": "sin(heading)", "cos2": "cos(2 * heading)", "sin2": "sin(2 * heading)"}
        return [_term(quantity, name, factor, ("heading",), 0.0) for name, factor in waves.items()]
    if variable in COUNTED_VARIABLES:
        return [
            _term(quantity, f"{variable}_{k}", f"{variable} == {k}", (variable,), 0.0, _which(quantity, variable, k))
            for k in range(count)
        ]
    return [_term(quantity, variable, variable, (variable,))]


def _which(quantity: str, variable: str, k: int) -> str:
    """Description of a change at one rail, for one ball, at one table or for one player."""
    if variable == "rail":
        return f"the cushion at {RAIL_NAMES[k]}: its {'friction' if quantity.endswith('mu') else 'restitution'}"
    which = "the struck ball" if (variable, k) == ("number", 0) else f"{VARIABLE_NAMES[variable]} {k}"
    return f"{PLACES_OF_ACTION[quantity]}, {which}"


def square(quantity: str, variable: str) -> Term:
    """A term that grows with the square of the variable."""
    return _term(quantity, f"{variable}_2", f"{variable}**2", (variable,), 2.0)


def step(quantity: str, variable: str, at: float, side: float = 1.0) -> Term:
    """A step at a value of the variable: a term that acts above it (side 1), or below it (-1)."""
    at = round(at, PLACE_DIGITS) + 0.0
    where = _beyond(PLACES_OF_ACTION[quantity], Only(VARIABLES.index(variable), at, side))
    name, sign = (FIRST_STEP, ">") if side > 0 else ("below", "<")
    return _term(quantity, f"{variable}_{name}", f"{variable} {sign} {at:g}", (variable,), 0.0, where)


def condition(only: Only) -> str:
    """The condition as Python."""
    sign = "==" if only.side == 0.0 else ">" if only.side > 0.0 else "<"
    return f"{VARIABLES[only.variable]} {sign} {only.which:g}"


def _beyond(where: str, only: Only) -> str:
    """Description of a place of action on a side of a value of a variable."""
    variable, (sign, word) = VARIABLES[only.variable], (">", "above") if only.side > 0 else ("<", "below")
    if variable == "rail":
        return where.replace("all cushions", f"the {'long' if only.side > 0 else 'short'} cushions")
    beyond = f"where {variable} {sign}" if variable in PLACE_VARIABLES else f"{VARIABLE_NAMES[variable]} {word}"
    return f"{where}, {beyond} {only.which:g} {VARIABLE_UNITS.get(variable, '')}".rstrip()


def bend(quantity: str, variable: str, at: float, side: float) -> Term:
    """A bend: a term that grows above a value of the variable (side 1), or below it (-1)."""
    at = round(at, PLACE_DIGITS) + 0.0
    name, factor = "up_from", f"max({variable} {'+' if at < 0 else '-'} {abs(at):g}, 0.0)"
    if side < 0:
        name, factor = "down_from", f"max({at:g} - {variable}, 0.0)"
    where = _beyond(PLACES_OF_ACTION[quantity], Only(VARIABLES.index(variable), at, side))
    return _term(quantity, f"{variable}_{name}", factor, (variable,), 1.0, where)


def only_at(term: Term, counted: str, k: int) -> Term:
    """The term restricted to one rail, one ball, one table or one player."""
    where = _which(term.quantity, counted, k) + term.where.removeprefix(PLACES_OF_ACTION[term.quantity])
    return _only(term, Only(VARIABLES.index(counted), float(k)), f"{counted}_{k}", where)


def only_beyond(term: Term, variable: str, at: float, side: float) -> Term:
    """The term restricted to where a variable is above a value (side 1), or below it (-1)."""
    only = Only(VARIABLES.index(variable), round(at, PLACE_DIGITS) + 0.0, side)
    return _only(term, only, f"{variable}_{'over' if side > 0 else 'under'}", _beyond(term.where, only))


def only_as(term: Term, like: Term) -> Term:
    """The term under the condition of another one, if that has one."""
    if like.only is None:
        return term
    variable, which, side = VARIABLES[like.only.variable], like.only.which, like.only.side
    under = only_at(term, variable, int(which)) if side == 0.0 else only_beyond(term, variable, which, side)
    return dataclasses.replace(under, only_limits=like.only_limits, only_moves=like.only_moves)


def _only(term: Term, only: Only, name: str, where: str) -> Term:
    """The term under a condition."""
    return dataclasses.replace(
        term, name=f"{term.quantity}_{name}{term.name.removeprefix(term.quantity)}",
        factor=f"({condition(only)}) * ({term.factor})", where=where, only=only,
        plain=dataclasses.replace(term, limits=None),
        depends_on=tuple(dict.fromkeys((VARIABLE_NAMES[VARIABLES[only.variable]], *term.depends_on))),
    )  # fmt: skip


def decay(quantity: str, variable: str, scale: float) -> Term:
    """A term that decays by a factor of e over a scale."""
    scale = max(round(scale, PLACE_DIGITS), 10.0**-PLACE_DIGITS)
    return _term(quantity, f"{variable}_fade", f"exp(-{variable} / {scale:g})", (variable,), 0.0)


def hat(quantity: str, variable: str, number: str, at: float, half: float, side: float) -> Term:
    """A hat: 1 at a place, falling to 0 over `half` on either side, or constant below (side 1) or above it (-1)."""
    away = f"({variable} {'+' if at < 0 else '-'} {abs(at):g})"
    away = f"- abs{away}" if side == 0.0 else f"{'-' if side > 0 else '+'} {away}"
    factor = f"min(max(1.0 {away} / {half:g}, 0.0), 1.0)"
    return _term(quantity, f"{variable}_curve_{number}", factor, (variable,), 0.0)


def multiplied(term: Term, over: str) -> Term:
    """The term, a curve say, in proportion to another variable."""
    own = term.factor if term.kind == kinds.DECAY or term.factor.isidentifier() else f"({term.factor})"
    unit = VARIABLE_UNITS.get(over)
    return dataclasses.replace(
        term, name=f"{term.quantity}_{over}_times{term.name.removeprefix(term.quantity)}", factor=f"{own} * {over}",
        unit=f"{term.unit} per {unit}" if unit else term.unit, width=term.width / USUAL_VALUES.get(over, 1.0),
        depends_on=tuple(dict.fromkeys((*term.depends_on, VARIABLE_NAMES[over]))), times=over,
    )  # fmt: skip


def size(quantity: str, variable: str) -> Term:
    """A term that grows with the absolute value of the variable."""
    return _term(quantity, f"{variable}_size", f"abs({variable})", (variable,))


def _cells(table: Table) -> list[Term]:
    """Terms of a drag in every cell of the cloth."""
    nx, ny = CLOTH_CELLS
    dx, dy = table.length / nx, table.width / ny
    return [
        cell(f"drag_at_{i}_{j}", ((i + 0.5) * dx - table.length / 2, dx / 2, (j + 0.5) * dy - table.width / 2, dy / 2))
        for i in range(nx) for j in range(ny)
    ]  # fmt: skip


def library(table: Table, counts: Mapping[str, int] = PLAIN_COUNTS) -> list[Term]:
    """All terms without a place; families.py has more of one variable.

    Args:
        table: on which they act.
        counts: of rails, balls, tables and players; see `COUNTED_VARIABLES`.
    """
    lines = [
        straight(quantity, variable, counts.get(variable, 0))
        for quantity, variables in SEEN_BY.items()
        for variable in variables
    ]
    return [*beside_functions(table, counts), *itertools.chain.from_iterable(lines)]


def beside_functions(table: Table, counts: Mapping[str, int] = PLAIN_COUNTS) -> list[Term]:
    """Terms that are not functions of one variable, which unknown functions include; see `library`."""
    found = _cells(table)
    for axis in "xy":
        found.append(_term(f"push_{axis}", "xy", "x * y", ("x", "y")))
    found.append(_term("side", "one", "1.0", ()))
    found.append(_term("side", "spin_cos", "wz * cos(heading)", ("wz", "heading")))
    found.append(_term("side", "spin_sin", "wz * sin(heading)", ("wz", "heading")))
    for quantity in ("ball_e", "ball_mu"):
        for k in range(2, counts.get("number", 0)):
            name, factor, where = f"{quantity}_with_{k}", f"second == {k} or first == {k}", f"collisions with ball {k}"
            half = COEFFICIENT_WIDTHS[quantity]
            found.append(Term(name, quantity, factor, "1", half, where, ("ball",), None, kinds.WITH, (float(k),)))
    for axis in "xy":
        quantity = f"image_{axis}"
        found.append(_term(quantity, "one", "1.0", ("x",), 0.0))
        found.append(_term(quantity, "xy", "x * y", ("x", "y")))
        found.append(_term(quantity, "r5", f"{axis} * (x**2 + y**2) ** 2", ("x",), 5.0))
    return found


def cell(name: str, sizes: Sequence[float]) -> Term:
    """A drag on a rectangle of the cloth: centre x, half length, centre y, half width, rounded as in its text."""
    x, half_x, y, half_y = rounded = tuple(round(v, 4) for v in sizes)
    tests = [
        f"abs({axis} {'+' if at < 0 else '-'} {abs(at):.4f}) <= {half:.4f}"
        for axis, at, half in (("x", x, half_x), ("y", y, half_y))
    ]
    where = f"on the cloth around x = {x:.2f} m, y = {y:.2f} m"
    return Term(
        name, "drag", " and ".join(tests), QUANTITY_UNITS["drag"], COEFFICIENT_WIDTHS["drag"], where, ("place",),
        (x, y), kinds.BOX, rounded,
    )  # fmt: skip


def effect_from_terms(name: str, terms: Sequence[Term], values: Sequence[float]) -> Effect:
    """The effect of a formula with these coefficients; its hooks are already compiled."""
    parts = tuple(t.part(float(v), "a diagnosis") for t, v in zip(terms, values, strict=True))
    return formula(name, parts)()
