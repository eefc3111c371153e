"""Keys and numbers of `clips.toml`: their units and bounds, misspelt keys, and line numbers for messages.

In: decoded TOML and its text. Out: numbers, unknown keys, and faults in `Faults`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from sysid.clips.faults import CLIPS_TOML, Faults, closest, shown


@dataclass(frozen=True)
class Bound:
    """A number that clips.toml holds: its unit and what is possible."""

    unit: str
    low: float
    high: float
    required: bool = True


NUMBER_BOUNDS: Mapping[str, Mapping[str, Bound]] = {
    "table": {"length": Bound("m", 0.2, 10.0), "width": Bound("m", 0.1, 10.0)},
    "ball": {"diameter": Bound("m", 0.02, 0.1), "mass": Bound("kg", 2e-4, 6.0)},
    "camera": {"fps": Bound("1/s", 1.0, 1e6), "sigma": Bound("m", 1e-9, 0.02, required=False)},
    "cue": {
        "speed": Bound("m/s", 0.0, 30.0),
        "azimuth": Bound("rad", -4 * math.pi, 4 * math.pi),
        "side": Bound("m", -0.05, 0.05, required=False),
        "height": Bound("m", -0.05, 0.05, required=False),
        "elevation": Bound("rad", -math.pi / 2, math.pi / 2, required=False),
    },
}
LIKELY_UNITS = {"m": ("mm", 1e-3), "m/s": ("mm/s", 1e-3), "kg": ("g", 1e-3), "rad": ("degrees", math.pi / 180)}
TABLE_HEADING = re.compile(r"\s*\[\[?\s*([^\[\]]*?)\s*\]\]?\s*(#.*)?$")


@dataclass(frozen=True)
class Place:
    """A table of clips.toml, `[name]` or the `[[name]]` of this `index` from 0; the top level without a name."""

    text: str
    name: str = ""
    index: int = 0

    def line(self, key: str = "") -> int | None:
        """Line number of a key, else of the table; None when neither is found."""
        here, seen, table = not self.name, -1, None
        for number, line in enumerate(self.text.split("\n"), 1):
            if found := TABLE_HEADING.match(line):
                seen += found[1] == self.name
                here = found[1] == self.name and seen == self.index
                table = number if here else table
            elif here and _assigns(line, key):
                return number
            elif seen < 0 and table is None and _assigns(line, self.name):
                table = number  # written as name = { ... }
        return table


def _assigns(line: str, key: str) -> bool:
    return bool(key) and re.match(rf"""\s*["']?{re.escape(key)}["']?\s*=""", line) is not None


def unknown_keys(
    data: Mapping[str, Any], known: Iterable[str], place: Place, faults: Faults, within: str = ""
) -> dict[str, Any]:
    """Keys that the format does not name: preserved, unless they are probably misspelt.

    `within` is the key whose inline table `data` is.
    """
    extra = {}
    for key, value in data.items():
        if key in known:
            continue
        if (meant := closest(key, known)) is None:
            extra[key] = value
        else:
            line = place.line(within or key) or Place(place.text, key).line()
            faults.add(CLIPS_TOML, f"unknown key {shown(key)}: did you mean {meant!r}?", line)
    return extra


def slips(data: Mapping[str, Any], known: Iterable[str]) -> set[str]:
    """The known keys that keys of `data` are slips of: they are not to be called missing as well."""
    return {meant for key in data if key not in known and (meant := closest(key, known)) is not None}


def read_numbers(
    data: Mapping[str, Any], name: str, place: Place, faults: Faults, more: tuple[str, ...] = ()
) -> tuple[dict[str, float], dict[str, Any]]:
    """The usable numbers of the table `name`, and its unknown keys; `more` names keys that others read."""
    bounds = NUMBER_BOUNDS[name]
    inner, within = ("cue.", "cue") if name == "cue" else ("", "")  # keys of an inline table have no line of their own
    extra = unknown_keys(data, (*bounds, *more), place, faults, within)
    slipped = slips(data, (*bounds, *more))
    values = {}
    for key, bound in bounds.items():
        if key in data:
            try:
                values[key] = _number(data[key], bound)
            except ValueError as error:
                faults.add(CLIPS_TOML, f"{inner}{key} = {shown(data[key])} {error}", place.line(within or key))
        elif bound.required and key not in slipped:
            faults.add(CLIPS_TOML, f"{inner}{key} is missing: add it in {bound.unit}", place.line(within))
    return values, extra


def _number(value: object, bound: Bound) -> float:
    """The value as a number within its bounds; the message of the ValueError is the fault and its remedy."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"is not a number: write it in {bound.unit}, without quotes")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"is not finite: write a number in {bound.unit}")
    if bound.low <= number <= bound.high:
        return number
    if bound.low > 0 >= number:
        raise ValueError(f"is not positive: write it in {bound.unit}" + (", or leave it out" * (not bound.required)))
    unit, factor = LIKELY_UNITS.get(bound.unit, ("", math.nan))
    if bound.low <= number * factor <= bound.high:
        raise ValueError(f"looks like {unit}: write {number * factor:.6g} ({bound.unit})")
    raise ValueError(f"is not between {bound.low:.6g} and {bound.high:.6g} {bound.unit}: correct it")
