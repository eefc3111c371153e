"""Decoding of files into dataclasses: every fault is one line with the key, its place, the value and the remedy.

In: parsed TOML or JSON, and a dataclass whose fields are the keys. Out: its value; faults are added to the `Place`.

A field's type defines the values of a key: a number, text, true or false, numbers in brackets (of a `shape`), another
dataclass, a table (Mapping) or a list of tables; `Allowed`, or the `param` of an effect, restricts them. An error in a
dataclass's __post_init__ is a fault of its table. Left out: relations between keys of different tables, which the
readers check.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import MISSING, dataclass
from functools import cache
from types import NoneType, UnionType
from typing import Any, TypeVar, get_args, get_origin, get_type_hints

from models.errors import BadInput
from models.files.faults import closest, shown
from models.files.place import Place

Kind = TypeVar("Kind")
LIKELY_UNITS = {"m": ("mm", 1e-3), "m/s": ("mm/s", 1e-3), "kg": ("g", 1e-3), "rad": ("degrees", math.pi / 180)}


@dataclass(frozen=True)
class Allowed:
    """Restrictions of a key's value, besides its type: `Annotated[float, Allowed(0.2, 10.0, "m")]`."""

    low: float = -math.inf
    high: float = math.inf
    unit: str = "1"
    shape: tuple[int | None, ...] = ()  # of numbers in brackets; None for a free count
    form: str = ""  # the expected form, for messages
    nan: bool = False  # whether a number may be nan
    needs: tuple[str, ...] = ()  # required keys of a table, despite their defaults
    reader: Callable[[Any], Any] | None = None  # reads a value of several forms; BadInput names a fault


def of_format(data: object, form: str, kind: Any, place: Place) -> Mapping[str, Any] | None:
    """The keys of a file other than its format; None, with the fault noted, if the format is another one."""
    if not isinstance(data, Mapping):
        place.fault(f'{shown(data)} is not a {form}: give format = "{form}" and its tables')
        return None
    keys, version = ("format", *_taken(kind)), data.get("format")
    if version == form:
        return {key: value for key, value in data.items() if key != "format"}
    if version is not None or "format" not in check_keys(data, keys, place, {}):
        problem = "format is missing" if version is None else f"format = {shown(version)} is unknown"
        place.fault(f'{problem}: this version reads format = "{form}"', "format")
    return None


def decode(
    kind: type[Kind], data: object, place: Place, extra: dict[str, Any] | None = None, *, needs: Sequence[str] = ()
) -> Kind | None:
    """The value of a table; None, with the faults noted, if there are any. Arguments as for `usable`."""
    before = len(place.faults)
    values = usable(kind, data, place, extra, needs=needs)
    if len(place.faults) > before:
        return None
    try:
        return kind(**values)
    except BadInput as error:
        place.fault(str(error))
        return None


def usable(
    kind: Any, data: object, place: Place, extra: dict[str, Any] | None = None, *, needs: Sequence[str] = ()
) -> dict[str, Any]:
    """The usable values of a table, by key.

    Args:
        kind: a dataclass whose fields are the keys.
        data: the table.
        place: its place, with the list of faults.
        extra: receives unknown keys that are not misspelt known ones; without it they are faults.
        needs: required keys, despite their defaults.
    """
    taken, values = _taken(kind), dict[str, Any]()
    if not isinstance(data, Mapping):
        place.fault(f"{place.name} = {shown(data)} is not a table: write {_form(place.name, kind, Allowed())}")
        return {}
    slips = check_keys(data, taken, place, extra)
    for key, (hint, allowed) in taken.items():
        if key in data:
            value = read_value(key, data[key], hint, allowed, place, extra)
            values |= {} if value is None else {key: value}
        elif (key in needs or key in _required(kind)) and key not in slips:
            named = f"[{key}]" if _is_table(hint) else f"{place.within}{key}"
            place.fault(f"{named} is missing: add {_form(key, hint, allowed)}")
    return values


def check_keys(
    data: Mapping[str, Any], known: Iterable[str], place: Place, extra: dict[str, Any] | None = None
) -> set[str]:
    """The known keys of which unknown ones are misspellings; `extra` as for `usable`."""
    slips = set()
    for key in data:
        if key in known:
            continue
        if meant := closest(key, known):
            slips.add(meant)
            place.fault(f"unknown key {shown(key)}: did you mean {meant!r}?", key)
        elif extra is None:
            place.fault(f"unknown key {shown(key)}: remove it, or choose from {', '.join(known)}", key)
        else:
            extra[key] = data[key]
    return slips


def read_value(
    key: str, value: Any, hint: Any, allowed: Allowed, place: Place, extra: dict[str, Any] | None = None
) -> Any:
    """The value of a key by its type and restrictions; None, with the fault noted, for a wrong one."""
    if allowed.reader is not None:
        try:
            return allowed.reader(value)
        except BadInput as problem:
            place.fault(str(problem), key)
            return None
    kind: Any = (get_args(hint) or (hint,))[0]  # of the table, or of those of a list
    if dataclasses.is_dataclass(hint):
        return decode(kind, value, place.below(key), None if extra is None else {}, needs=allowed.needs)
    if _is_list_of_tables(hint) and isinstance(value, list) and all(isinstance(v, Mapping) for v in value):
        if get_origin(kind) is Mapping:
            return tuple(value)
        return tuple(decode(kind, table, place.below(key, k)) for k, table in enumerate(value))
    if get_origin(hint) is Mapping and isinstance(value, Mapping):
        inside = get_args(hint)[1]
        return {
            k: v for k, x in value.items() if (v := read_value(k, x, inside, allowed, place.below(key))) is not None
        }
    try:
        return _plain(value, hint, allowed)
    except _Unfit as problem:
        place.fault(f"{place.within}{key} = {shown(value)} {problem}: write {_form(key, hint, allowed)}", key)
    except BadInput as problem:
        place.fault(f"{place.within}{key} = {shown(value)} {problem}", key)
    return None


class _Unfit(ValueError):
    """A fault of a value whose remedy is to write the expected form."""


def _plain(value: Any, hint: Any, allowed: Allowed) -> Any:
    """A value other than a table; raises _Unfit, or BadInput with its own remedy."""
    if hint is Any:
        return value
    if hint in (float, int):
        return _number(value, allowed, whole=hint is int)
    if allowed.shape:
        found = _numbers(value, allowed.shape, allowed, whole=get_args(hint)[0] is int)
        if get_origin(hint) is tuple:
            return tuple(found)
        import numpy as np  # imported here, so that help starts without it

        try:
            return np.array(found, float)
        except ValueError:
            raise _Unfit("has rows of different lengths") from None
    if hint in (bool, str) and isinstance(value, hint):
        return value
    if hint == tuple[str, ...] and isinstance(value, list | tuple) and all(isinstance(v, str) for v in value):
        return tuple(value)
    raise _Unfit("is not " + {bool: "true or false", str: "text"}.get(hint, "a table" if _is_table(hint) else "a list"))


def _numbers(value: Any, shape: tuple[int | None, ...], allowed: Allowed, whole: bool) -> Any:
    if not shape:
        try:
            return _number(value, allowed, whole)
        except (_Unfit, BadInput) as problem:
            raise type(problem)(f"holds {shown(value)}, which {problem}") from None
    if not isinstance(value, list | tuple) or shape[0] not in (None, len(value)):
        raise _Unfit(f"is not {_size(shape)}")
    return [_numbers(v, shape[1:], allowed, whole) for v in value]


def _number(value: Any, allowed: Allowed, whole: bool) -> float:
    """A number within its bounds."""
    if isinstance(value, bool) or not isinstance(value, int if whole else int | float):
        raise _Unfit(f"is {'text in quotes, ' * isinstance(value, str)}not a {'whole ' * whole}number")
    low, high = allowed.low, allowed.high
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if low <= number <= high and math.isfinite(number):
        return value if whole else number
    if not math.isfinite(number):
        if math.isnan(number) and allowed.nan:
            return number
        raise _Unfit("is not finite")
    if number <= 0 <= low:
        raise _Unfit("is not positive" if low > 0 else "is negative")
    unit, factor = LIKELY_UNITS.get(allowed.unit, ("", math.nan))
    if low <= number * factor <= high:
        raise BadInput(f"looks like {unit}: write {number * factor:.6g} ({allowed.unit})")
    raise _Unfit(f"is outside {low:.6g} to {high:.6g}")


def _form(key: str, hint: Any, allowed: Allowed) -> str:
    """The expected form of a value, for messages."""
    if allowed.form:
        return allowed.form
    if dataclasses.is_dataclass(hint):
        return f"[{key}] with {', '.join(_required(hint) or (f.name for f in dataclasses.fields(hint)))}"
    if hint in (bool, str) or not (hint in (float, int) or allowed.shape):
        return {bool: "true or false", str: f'{key} = "..."'}.get(hint, f"[{key}]" if _is_table(hint) else "a list")
    low, high, unit = allowed.low, allowed.high, allowed.unit
    what = _size(allowed.shape) if allowed.shape else f"a {'whole ' * (hint is int)}number"
    within = f", {low:.6g} to {high:.6g}" if math.isfinite(low + high) else ""
    within = within or (f", {low:.6g} or more" if low > math.ulp(0.0) or low == 0 else ", above 0" * (low > 0))
    return f"{what}{f' in {unit}' * (unit != '1')}{within}"


def _size(shape: tuple[int | None, ...]) -> str:
    return f"{' x '.join(str(n) for n in shape)} numbers" if None not in shape else "a list of numbers"


def _required(kind: Any) -> list[str]:
    """The keys without defaults."""
    return [f.name for f in dataclasses.fields(kind) if f.default is MISSING and f.default_factory is MISSING]


def _is_table(hint: Any) -> bool:
    return dataclasses.is_dataclass(hint) or get_origin(hint) is Mapping


def _is_list_of_tables(hint: Any) -> bool:
    return get_origin(hint) is tuple and _is_table(get_args(hint)[0])


@cache
def _taken(kind: Any) -> dict[str, tuple[Any, Allowed]]:
    """Type and restrictions, by field."""
    found = {}
    for key, hint in get_type_hints(kind, include_extras=True).items():
        notes = [note for note in getattr(hint, "__metadata__", ()) if isinstance(note, Allowed)]
        hint = hint.__origin__ if notes else hint
        of = [h for h in get_args(hint) if h is not NoneType] if get_origin(hint) is UnionType else [hint]
        found[key] = (of[0], notes[0] if notes else Allowed())
    for f in dataclasses.fields(kind):
        if "bounds" in f.metadata:  # the parameter of an effect
            low, high = f.metadata["bounds"]
            found[f.name] = (found[f.name][0], Allowed(low, high, f.metadata["unit"]))
    return found
