"""A model: table, ball, MuJoCo's own contact terms and the list of effects; and its TOML file, billiard-model/1."""

from __future__ import annotations

import dataclasses
import importlib
import math
import pkgutil
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any

import tomli_w

import models.effects
from models.effect import Effect
from models.errors import BadInput
from models.files import write_whole
from models.native import Native
from models.shot import Ball, Table

FORMAT = "billiard-model/1"
SECTIONS = ("format", "table", "ball", "native", "effect", "fit")


@cache
def catalogue() -> dict[str, type[Effect]]:
    """Every effect of the shipped folder, by name."""
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.iter_modules(models.effects.__path__):
        members = vars(importlib.import_module(f"models.effects.{module.name}")).values()
        for kind in members:
            if isinstance(kind, type) and issubclass(kind, Effect) and kind.__module__.endswith(f".{module.name}"):
                found[kind.name()] = kind
    return dict(sorted(found.items()))


def effect_class(name: str) -> type[Effect]:
    """The effect of that name; BadInput with the nearest choices otherwise."""
    known = catalogue()
    if name not in known:
        near = get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join(known)}"
        raise BadInput(f"unknown effect {name!r}; {hint}")
    return known[name]


@dataclass(frozen=True)
class Estimate:
    """How well a constant is known and where that comes from."""

    sd: float = math.nan  # one standard deviation; nan where none was computed
    source: str = ""


@dataclass(frozen=True)
class Model:
    """The table as physics: what `simulate` needs."""

    table: Table
    ball: Ball
    native: Native = field(default_factory=Native)
    effects: tuple[Effect, ...] = ()
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    fitted: Mapping[str, Any] = field(default_factory=dict)  # what the last fit said of itself: clips, command, errors

    def stack(self) -> tuple[Effect, ...]:
        """What acts: the native terms, then the effects that are not off, those that react to the others last."""
        active = [e for e in self.effects if not e.is_off()]
        return (self.native, *sorted(active, key=lambda e: e.last))

    def parameters(self) -> dict[str, Any]:
        """Values of the constants that matter, by `effect.parameter`; native terms only where nothing replaces them."""
        found: dict[str, Any] = {}
        slots = {e.slot for e in self.stack()}
        covered = {"cloth": ("slide", "roll", "spin"), "ball_impact": ("ball_",), "cushion_impact": ("cushion_",)}
        gone = tuple(p for slot, names in covered.items() if slot in slots for p in names)
        for effect in self.stack():
            for key in effect.parameters():
                if effect is not self.native or not key.startswith(gone or ("\0",)):
                    found[f"{effect.name()}.{key}"] = getattr(effect, key)
        return found

    def meta(self, name: str) -> dict[str, Any]:
        """Unit, bounds, source and off value of a constant."""
        effect, key = name.split(".")
        kind = Native if effect == "native" else effect_class(effect)
        return kind.parameters()[key]

    def with_values(self, values: Mapping[str, Any]) -> Model:
        """The model with other values of its constants: numbers, or one per simulation."""
        native, effects = self.native, list(self.effects)
        for name, value in values.items():
            owner, key = name.split(".")
            if owner == "native":
                native = dataclasses.replace(native, **{key: value})
            else:
                k = [e.name() for e in effects].index(owner)
                effects[k] = dataclasses.replace(effects[k], **{key: value})
        return dataclasses.replace(self, native=native, effects=tuple(effects))

    def add(self, effect: Effect) -> Model:
        """The model with one more effect; one of the same slot or name gives way."""
        kept = [e for e in self.effects if e.name() != effect.name() and (not e.slot or e.slot != effect.slot)]
        return dataclasses.replace(self, effects=(*kept, effect))


def full_model(table: Table, ball: Ball) -> Model:
    """The base that fits start from: decoupled cloth, and Coulomb friction and restitution at impacts."""
    names = ("decoupled_cloth", "ball_impact", "cushion_impact")
    return Model(table, ball, effects=tuple(effect_class(n)() for n in names))


def _numbers(entry: Any, where: str, kind: type[Effect]) -> tuple[dict[str, float], dict[str, Estimate]]:
    values, estimates = {}, {}
    known = kind.parameters()
    if not isinstance(entry, dict):
        raise BadInput(f"{where} is {entry!r}; give a table of parameters")
    for key, given in entry.items():
        if key not in known:
            near = get_close_matches(key, known, 1)
            hint = f"did you mean {near[0]}?" if near else f"choose from {', '.join(known)}"
            raise BadInput(f"{where}: unknown parameter {key!r}; {hint}")
        item = given if isinstance(given, dict) else {"value": given}
        value: Any = item.get("value")
        sd: Any = item.get("sd", math.nan)
        for number in (value, sd):
            if not isinstance(number, int | float) or isinstance(number, bool):
                raise BadInput(f"{where}: {key} is {number!r}; give a number [{known[key]['unit']}]")
        low, high = known[key]["bounds"]
        if value != known[key]["off"] and not low <= value <= high:
            raise BadInput(f"{where}: {key} = {value} lies outside {low} to {high} [{known[key]['unit']}]; correct it")
        if sd <= 0 or math.isinf(sd):
            raise BadInput(f"{where}: the sd of {key} is {sd}; give a positive number, or leave it out")
        values[key] = float(value)
        estimates[f"{kind.name()}.{key}"] = Estimate(float(sd), str(item.get("source", "")))
    return values, estimates


def _size(data: Mapping[str, Any], path: Path, section: str, key: str) -> float:
    """A length [m] or mass [kg] of the table or the ball."""
    entry = data.get(section, {})
    value: Any = entry.get(key) if isinstance(entry, dict) else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not 0 < value < math.inf:
        raise BadInput(
            f"{path} [{section}]: {key} is {value!r}; give a positive number [{'kg' if key == 'mass' else 'm'}]"
        )
    return float(value)


def read_model(path: Path | str) -> Model:
    """Read a model file; BadInput names what is wrong in it."""
    path = Path(path)
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read ({type(error).__name__}); name a model file") from error
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{path}: not TOML ({error}); correct that line") from error
    if data.get("format") != FORMAT:
        raise BadInput(f"{path}: format is {data.get('format')!r}; this version reads {FORMAT}")
    for key in data:
        if key not in SECTIONS:
            near = get_close_matches(key, SECTIONS, 1)
            raise BadInput(f"{path}: unknown section {key!r}; did you mean {near[0] if near else ', '.join(SECTIONS)}?")
    length, width = (_size(data, path, "table", key) for key in ("length", "width"))
    diameter, mass = (_size(data, path, "ball", key) for key in ("diameter", "mass"))
    pockets = data["table"].get("pockets")
    if not isinstance(pockets, bool):
        raise BadInput(f"{path} [table]: pockets is {pockets!r}; give true or false")
    table, ball = Table(length, width, pockets), Ball(diameter, mass)
    values, estimates = _numbers(data.get("native", {}), f"{path} [native]", Native)
    model = Model(table, ball, Native(**values), fitted=data.get("fit", {}))
    entries = data.get("effect", [])
    if not isinstance(entries, list) or not all(isinstance(entry, dict) for entry in entries):
        raise BadInput(f"{path}: effects are written as [[effect]] with a name and parameters; correct [effect]")
    for entry in entries:
        try:
            kind = effect_class(str(entry.get("name", "")))
        except BadInput as error:
            raise BadInput(f"{path}: {error}") from error
        where = f"{path} effect {kind.name()}"
        values, known = _numbers({k: v for k, v in entry.items() if k != "name"}, where, kind)
        estimates |= known
        model = model.add(kind(**values))
    return dataclasses.replace(model, estimates=estimates)


def write_model(model: Model, path: Path | str) -> None:
    """Write a model file, whole or not at all."""
    path = Path(path)

    def entry(effect: Effect) -> dict[str, Any]:
        out: dict[str, Any] = {}
        for key, meta in effect.parameters().items():
            known = model.estimates.get(f"{effect.name()}.{key}", Estimate(source=meta["source"]))
            item = {"value": float(getattr(effect, key)), "unit": meta["unit"], "source": known.source}
            out[key] = item | ({"sd": known.sd} if math.isfinite(known.sd) else {})
        return out

    data: dict[str, Any] = {
        "format": FORMAT,
        "table": dataclasses.asdict(model.table),
        "ball": dataclasses.asdict(model.ball),
        "native": entry(model.native),
        "effect": [{"name": e.name(), **entry(e)} for e in model.effects],
    }
    if model.fitted:
        data["fit"] = dict(model.fitted)
    write_whole(path, tomli_w.dumps(data).encode(), parents=True)
