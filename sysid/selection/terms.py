"""Terms of which a sparse formula is made.

In: a table, or the terms of an earlier result.json. Out: the library of terms, or an `Effect` to fit.

A term is a factor on a quantity of the motion: a drag on rolling balls, a change of the sliding friction, a push, a
lateral acceleration, a change of restitution or friction at a cushion or between balls, a shift in the image. Terms are
data: codes and constants that models/formula.py plays, beside the same factor as text. Nothing of an earlier result is
evaluated: its terms are looked up in the library by name and quantity.
"""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from models import formula as kinds
from models.effect import Effect
from models.errors import BadInput
from models.files.faults import shown
from models.formula import Part, formula
from models.shot import Table

CLOTH_CELLS = (6, 3)  # cells of the cloth with a drag of their own, along and across
RAIL_NAMES = ("+x", "-x", "+y", "-y")
MAX_BALLS = 100  # for which terms of an earlier result are looked up
RESULT_REMEDY = "name a result.json as sysid discover of this version writes it"
MAX_COEFFICIENT_WIDTHS = 100.0  # largest coefficient of an earlier result, over the term's width


@dataclass(frozen=True)
class Term:
    """One term: coefficient times factor, added to a quantity."""

    name: str  # of its coefficient
    quantity: str  # "drag", "grip", "push_x", "push_y", "side", "cushion_e", ...
    factor: str  # as Python, of the variables that the hook of the quantity has
    unit: str
    width: float  # half of the coefficient's bounds
    where: str  # plain words
    depends_on: tuple[str, ...]
    place: tuple[float, float] | None = None  # centre of the cell [m]
    kind: int = kinds.ONE  # the factor's code in models.formula
    constants: tuple[float, ...] = ()

    def part(self, value: float, source: str) -> Part:
        """The term as a formula holds it, its coefficient at a value."""
        width = max(self.width, 2 * abs(value)) if math.isfinite(value) else self.width
        code = 1 + kinds.TERM_HOOKS.index(self.quantity)
        return Part(self.name, code, self.kind, self.constants, self.unit, value, (-width, width), source)


QUANTITY_TEXTS = {
    "drag": "deceleration of rolling balls [m/s^2]",
    "grip": "relative change of the sliding friction",
    "push_x": "push along x [m/s^2], 5/7 of it on rolling balls",
    "push_y": "push along y [m/s^2], 5/7 of it on rolling balls",
    "side": "acceleration to the left of the motion of rolling balls [m/s^2]",
    "cushion_e": "change of the cushion's restitution",
    "cushion_mu": "change of the cushion's friction",
    "ball_e": "change of the restitution between balls",
    "ball_mu": "change of the friction between balls",
    "image_x": "shift of the image along x [m]",
    "image_y": "shift of the image along y [m]",
}
QUANTITY_UNITS = {
    "drag": "m/s^2", "push_x": "m/s^2", "push_y": "m/s^2", "side": "m/s^2", "image_x": "m", "image_y": "m",
}  # fmt: skip
COEFFICIENT_WIDTHS = {  # half of the bounds that a term without variables has
    "drag": 0.1, "grip": 0.5, "push_x": 0.1, "push_y": 0.1, "side": 0.1, "cushion_e": 0.3, "cushion_mu": 0.2,
    "ball_e": 0.2, "ball_mu": 0.2, "image_x": 0.05, "image_y": 0.05,
}  # fmt: skip
CELL_PATTERN = re.compile(  # the factor of a cell
    r"abs\(x ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4}) and abs\(y ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4})", re.ASCII
)
FADING_SPEEDS_M_S = (0.1, 0.14, 0.2, 0.28, 0.4, 0.57, 0.8, 1.1)  # over which an excess of friction falls by e
FACTOR_CODES: dict[str, tuple[int, tuple[float, ...]]] = {  # as text: code and constants
    "1.0": (kinds.ONE, ()), "cos(heading)": (kinds.COS, (1.0,)), "sin(heading)": (kinds.SIN, (1.0,)),
    "cos(2 * heading)": (kinds.COS, (2.0,)), "sin(2 * heading)": (kinds.SIN, (2.0,)), "order": (kinds.ORDER, ()),
    "other": (kinds.OTHER, ()), "time": (kinds.TIME, ()), "speed": (kinds.SPEED, ()),
    **{f"exp(-speed / {fade})": (kinds.FADE, (fade,)) for fade in FADING_SPEEDS_M_S}, "abs(wz)": (kinds.TWIST, ()),
    "wz * cos(heading)": (kinds.SPIN_COS, ()), "wz * sin(heading)": (kinds.SPIN_SIN, ()),
    "x": (kinds.POWER, (1.0, 0.0, 0.0)), "y": (kinds.POWER, (0.0, 1.0, 0.0)), "x**2": (kinds.POWER, (2.0, 0.0, 0.0)),
    "y**2": (kinds.POWER, (0.0, 2.0, 0.0)), "x * y": (kinds.POWER, (1.0, 1.0, 0.0)),
    "x * (x**2 + y**2) ** 2": (kinds.POWER, (1.0, 0.0, 2.0)), "y * (x**2 + y**2) ** 2": (kinds.POWER, (0.0, 1.0, 2.0)),
    "abs(along)": (kinds.ALONG, (1.0,)), "along**2": (kinds.ALONG, (2.0,)), "slip - 1.0": (kinds.SLIP, (1.0,)),
    "approach - 1.0": (kinds.APPROACH, (1.0,)), "grazing": (kinds.GRAZING, (1.0,)),
    "grazing**2": (kinds.GRAZING, (2.0,)),
} | {f"rail == {k}": (kinds.RAIL, (float(k),)) for k in range(len(RAIL_NAMES))}  # fmt: skip


def _drag_at_places(table: Table) -> list[Term]:
    """Of every cell of the cloth and every half."""
    found: list[Term] = []
    nx, ny = CLOTH_CELLS
    dx, dy = table.length / nx, table.width / ny
    for i in range(nx):
        for j in range(ny):
            x, y = (i + 0.5) * dx - table.length / 2, (j + 0.5) * dy - table.width / 2
            found.append(_boxed(_CELL, f"drag_at_{i}_{j}", (x, dx / 2, y, dy / 2)))
    for one in _HALVES:
        at, across = (table.length / 4, 0.0), (table.length / 4, table.width / 2)
        if one.name.endswith("y"):
            at, across = (0.0, table.width / 4), (table.length / 2, table.width / 4)
        found.append(_boxed(one, one.name, (at[0], across[0], at[1], across[1])))
    return found


def library(table: Table, names: int = 2) -> list[Term]:
    """Every term that is scored on a table with so many balls at most."""
    found = _drag_at_places(table)

    def add(name: str, quantity: str, factor: str, per: str, where: str, *on: str, width: float = 1.0) -> None:
        unit = QUANTITY_UNITS.get(quantity, "1") + (f" per {per}" if per else "")
        kind, constants = FACTOR_CODES[factor]
        half = width * COEFFICIENT_WIDTHS[quantity]
        found.append(Term(f"{quantity}_{name}", quantity, factor, unit, half, where, on, None, kind, constants))

    for quantity, word in (("drag", "rolling on the cloth"), ("grip", "sliding on the cloth")):
        add("cos", quantity, "cos(heading)", "", word, "heading")
        add("sin", quantity, "sin(heading)", "", word, "heading")
        add("cos2", quantity, "cos(2 * heading)", "", word, "heading")
        add("sin2", quantity, "sin(2 * heading)", "", word, "heading")
        add("order", quantity, "order", "", word, "order of the clips")
        add("other", quantity, "other", "", word + ", balls that are not struck", "ball")
        add("time", quantity, "time", "s", word, "time", width=0.2)
    for fade in FADING_SPEEDS_M_S:
        where = "rolling slowly on the cloth" if fade < 0.5 else "rolling on the cloth"
        add(f"fade_{round(1e3 * fade)}", "drag", f"exp(-speed / {fade})", "", where, "speed")
    add("spin", "drag", "abs(wz)", "rad/s", "rolling on the cloth", "spin", width=0.05)
    for axis in "xy":
        quantity = f"push_{axis}"
        for factor, name in (("x", "x"), ("y", "y"), ("x**2", "xx"), ("y**2", "yy"), ("x * y", "xy")):
            per = "m" if len(name) == 1 else "m^2"
            add(name, quantity, factor, per, "everywhere on the cloth", "place")
        add("order", quantity, "order", "", "everywhere on the cloth", "order of the clips")
    add("one", "side", "1.0", "", "rolling on the cloth", "nothing")
    add("speed", "side", "speed", "m/s", "rolling on the cloth", "speed")
    add("spin_cos", "side", "wz * cos(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
    add("spin_sin", "side", "wz * sin(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
    for quantity, word in (("cushion_e", "restitution"), ("cushion_mu", "friction")):
        for k, rail in enumerate(RAIL_NAMES):
            add(f"rail_{k}", quantity, f"rail == {k}", "", f"the cushion at {rail}: its {word}", "rail")
        add("order", quantity, "order", "", "all cushions", "order of the clips")
        add("place", quantity, "abs(along)", "m", "all cushions, along their length", "place")
        add("place_2", quantity, "along**2", "m^2", "all cushions, along their length", "place")
        add("other", quantity, "other", "", "cushions, balls that are not struck", "ball")
        add("grazing", quantity, "grazing", "", "all cushions", "angle")
        add("grazing_2", quantity, "grazing**2", "", "all cushions", "angle")
    for quantity in ("cushion_mu", "cushion_e", "ball_mu", "ball_e"):
        where = "all cushions" if quantity.startswith("cushion") else "collisions of balls"
        add("slip", quantity, "slip - 1.0", "m/s", where, "slip", width=0.3)
        add("approach", quantity, "approach - 1.0", "m/s", where, "speed", width=0.3)
    for quantity in ("ball_e", "ball_mu"):
        add("order", quantity, "order", "", "collisions of balls", "order of the clips")
        for k in range(2, names):
            name, factor, where = f"{quantity}_with_{k}", f"second == {k} or first == {k}", f"collisions with ball {k}"
            half = COEFFICIENT_WIDTHS[quantity]
            found.append(Term(name, quantity, factor, "1", half, where, ("ball",), None, kinds.WITH, (float(k),)))
    for axis in "xy":
        quantity = f"image_{axis}"
        other = "y" if axis == "x" else "x"
        for factor, name, per in (
            ("1.0", "one", ""), (axis, axis, "m"), (other, other, "m"), ("x**2", "xx", "m^2"),
            ("x * y", "xy", "m^2"), ("y**2", "yy", "m^2"), (f"{axis} * (x**2 + y**2) ** 2", "r5", "m^5"),
        ):  # fmt: skip
            add(name, quantity, factor, per, "in the camera's image", "place")
    return found


_CELL = Term("", "drag", "", QUANTITY_UNITS["drag"], COEFFICIENT_WIDTHS["drag"], "", ("place",), (0.0, 0.0), kinds.BOX)
_HALVES = tuple(
    dataclasses.replace(
        _CELL, name=f"{quantity}_half_{axis}", quantity=quantity, unit=QUANTITY_UNITS.get(quantity, "1"), place=None,
        width=COEFFICIENT_WIDTHS[quantity], where=f"{doing} on the half of the cloth with {axis} > 0",
    )
    for quantity, doing in (("drag", "rolling"), ("grip", "sliding")) for axis in "xy"
)  # fmt: skip


def _boxed(term: Term, name: str, sizes: Sequence[float]) -> Term:
    """A term on a rectangle of the cloth: x, half of its length, y, half of its width, rounded as its text has them."""
    x, half_x, y, half_y = rounded = tuple(round(v, 4) for v in sizes)
    tests = [
        f"abs({axis} {'+' if at < 0 else '-'} {abs(at):.4f}) <= {half:.4f}"
        for axis, at, half in (("x", x, half_x), ("y", y, half_y))
    ]
    where = term.where or f"on the cloth around x = {x:.2f} m, y = {y:.2f} m"
    return dataclasses.replace(
        term, name=name, factor=" and ".join(tests), where=where, place=(x, y) if term.place else None,
        constants=rounded,
    )  # fmt: skip


def term_from_json(entry: Any) -> tuple[Term, float]:
    """A term of result.json, as the library has it, and its coefficient.

    Raises:
        BadInput: for what is no term of the library; nothing of its text is evaluated.
    """
    fields = entry if isinstance(entry, dict) else {}
    name, quantity, factor, value = (fields.get(key) for key in ("name", "door", "factor", "value"))
    if not (isinstance(name, str) and isinstance(quantity, str) and isinstance(factor, str)):
        raise BadInput(f"a term has no name, door or factor; {RESULT_REMEDY}")
    number = _number(value)
    if not math.isfinite(number):
        raise BadInput(f"value of term {shown(name)} is {shown(value)}; {RESULT_REMEDY}")
    terms = {(t.name, t.quantity): t for t in library(Table(1.0, 1.0), MAX_BALLS)}
    term = terms.get((name, quantity))
    if term is not None and term.kind == kinds.BOX and (sizes := CELL_PATTERN.fullmatch(factor)):
        numbers = [float(v) for v in sizes.group(2, 3, 5, 6)]
        x, y = (-v if sign == "+" else v for sign, v in zip(sizes.group(1, 4), numbers[::2], strict=True))
        blank = dataclasses.replace(term, where="") if term.place else term
        term = _boxed(blank, name, (x, numbers[1], y, numbers[3]))
    if term is None or term.factor != factor:
        term_text = f"{shown(name)} on {shown(quantity)} with factor {shown(factor)}"
        raise BadInput(f"no term {term_text} is known; {RESULT_REMEDY}")
    if abs(number) > MAX_COEFFICIENT_WIDTHS * term.width:
        raise BadInput(f"value of term {shown(name)} is {shown(value)}, far outside its bounds; {RESULT_REMEDY}")
    return term, number


def _number(value: object) -> float:
    """A number of a JSON file; nan for anything else, or what is too large for one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def effect_from_terms(name: str, terms: Sequence[Term], values: Sequence[float]) -> Effect:
    """The effect of a formula, at these coefficients; its hooks are compiled already."""
    parts = tuple(t.part(float(v), "a diagnosis") for t, v in zip(terms, values, strict=True))
    return formula(name, parts)()
