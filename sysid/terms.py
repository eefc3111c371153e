"""Terms of which a formula for unnamed structure is made, and the effect file that such a formula becomes.

A term is a factor on one of the doors of an effect: a drag on rolling balls, a change of the sliding friction, a push,
a sidewards pull, a change of restitution or friction at a cushion or between balls, a shift in the image. Its factor
is an expression of what a ball does and where it is. The same source text serves to try a term and to write the file.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from types import ModuleType

from models.effect import Effect
from models.shot import Table

ASSIGNED = re.compile(r" {8,12}(\w+) = ")
CELLS = (6, 3)  # places on the table that are told apart, along and across
RAILS = ("+x", "-x", "+y", "-y")


@dataclass(frozen=True)
class Term:
    """One term: coefficient times factor, through a door."""

    name: str  # of its coefficient
    door: str  # "drag", "grip", "push_x", "push_y", "side", "cushion_e", ...
    factor: str  # Python, of the variables that the door offers
    unit: str
    width: float  # half of the coefficient's bounds
    where: str  # plain words
    depends_on: tuple[str, ...]
    place: tuple[float, float] | None = None  # centre of the cell [m]


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


def library(table: Table, names: int = 2) -> list[Term]:
    """Every term that is tried on a table with so many balls at most."""
    found: list[Term] = []

    def add(name: str, door: str, factor: str, per: str, where: str, *on: str, width: float = 1.0,
            place: tuple[float, float] | None = None) -> None:  # fmt: skip
        unit = UNITS.get(door, "1") + (f" per {per}" if per else "")
        found.append(Term(f"{door}_{name}", door, factor, unit, width * WIDTHS[door], where, on, place))

    nx, ny = CELLS
    dx, dy = table.length / nx, table.width / ny
    for i in range(nx):
        for j in range(ny):
            cx, cy = (i + 0.5) * dx - table.length / 2, (j + 0.5) * dy - table.width / 2
            cell = f"(abs(x - {cx:.4f}) <= {dx / 2:.4f}) & (abs(y - {cy:.4f}) <= {dy / 2:.4f})"
            where = f"on the cloth around x = {cx:.2f} m, y = {cy:.2f} m"
            add(f"at_{i}_{j}", "drag", cell, "", where, "place", place=(cx, cy))
    for door, word in (("drag", "rolling on the cloth"), ("grip", "sliding on the cloth")):
        add("cos", door, "np.cos(heading)", "", word, "heading")
        add("sin", door, "np.sin(heading)", "", word, "heading")
        add("cos2", door, "np.cos(2 * heading)", "", word, "heading")
        add("sin2", door, "np.sin(2 * heading)", "", word, "heading")
        add("order", door, "order", "", word, "order of the clips")
        add("other", door, "other", "", word + ", balls that are not struck", "ball")
        add("time", door, "time", "s", word, "time", width=0.2)
    add("slow", "drag", "np.exp(-speed / 0.2)", "", "rolling slowly on the cloth", "speed")
    add("fast", "drag", "np.exp(-speed / 1.0)", "", "rolling on the cloth", "speed")
    add("spin", "drag", "abs(wz)", "rad/s", "rolling on the cloth", "spin", width=0.05)
    for axis in "xy":
        door = f"push_{axis}"
        for factor, name in (("x", "x"), ("y", "y"), ("x**2", "xx"), ("y**2", "yy"), ("x * y", "xy")):
            per = "m" if len(name) == 1 else "m^2"
            add(name, door, factor, per, "everywhere on the cloth", "place")
        add("order", door, "order", "", "everywhere on the cloth", "order of the clips")
    add("one", "side", "np.ones_like(x)", "", "rolling on the cloth", "nothing")
    add("speed", "side", "speed", "m/s", "rolling on the cloth", "speed")
    add("spin_cos", "side", "wz * np.cos(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
    add("spin_sin", "side", "wz * np.sin(heading)", "rad/s", "rolling on the cloth", "spin", "heading", width=0.02)
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
            add(f"with_{k}", door, f"(second == {k}) | (first == {k})", "", f"collisions with ball {k}", "ball")
    for axis in "xy":
        door = f"image_{axis}"
        other = "y" if axis == "x" else "x"
        for factor, name, per in (
            ("np.ones_like(x)", "one", ""), (axis, axis, "m"), (other, other, "m"), ("x**2", "xx", "m^2"),
            ("x * y", "xy", "m^2"), ("y**2", "yy", "m^2"), (f"{axis} * (x**2 + y**2) ** 2", "r5", "m^5"),
        ):  # fmt: skip
            add(name, door, factor, per, "in the camera's image", "place")
    return found


HEAD = '''"""{title}

{formula}
Source: {source}.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from models.effect import Array, Balls, Effect, Impact, column, of, param
from models.shot import Track


@dataclass(frozen=True)
class {kind}(Effect):
    """{short}"""

'''
FORCES = '''
    varies: ClassVar[bool] = True

    def horizon(self, balls: Balls) -> Array:
        """Steps short against what changes from place to place: (nsim, nball) [s]."""
        speed = np.hypot(balls.velocity[..., 0], balls.velocity[..., 1])
        return np.where(speed > 0, {travel} / np.maximum(speed, 0.01), np.inf)

    def forces(self, balls: Balls) -> None:
        """What acts on the balls."""
        x = balls.position[..., 0]
        y = balls.position[..., 1]
        v = balls.velocity[..., :2]
        wz = balls.spin[..., 2]
        speed = np.hypot(v[..., 0], v[..., 1])
        heading = np.arctan2(v[..., 1], v[..., 0])
        order = column(balls.order)
        time = column(balls.time)
        other = np.arange(v.shape[1]) > 0
        rolling = balls.rolling
        on = balls.normal > 0
'''
IMPACT = '''
    def impact(self, impact: Impact, rows: Array) -> None:
        """What changes at contacts."""
        order = impact.order
        slip = impact.slip
        other = impact.first > 0
        first = impact.first
        second = impact.second
'''
OBSERVE = '''
    def observe(self, track: Track) -> Track:
        """What the camera reports."""
        x = track.position[..., 0]
        y = track.position[..., 1]
        moved = track.position.copy()
'''


def source(name: str, terms: Sequence[Term], values: Sequence[float], title: str, origin: str) -> str:
    """The text of an effect file with these terms, coefficients at these values."""
    kind = "".join(word.capitalize() for word in name.split("_"))
    formula = "\n".join(f"{DOORS[t.door]}: {t.name} * ({t.factor})" for t in terms)
    out = [HEAD.format(title=title, formula=formula, source=origin, kind=kind, short=title)]
    for t, value in zip(terms, values, strict=True):
        digits = float(f"{value:.6g}")
        width = max(t.width, 2 * abs(digits)) if math.isfinite(digits) else t.width
        out.append(
            f"    {t.name}: float = param(\n"
            f'        {digits!r}, off=0.0, unit="{t.unit}", bounds=({-width!r}, {width!r}), source="{origin}"\n    )\n'
        )
    doors = {t.door for t in terms}
    if doors & {"drag", "grip", "push_x", "push_y", "side"}:
        out.append(FORCES.replace("{travel}", str(0.08 if any(t.place for t in terms) else 0.3)))
        out += [_cloth_line(t) for t in terms]
        if doors & {"drag", "side"}:
            out.append(_push_lines(terms))
    if doors & {"cushion_e", "cushion_mu", "ball_e", "ball_mu"}:
        out.append(IMPACT)
        for kind_of, word in (("cushion", "rail, along"), ("ball", "")):
            here = [t for t in terms if t.door.startswith(kind_of)]
            if here:
                out.append(f'        if impact.kind == "{kind_of}":\n')
                if word:
                    out.append(
                        "            rail = second\n"
                        "            along = np.where(rail < 2, impact.position[:, 1], impact.position[:, 0])\n"
                    )
                for t in here:
                    what = "restitution" if t.door.endswith("_e") else "friction"
                    out.append(f"            impact.{what} += of(self.{t.name}, rows) * ({t.factor})\n")
    if doors & {"image_x", "image_y"}:
        out.append(OBSERVE)
        for t in terms:
            if t.door.startswith("image"):
                out.append(f"        moved[..., {0 if t.door.endswith('x') else 1}] += self.{t.name} * ({t.factor})\n")
        out.append("        return replace(track, position=moved)\n")
    return tidy("".join(out))


def tidy(text: str) -> str:
    """The text without imports and variables that it does not use."""
    lines = text.splitlines()
    while True:
        kept = [k for k, line in enumerate(lines) if not (m := ASSIGNED.match(line)) or _used(lines, k, m[1])]
        if len(kept) == len(lines):
            break
        lines = [lines[k] for k in kept]
    out = []
    for k, line in enumerate(lines):
        start, found, names = line.partition(" import ")
        if found and line.startswith("from ") and "__future__" not in line:
            needed = [n for n in names.split(", ") if _used(lines, k, n)]
            out += [f"{start} import {', '.join(needed)}"] if needed else []
        elif line != "import numpy as np" or _used(lines, k, "np"):
            out.append(line)
    return "\n".join(out) + "\n"


def _used(lines: Sequence[str], at: int, name: str) -> bool:
    word = re.compile(rf"\b{name}\b")
    body = [line for k, line in enumerate(lines) if k != at and not line.startswith("from ")]
    return any(word.search(line) for line in body[body.index("@dataclass(frozen=True)") :])


def _cloth_line(t: Term) -> str:
    value = f"column(self.{t.name}) * ({t.factor})"
    if t.door == "grip":
        return f"        balls.slide_factor[:] = np.maximum(balls.slide_factor * (1.0 + {value}), 0.05)\n"
    if t.door in ("push_x", "push_y"):
        return f"        balls.force[..., {0 if t.door == 'push_x' else 1}] += balls.ball.mass * {value} * on\n"
    return ""


def _push_lines(terms: Sequence[Term]) -> str:
    lines = ["        way = v / np.maximum(speed, 1e-9)[..., None]\n"]
    drags = [f"column(self.{t.name}) * ({t.factor})" for t in terms if t.door == "drag"]
    sides = [f"column(self.{t.name}) * ({t.factor})" for t in terms if t.door == "side"]
    lines.append("        push = np.zeros_like(v)\n")
    lines += [f"        push -= (rolling * ({d}))[..., None] * way\n" for d in drags]
    if sides:
        lines.append("        left = np.stack([-way[..., 1], way[..., 0]], axis=-1)\n")
        lines += [f"        push += (rolling * ({s}))[..., None] * left\n" for s in sides]
    lines.append("        balls.push_rolling(push)\n")
    return "".join(lines)


def effect_of(name: str, terms: Sequence[Term], values: Sequence[float]) -> Effect:
    """The effect that the file would hold, at these coefficients."""
    module = ModuleType(f"cuelab_terms.{name}")
    text = source(name, terms, values, "terms on trial", "a diagnosis")
    sys.modules[module.__name__] = module  # dataclasses look their module up
    exec(compile(text, f"<{name}>", "exec"), module.__dict__)
    kind = module.__dict__["".join(word.capitalize() for word in name.split("_"))]
    found: Effect = kind()
    return found
