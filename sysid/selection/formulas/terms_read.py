"""Terms of a formula, read from an earlier result.

In: entries of result.json. Out: terms of the library (terms.py); texts are never evaluated.
"""

from __future__ import annotations

import dataclasses
import math
import re
from functools import cache
from typing import Any

from models.errors import BadInput
from models.files.faults import shown
from models.shot import Table
from sysid.clips.session import MAX_NUMBERED
from sysid.selection.formulas.factors import (
    BEND_PATTERN,
    DECAY_PATTERN,
    HAT_PATTERN,
    ONLY_PATTERN,
    POWER_PATTERN,
    SEEN_BY,
    STEP_PATTERN,
    factor_code,
    without_times,
)
from sysid.selection.formulas.terms import (
    RAIL_NAMES,
    SECOND_STEP,
    SIZE_VARIABLES,
    Term,
    bend,
    cell,
    decay,
    hat,
    library,
    multiplied,
    only_at,
    only_beyond,
    size,
    square,
    step,
)

MAX_BALLS = 100  # largest number of balls for which terms are looked up
MAX_COEFFICIENT_WIDTHS = 100.0  # largest coefficient of an earlier result, over the term's width
RESULT_REMEDY = "name a result.json as sysid discover of this version writes it"
CURVE_NAME = re.compile(r"[a-z_0-9]+_curve_(\d{1,2}(?:_\d{1,2}){1,2})", re.ASCII)


@cache
def _known_terms() -> dict[tuple[str, str], Term]:
    """The library's terms, by name and quantity; cells of the cloth stand for those of any table."""
    counts = {"rail": len(RAIL_NAMES), "number": MAX_BALLS, "table": MAX_NUMBERED + 1, "player": MAX_NUMBERED + 1}
    return {(t.name, t.quantity): t for t in library(Table(1.0, 1.0), counts)}


def term_from_json(entry: Any) -> tuple[Term, float]:
    """The library's term for an entry of result.json, and its coefficient.

    Raises:
        BadInput: if it is not a term of the library; its text is never evaluated.
    """
    fields = entry if isinstance(entry, dict) else {}
    name, quantity, factor, value = (fields.get(key) for key in ("name", "door", "factor", "value"))
    if not (isinstance(name, str) and isinstance(quantity, str) and isinstance(factor, str)):
        raise BadInput(f"a term has no name, door or factor; {RESULT_REMEDY}")
    number = _number(value)
    if not math.isfinite(number):
        raise BadInput(f"value of term {shown(name)} is {shown(value)}; {RESULT_REMEDY}")
    term = _known_terms().get((name, quantity))
    if term is not None and term.place is not None and (code := factor_code(quantity, factor)) is not None:
        term = cell(name, code[1])
    elif term is None:
        term = _read(name, quantity, factor)
    if term is None or (term.name, term.factor) != (name, factor):
        term_text = f"{shown(name)} on {shown(quantity)} with factor {shown(factor)}"
        raise BadInput(f"no term {term_text} is known; {RESULT_REMEDY}")
    if abs(number) > MAX_COEFFICIENT_WIDTHS * term.width:
        raise BadInput(f"value of term {shown(name)} is {shown(value)}, far outside its bounds; {RESULT_REMEDY}")
    return term, number


def _number(value: object) -> float:
    """A number of a JSON file; nan for anything else, or for one that is too large."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return math.nan
    try:
        return float(value)
    except OverflowError:
        return math.nan


def _read(name: str, quantity: str, factor: str) -> Term | None:
    """The term of `shapes` with this factor as text; None for any other text."""
    code = factor_code(quantity, factor)
    if code is None or quantity not in SEEN_BY:
        return None
    if found := ONLY_PATTERN.fullmatch(factor):
        counted, k, variable, sign, at, inner = found.groups()
        condition = f"{counted}_{int(k)}" if counted else f"{variable}_{'over' if sign == '>' else 'under'}"
        plain = name.replace(f"{condition}_", "", 1)
        term = _known_terms().get((plain, quantity)) or _read(plain, quantity, inner)
        if term is None:
            return None
        if counted:
            return only_at(term, counted, int(k)) if (f"{quantity}_{condition}", quantity) in _known_terms() else None
        return only_beyond(term, variable, float(at), 1.0 if sign == ">" else -1.0)
    inner, over = without_times(factor)
    if over is not None:
        plain = name.replace(f"{over}_times_", "", 1)
        term = _known_terms().get((plain, quantity)) or _read(plain, quantity, inner)
        return None if term is None else multiplied(term, over)
    if found := BEND_PATTERN.fullmatch(factor):
        return bend(quantity, found[1] or found[5], *code[1][1:])
    if found := STEP_PATTERN.fullmatch(factor):
        one = step(quantity, found[1], float(found[3]), 1.0 if found[2] == ">" else -1.0)
        return dataclasses.replace(one, name=name) if name == f"{quantity}_{found[1]}_{SECOND_STEP}" else one
    if found := DECAY_PATTERN.fullmatch(factor):
        return decay(quantity, found[1], float(found[2]))
    if (found := HAT_PATTERN.fullmatch(factor)) and (number := CURVE_NAME.fullmatch(name)):
        _, at, half, side = code[1]
        return hat(quantity, found[3], number[1], at, half, side)
    if (found := POWER_PATTERN.fullmatch(factor)) and found[2]:
        return square(quantity, found[1])
    return next((size(quantity, v) for v in SIZE_VARIABLES if factor == f"abs({v})" and v in SEEN_BY[quantity]), None)
