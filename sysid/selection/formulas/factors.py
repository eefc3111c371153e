"""Factors of terms as text, and the codes with which models/formula.py evaluates them.

In: the text of a factor of variables that a quantity may depend on (`SEEN_BY`). Out: its code and constants. Texts are
never evaluated.
"""

from __future__ import annotations

import re

from models.analytic import factors as kinds
from models.variables import SESSION_VARIABLES, VARIABLES

NUMBER = r"(-?\d{1,4}(?:\.\d{1,4})?)"
CELL_PATTERN = re.compile(  # the factor of a cell
    r"abs\(x ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4}) and abs\(y ([+-]) (\d+\.\d{4})\) <= (\d+\.\d{4})", re.ASCII
)
STEP_PATTERN, EQUAL_PATTERN, DECAY_PATTERN, POWER_PATTERN, TIMES_PATTERN = (
    re.compile(text, re.ASCII)
    for text in (
        rf"([a-z_]+) ([><]) {NUMBER}", r"([a-z]+) == (\d{1,3})", rf"exp\(-([a-z_]+) / {NUMBER}\)", r"([a-z_]+)(\*\*2)?",
        r"([a-z_]+|\(.+\)|exp\([^()]+\)) \* ([a-z_]+)",
    )
)  # fmt: skip
DISTANCE = r"(\d{1,4}(?:\.\d{1,4})?)"
ONLY_PATTERN = re.compile(
    rf"\((?:(rail|number|table|player) == (\d{{1,3}})|([a-z_]+) ([><]) {NUMBER})\) \* \((.+)\)", re.ASCII
)
BEND_PATTERN = re.compile(rf"max\((?:([a-z_]+) ([+-]) {DISTANCE}|{NUMBER} - ([a-z_]+)), 0\.0\)", re.ASCII)
HAT_PATTERN = re.compile(
    rf"min\(max\(1\.0 ([+-]) (abs)?\(([a-z_]+) ([+-]) {DISTANCE}\) / {DISTANCE}, 0\.0\), 1\.0\)", re.ASCII
)
FIXED_FACTORS: dict[str, tuple[int, tuple[float, ...]]] = {  # as text: code and constants
    "1.0": (kinds.ONE, ()), "cos(heading)": (kinds.COS, (1.0,)), "sin(heading)": (kinds.SIN, (1.0,)),
    "cos(2 * heading)": (kinds.COS, (2.0,)), "sin(2 * heading)": (kinds.SIN, (2.0,)), "abs(wz)": (kinds.TWIST, ()),
    "wz * cos(heading)": (kinds.SPIN_COS, ()), "wz * sin(heading)": (kinds.SPIN_SIN, ()),
    "x * y": (kinds.POWER, (1.0, 1.0, 0.0)), "x * (x**2 + y**2) ** 2": (kinds.POWER, (1.0, 0.0, 2.0)),
    "y * (x**2 + y**2) ** 2": (kinds.POWER, (0.0, 1.0, 2.0)), "abs(along)": (kinds.ALONG_RAIL, (1.0,)),
}  # fmt: skip
_MOTION = ("x", "y", "heading", "speed", "wz", "time", "number", *SESSION_VARIABLES)
_CONTACT = ("grazing", "approach", "slip", "wz", "time", "number", *SESSION_VARIABLES)
_IMAGE = ("x", "y", "time", "number", *SESSION_VARIABLES)
SEEN_BY = {  # variables that each quantity may depend on
    "drag": _MOTION, "side": _MOTION, "push_x": _MOTION, "push_y": _MOTION, "spin": _MOTION,
    "grip": (*_MOTION, "slip"),
    "cushion_e": ("rail", "along", *_CONTACT), "cushion_mu": ("rail", "along", *_CONTACT),
    "ball_e": ("x", "y", *_CONTACT), "ball_mu": ("x", "y", *_CONTACT), "image_x": _IMAGE, "image_y": _IMAGE,
    "clock": _IMAGE,
}  # fmt: skip


def factor_code(quantity: str, factor: str) -> tuple[int, tuple[float, ...]] | None:
    """Code and constants of a factor in the notation of this file; None for any other text."""
    known = FIXED_FACTORS.get(factor)
    if known is not None:
        return known
    if only := ONLY_PATTERN.fullmatch(factor):
        plain = (only[1] or only[3]) in SEEN_BY.get(quantity, ()) and not ONLY_PATTERN.fullmatch(only[6])
        return factor_code(quantity, only[6]) if plain else None
    if (found := BEND_PATTERN.fullmatch(factor)) and (found[1] or found[5]) in SEEN_BY.get(quantity, ()):
        at = float(found[4]) if found[5] else (-1.0 if found[2] == "+" else 1.0) * float(found[3])
        return kinds.BEND, (float(VARIABLES.index(found[1] or found[5])), at, -1.0 if found[5] else 1.0)
    if cell := CELL_PATTERN.fullmatch(factor):
        x, half_x, y, half_y = (float(v) for v in cell.group(2, 3, 5, 6))
        return kinds.BOX, (-x if cell[1] == "+" else x, half_x, -y if cell[4] == "+" else y, half_y)
    if (found := STEP_PATTERN.fullmatch(factor)) and found[1] in SEEN_BY.get(quantity, ()):
        return kinds.ABOVE, (float(VARIABLES.index(found[1])), float(found[3]), *([-1.0] if found[2] == "<" else []))
    inner, over = without_times(factor)
    if over is not None:
        plain = over in SEEN_BY.get(quantity, ()) and not TIMES_PATTERN.fullmatch(inner)
        return factor_code(quantity, inner) if plain else None
    for pattern, kind in (
        (EQUAL_PATTERN, kinds.EQUAL), (DECAY_PATTERN, kinds.DECAY),
        (POWER_PATTERN, kinds.VARIABLE),
    ):  # fmt: skip
        found = pattern.fullmatch(factor)
        if found is None or found[1] not in SEEN_BY.get(quantity, ()):
            continue
        variable = float(VARIABLES.index(found[1]))
        if kind == kinds.VARIABLE:
            return kind, (variable, 0.0, 2.0 if found[2] else 1.0)
        at = float(found[2])
        if kind == kinds.DECAY and not at > 0.0:
            return None
        return kind, (variable, at)
    if (hat := HAT_PATTERN.fullmatch(factor)) and hat[3] in SEEN_BY.get(quantity, ()):
        at, half = (-1.0 if hat[4] == "+" else 1.0) * float(hat[5]), float(hat[6])
        side = 0.0 if hat[2] else 1.0 if hat[1] == "-" else -1.0
        if half > 0.0 and not (hat[2] and hat[1] == "+"):
            return kinds.HAT, (float(VARIABLES.index(hat[3])), at, half, side)
    return None


def times_of(factor: str) -> str | None:
    """The variable with which a factor is multiplied, in its condition if it has one; None for 1."""
    only = ONLY_PATTERN.fullmatch(factor)
    return without_times(only[6] if only else factor)[1]


def without_times(factor: str) -> tuple[str, str | None]:
    """A factor without the variable with which it is multiplied, and that variable, None for 1."""
    found = TIMES_PATTERN.fullmatch(factor)
    if found is None or factor in FIXED_FACTORS:
        return factor, None
    return found[1][1:-1] if found[1].startswith("(") else found[1], found[2]
