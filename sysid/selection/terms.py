"""Terms of which a formula for unnamed structure is made, and the effect file that such a formula becomes.

A term is a factor on one of the doors of an effect: a drag on rolling balls, a change of the sliding friction, a push,
a sidewards pull, a change of restitution or friction at a cushion or between balls, a shift in the image. Terms are
data: codes and constants that models/formula.py plays, beside the same factor as text. Of a result that was written
earlier nothing is evaluated: its terms are found again here, by name and door.
"""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from models import formula as kinds
from models.effect import Effect
from models.errors import BadInput
from models.formula import Part, formula
from models.shot import Table
from sysid.clips.faults import shown

NAME = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")  # of an effect
CELLS = (6, 3)  # places on the table that are told apart, along and across
RAILS = ("+x", "-x", "+y", "-y")
MAX_BALLS = 100  # of a table, in a result that is read
REMEDY = "name a result.json as sysid discover of this version writes it"
WIDTH = 120  # columns of a file
LARGEST = 100.0  # times a term's width: a coefficient in a result that can be true


@dataclass(frozen=True)
class Term:
    """One term: coefficient times factor, through a door."""

    name: str  # of its coefficient
    door: str  # "drag", "grip", "push_x", "push_y", "side", "cushion_e", ...
    factor: str  # in words of mathematics, of the variables that the door offers
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
        door = 1 + kinds.TERM_HOOKS.index(self.door)
        return Part(self.name, door, self.kind, self.constants, self.unit, value, (-width, width), source)


DOORS = {  # door: what it changes, in words
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
UNITS = {"drag": "m/s^2", "push_x": "m/s^2", "push_y": "m/s^2", "side": "m/s^2", "image_x": "m", "image_y": "m"}
WIDTHS = {
    "drag": 0.1, "grip": 0.5, "push_x": 0.1, "push_y": 0.1, "side": 0.1, "cushion_e": 0.3, "cushion_mu": 0.2,
    "ball_e": 0.2, "ball_mu": 0.2, "image_x": 0.05, "image_y": 0.05,
}  # fmt: skip
SPACE = re.compile(
    r"abs\(x ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4}) and abs\(y ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4})", re.ASCII
)
FACTORS: dict[str, tuple[int, tuple[float, ...]]] = {  # as text: code and constants
    "1.0": (kinds.ONE, ()), "cos(heading)": (kinds.COS, (1.0,)), "sin(heading)": (kinds.SIN, (1.0,)),
    "cos(2 * heading)": (kinds.COS, (2.0,)), "sin(2 * heading)": (kinds.SIN, (2.0,)), "order": (kinds.ORDER, ()),
    "other": (kinds.OTHER, ()), "time": (kinds.TIME, ()), "speed": (kinds.SPEED, ()),
    "exp(-speed / 0.2)": (kinds.FADE, (0.2,)), "exp(-speed / 1.0)": (kinds.FADE, (1.0,)), "abs(wz)": (kinds.TWIST, ()),
    "wz * cos(heading)": (kinds.SPIN_COS, ()), "wz * sin(heading)": (kinds.SPIN_SIN, ()),
    "x": (kinds.POWER, (1.0, 0.0, 0.0)), "y": (kinds.POWER, (0.0, 1.0, 0.0)), "x**2": (kinds.POWER, (2.0, 0.0, 0.0)),
    "y**2": (kinds.POWER, (0.0, 2.0, 0.0)), "x * y": (kinds.POWER, (1.0, 1.0, 0.0)),
    "x * (x**2 + y**2) ** 2": (kinds.POWER, (1.0, 0.0, 2.0)), "y * (x**2 + y**2) ** 2": (kinds.POWER, (0.0, 1.0, 2.0)),
    "abs(along)": (kinds.ALONG, ()), "slip - 1.0": (kinds.SLIP, (1.0,)),
} | {f"rail == {k}": (kinds.RAIL, (float(k),)) for k in range(len(RAILS))}  # fmt: skip


def library(table: Table, names: int = 2) -> list[Term]:
    """Every term that is tried on a table with so many balls at most."""
    found: list[Term] = []

    def add(name: str, door: str, factor: str, per: str, where: str, *on: str, width: float = 1.0) -> None:
        unit = UNITS.get(door, "1") + (f" per {per}" if per else "")
        kind, constants = FACTORS[factor]
        found.append(Term(f"{door}_{name}", door, factor, unit, width * WIDTHS[door], where, on, None, kind, constants))

    nx, ny = CELLS
    dx, dy = table.length / nx, table.width / ny
    for i in range(nx):
        for j in range(ny):
            x, y = (i + 0.5) * dx - table.length / 2, (j + 0.5) * dy - table.width / 2
            found.append(_cell(f"drag_at_{i}_{j}", x, dx / 2, y, dy / 2))
    for door, word in (("drag", "rolling on the cloth"), ("grip", "sliding on the cloth")):
        add("cos", door, "cos(heading)", "", word, "heading")
        add("sin", door, "sin(heading)", "", word, "heading")
        add("cos2", door, "cos(2 * heading)", "", word, "heading")
        add("sin2", door, "sin(2 * heading)", "", word, "heading")
        add("order", door, "order", "", word, "order of the clips")
        add("other", door, "other", "", word + ", balls that are not struck", "ball")
        add("time", door, "time", "s", word, "time", width=0.2)
    add("slow", "drag", "exp(-speed / 0.2)", "", "rolling slowly on the cloth", "speed")
    add("fast", "drag", "exp(-speed / 1.0)", "", "rolling on the cloth", "speed")
    add("spin", "drag", "abs(wz)", "rad/s", "rolling on the cloth", "spin", width=0.05)
    for axis in "xy":
        door = f"push_{axis}"
        for factor, name in (("x", "x"), ("y", "y"), ("x**2", "xx"), ("y**2", "yy"), ("x * y", "xy")):
            per = "m" if len(name) == 1 else "m^2"
            add(name, door, factor, per, "everywhere on the cloth", "place")
        add("order", door, "order", "", "everywhere on the cloth", "order of the clips")
    add("one", "side", "1.0", "", "rolling on the cloth", "nothing")
    add("speed", "side", "speed", "m/s", "rolling on the cloth", "speed")
    add("spin_cos", "side", "wz * cos(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
    add("spin_sin", "side", "wz * sin(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
    for door, word in (("cushion_e", "restitution"), ("cushion_mu", "friction")):
        for k, rail in enumerate(RAILS):
            add(f"rail_{k}", door, f"rail == {k}", "", f"the cushion at {rail}: its {word}", "rail")
        add("order", door, "order", "", "all cushions", "order of the clips")
        add("place", door, "abs(along)", "m", "all cushions, along their length", "place")
        add("other", door, "other", "", "cushions, balls that are not struck", "ball")
    add("slip", "cushion_mu", "slip - 1.0", "m/s", "all cushions", "slip", width=0.3)
    add("slip", "cushion_e", "slip - 1.0", "m/s", "all cushions", "slip", width=0.3)
    for door in ("ball_e", "ball_mu"):
        add("order", door, "order", "", "collisions of balls", "order of the clips")
        for k in range(2, names):
            found.append(
                Term(f"{door}_with_{k}", door, f"second == {k} or first == {k}", UNITS.get(door, "1"), WIDTHS[door],
                     f"collisions with ball {k}", ("ball",), None, kinds.WITH, (float(k),))
            )  # fmt: skip
    for axis in "xy":
        door = f"image_{axis}"
        other = "y" if axis == "x" else "x"
        for factor, name, per in (
            ("1.0", "one", ""), (axis, axis, "m"), (other, other, "m"), ("x**2", "xx", "m^2"),
            ("x * y", "xy", "m^2"), ("y**2", "yy", "m^2"), (f"{axis} * (x**2 + y**2) ** 2", "r5", "m^5"),
        ):  # fmt: skip
            add(name, door, factor, per, "in the camera's image", "place")
    return found


def _cell(name: str, x: float, half_x: float, y: float, half_y: float) -> Term:
    """A drag in a cell of the cloth, its sizes rounded as its text has them [m]."""
    sizes = tuple(round(v, 4) for v in (x, half_x, y, half_y))
    tests = [
        f"abs({axis} {'+' if at < 0 else '-'} {abs(at):.4f}) <= {half:.4f}"
        for axis, at, half in zip("xy", sizes[::2], sizes[1::2], strict=True)
    ]
    where = f"on the cloth around x = {x:.2f} m, y = {y:.2f} m"
    unit, width = UNITS["drag"], WIDTHS["drag"]
    return Term(name, "drag", " and ".join(tests), unit, width, where, ("place",), (x, y), kinds.BOX, sizes)


def known(told: Any) -> tuple[Term, float]:
    """A term that a result tells, as the library has it, and its coefficient.

    Raises:
        BadInput: for what is no term of the library; nothing of its text is evaluated.
    """
    entry = told if isinstance(told, dict) else {}
    name, door, factor, value = (entry.get(key) for key in ("name", "door", "factor", "value"))
    if not (isinstance(name, str) and isinstance(door, str) and isinstance(factor, str)):
        raise BadInput(f"a term has no name, door or factor; {REMEDY}")
    number = _number(value)
    if not math.isfinite(number):
        raise BadInput(f"value of term {shown(name)} is {shown(value)}; {REMEDY}")
    terms = {(t.name, t.door): t for t in library(Table(1.0, 1.0), MAX_BALLS)}
    term = terms.get((name, door))
    if term is not None and term.kind == kinds.BOX and (sizes := SPACE.fullmatch(factor)):
        numbers = [float(v) for v in sizes.group(2, 3, 5, 6)]
        x, y = (-v if sign == "+" else v for sign, v in zip(sizes.group(1, 4), numbers[::2], strict=True))
        term = _cell(name, x, numbers[1], y, numbers[3])
    if term is None or term.factor != factor:
        asked = f"{shown(name)} on {shown(door)} with factor {shown(factor)}"
        raise BadInput(f"no term {asked} is known; {REMEDY}")
    if abs(number) > LARGEST * term.width:
        raise BadInput(f"value of term {shown(name)} is {shown(value)}, far outside its bounds; {REMEDY}")
    return term, number


def _number(value: object) -> float:
    """A number of a JSON file; nan for anything else, or what is too large for one."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def effect_of(name: str, terms: Sequence[Term], values: Sequence[float]) -> Effect:
    """The effect of a formula, at these coefficients; its hooks are compiled already."""
    parts = tuple(t.part(float(v), "a diagnosis") for t, v in zip(terms, values, strict=True))
    return formula(name, parts)()


HEAD = '''"""{title}

{formula}
Source: {source}.
"""

from __future__ import annotations

{imports}


@dataclass(frozen=True)
class {kind}(Effect):
    """{short}"""

'''
# Variables of a factor, as each hook finds them.
MOTION = {
    "x": "ball.x", "y": "ball.y", "wz": "ball.wz", "speed": "hypot(ball.vx, ball.vy)",
    "heading": "atan2(ball.vy, ball.vx)", "order": "ball.order", "time": "ball.time", "other": "ball.number > 0",
}  # fmt: skip
CONTACT = {
    "order": "hit.order", "slip": "hit.slip", "other": "hit.first > 0", "first": "hit.first", "second": "hit.second",
    "rail": "hit.second", "along": "hit.y if hit.second < 2 else hit.x",
}  # fmt: skip
PICTURE = {"x": "image.x", "y": "image.y"}
APPLIED = {  # door: the line that lets its value act
    "drag": "push_along(ball, -{value}, 0.0)",
    "grip": f"ball.slide_factor = max(ball.slide_factor * (1.0 + {{value}}), {kinds.LEAST_GRIP})",
    "push_x": "ball.ax += {value}",
    "push_y": "ball.ay += {value}",
    "side": "push_along(ball, 0.0, {value})",
    "cushion_e": "hit.restitution += {value}",
    "cushion_mu": "hit.friction += {value}",
    "ball_e": "hit.restitution += {value}",
    "ball_mu": "hit.friction += {value}",
    "image_x": "image.x += {value}",
    "image_y": "image.y += {value}",
}
ONLY = {  # doors that act in one case, and which
    ("drag", "side"): "ball.rolling", ("push_x", "push_y"): "ball.weight > 0",
    ("cushion_e", "cushion_mu"): "hit.cushion", ("ball_e", "ball_mu"): "not hit.cushion",
}  # fmt: skip


def inert(text: str) -> str:
    """Text that says the same within quotes in Python, on one line, and cannot end them."""
    one_line = " ".join(text.encode("utf-8", "replace").decode().split())
    return "".join(
        f"\\{c}" if c in '"\\' else c if c.isprintable() else c.encode("unicode_escape").decode() for c in one_line
    )


def source(name: str, terms: Sequence[Term], values: Sequence[float], title: str, origin: str) -> str:
    """The text of an effect file with these terms, coefficients at these values.

    `terms` come from `library` or `known`; title and origin may be any text.
    """
    if not NAME.fullmatch(name):
        raise BadInput(f"{name!r} is no name for an effect; give words in small letters joined by _")
    title, origin = inert(title), inert(origin)
    parts = []
    for t, value in zip(terms, values, strict=True):
        part = t.part(float(f"{value:.6g}"), "")
        low, high = part.bounds
        declared = f'{part.default!r}, off=0.0, unit="{inert(t.unit)}", bounds=({low!r}, {high!r}), source="{origin}"'
        line = f"    {t.name}: float = param({declared})\n"
        parts.append(line if len(line) <= WIDTH + 1 else f"    {t.name}: float = param(\n        {declared}\n    )\n")
    parts += _hook(terms, "forces(self, ball: BallState)", "What acts on a ball.", MOTION)
    parts += _horizon(terms)
    parts += _hook(terms, "impact(self, hit: ImpactState)", "What changes at a contact.", CONTACT)
    parts += _hook(terms, "observe(self, image: ImageState)", "What the camera reports.", PICTURE)
    body = "".join(parts)
    says = [_wrapped(f"{DOORS[t.door]}: {t.name} * {_held(t.factor)}") for t in terms]
    head = HEAD.format(
        title=_wrapped(title), formula="\n".join(says),
        source=_wrapped(f"Source: {origin}").removeprefix("Source: "), imports=_imports(body),
        kind="".join(word.capitalize() for word in name.split("_")), short=_wrapped(title, 4).lstrip(),
    )  # fmt: skip
    return head + body


def _wrapped(text: str, indent: int = 0) -> str:
    return textwrap.fill(
        text, WIDTH - 4, break_long_words=False, break_on_hyphens=False, initial_indent=indent * " ",
        subsequent_indent=indent * " ",
    )  # fmt: skip


def _held(factor: str) -> str:
    """A factor ready to be multiplied."""
    return factor if re.fullmatch(r"\w+(\([^()]*\)|\.\d+)?", factor) else f"({factor})"


def _words(text: str) -> set[str]:
    return set(re.findall(r"\b[A-Za-z_]\w*", text))


def _hook(terms: Sequence[Term], signature: str, says: str, variables: dict[str, str]) -> list[str]:
    """A hook with the terms of its doors; nothing where there are none."""
    doors = {"forces": kinds.CLOTH, "impact": kinds.IMPACTS, "observe": kinds.IMAGE}[signature.partition("(")[0]]
    here = [t for t in terms if 1 + kinds.TERM_HOOKS.index(t.door) in doors]
    if not here:
        return []
    needed = set().union(*(_words(t.factor) for t in here))
    lines = [f"\n    def {signature} -> None:\n", f'        """{says}"""\n']
    lines += [f"        {word} = {text}\n" for word, text in variables.items() if word in needed]
    for t in here:
        line = APPLIED[t.door].format(value=f"self.{t.name} * {_held(t.factor)}")
        case = next((text for these, text in ONLY.items() if t.door in these), "")
        lines.append(f"        if {case}:\n            {line}\n" if case else f"        {line}\n")
    return lines


def _horizon(terms: Sequence[Term]) -> list[str]:
    cells = [t.constants for t in terms if t.kind == kinds.BOX]
    if not cells:
        return []
    found = [f"until_edge(ball, {', '.join(map(repr, sizes))})" for sizes in cells]
    least = found[0] if len(found) == 1 else "min(\n            " + ",\n            ".join(found) + ",\n        )"
    return [
        "\n    def horizon(self, ball: BallState) -> float:\n",
        '        """Until it crosses the edge of a cell, where the force switches [s]."""\n',
        f"        return {least}\n",
    ]


def _imports(body: str) -> str:
    """The import lines that a body needs."""
    needed = _words(body) | {"Effect"}
    offered = {
        "math": ("atan2", "cos", "exp", "hypot", "sin"),
        "dataclasses": ("dataclass",),
        "models.effect": ("BallState", "Effect", "ImageState", "ImpactState", "param", "push_along"),
        "models.formula": ("until_edge",),
    }
    needed |= {"dataclass"}
    chosen = {module: [n for n in names if n in needed] for module, names in offered.items()}
    lines = {module: f"from {module} import {', '.join(names)}" for module, names in chosen.items() if names}
    own = [lines[m] for m in sorted(lines) if m.startswith("models")]
    return "\n".join([lines[m] for m in sorted(lines) if not m.startswith("models")]) + "\n\n" + "\n".join(own)
