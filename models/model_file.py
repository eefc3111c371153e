"""A model: table, ball, MuJoCo's own contact terms and the list of effects; and its TOML file, billiard-model/1."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w

from models.effect import Effect
from models.effect_catalogue import effect_class, own_file
from models.errors import BadInput
from models.files import read_toml, write_whole
from models.files.decode import Allowed, check_keys, read_value, usable
from models.files.faults import Faults
from models.files.place import Place
from models.mjcf.native import Native
from models.shot import Array, Ball, Table
from models.table.sizes import SIZE_NAMES, size_meta, stated_size, with_sizes

MODEL_FORMAT = "billiard-model/1"
OWN_FILE_KEY = "file"  # of a user's effect in a model file: where it was defined


@dataclass(frozen=True)
class Estimate:
    """The uncertainty of a constant, and its source."""

    sd: float = math.nan  # one standard deviation; nan where none was computed
    source: str = ""


@dataclass(frozen=True, repr=False)
class Model:
    """The table as physics: what `simulate` needs."""

    table: Table
    ball: Ball
    native: Native = field(default_factory=Native)
    effects: tuple[Effect, ...] = ()
    estimates: Mapping[str, Estimate] = field(default_factory=dict)
    fitted: Mapping[str, Any] = field(default_factory=dict)  # what the last fit said of itself: clips, command, errors
    execution: Mapping[str, float] = field(
        default_factory=dict
    )  # how well the launcher repeats, for the planner to read
    sizes: Mapping[str, Any] = field(
        default_factory=dict
    )  # of table and ball, as fitted; what is played, see models/table/sizes.py
    engine: str = "events"  # what plays it: "events", the compiled event engine, or "mujoco"; not part of a file

    def __repr__(self) -> str:
        """Table, ball and effects in a line."""
        t, names = self.table, ", ".join(e.name() for e in self.effects) or "none"
        pockets = "" if t.pockets else ", no pockets"
        size = f"{t.length:g} x {t.width:g} m{pockets}, balls of {1e3 * self.ball.diameter:g} mm"
        return f"<Model of {size}; effects: {names}>"

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
        return found | dict(self.sizes)

    def as_played(self) -> Model:
        """The model with the sizes that were fitted as those of its table and ball."""
        if not self.sizes:
            return self
        several = [name for name, value in self.sizes.items() if np.ndim(value)]
        if several:
            raise ValueError(f"{several[0]} has one value per simulation; give one number for a single table")
        table, ball = with_sizes(self.table, self.ball, self.sizes)
        return dataclasses.replace(self, table=table, ball=ball, sizes={})

    def meta(self, name: str) -> dict[str, Any]:
        """Unit, bounds, source and off value of a constant."""
        if name in SIZE_NAMES:
            return size_meta(name, stated_size(name, self.table, self.ball))
        effect, key = name.split(".")
        own = next((e for e in (self.native, *self.effects) if e.name() == effect), None)
        return (effect_class(effect) if own is None else own).parameters()[key]

    def with_values(self, values: Mapping[str, Any]) -> Model:
        """The model with other values of its constants: numbers, or one per simulation."""
        native, effects, sizes = self.native, list(self.effects), dict(self.sizes)
        for name, value in values.items():
            owner, key = name.split(".")
            if name in SIZE_NAMES:
                sizes[name] = value
            elif owner == "native":
                native = dataclasses.replace(native, **{key: value})
            else:
                k = [e.name() for e in effects].index(owner)
                effects[k] = dataclasses.replace(effects[k], **{key: value})
        return dataclasses.replace(self, native=native, effects=tuple(effects), sizes=sizes)

    def select(self, index: Any) -> Model:
        """The model with per-simulation parameters narrowed to some simulations."""
        chosen = tuple(e.select(index) for e in self.effects)
        native = dataclasses.replace(self.native, **vars(self.native.select(index)))
        sizes = {name: v[index] if np.ndim(v) else v for name, v in self.sizes.items()}
        return dataclasses.replace(self, native=native, effects=chosen, sizes=sizes)

    def add(self, effect: Effect | str) -> Model:
        """The model with one more effect, or that of a name at its usual values; one of its slot or name gives way."""
        effect = effect_class(effect)() if isinstance(effect, str) else effect
        kept = [e for e in self.effects if e.name() != effect.name() and (not e.slot or e.slot != effect.slot)]
        return dataclasses.replace(self, effects=(*kept, effect))

    def without(self, name: str) -> Model:
        """The model without an effect."""
        return dataclasses.replace(self, effects=tuple(e for e in self.effects if e.name() != name))


def full_model(table: Table, ball: Ball) -> Model:
    """The base that fits start from: decoupled cloth, and Coulomb friction and restitution at impacts."""
    names = ("decoupled_cloth", "ball_impact", "cushion_impact")
    return Model(table, ball, effects=tuple(effect_class(n)() for n in names))


@dataclass(frozen=True)
class ParameterEntry:
    """The keys of a parameter of a model file; its value is bounded as the effect says."""

    value: Any
    sd: Annotated[float, Allowed(math.ulp(0.0), nan=True)] = math.nan
    source: str = ""


@dataclass(frozen=True)
class FitEntries:
    """Keys of a model file's [fit] that programs read; it may hold more."""

    names: tuple[str, ...] = ()  # of the constants
    correlation: Annotated[Array, Allowed(-1.1, 1.1, shape=(None, None), nan=True)] = field(
        default_factory=lambda: np.zeros((0, 0))
    )  # of them
    clips: tuple[str, ...] = ()  # that gave them
    converged: bool = False


@dataclass(frozen=True)
class ModelFile:
    """The keys of a model file."""

    table: Annotated[Table, Allowed(needs=("pockets",))]
    ball: Ball
    native: Mapping[str, Any] = field(default_factory=dict)
    effect: Annotated[tuple[Mapping[str, Any], ...], Allowed(form="[[effect]] with a name and parameters")] = ()
    size: Mapping[str, Any] = field(default_factory=dict)  # of table and ball, as fitted
    fit: Mapping[str, Any] = field(default_factory=dict)
    execution: Annotated[Mapping[str, float], Allowed(0.0)] = field(default_factory=dict)  # by their names there


def _parameters(
    given: Mapping[str, Any], owner: str, known: Mapping[str, Mapping[str, Any]], place: Place
) -> tuple[dict[str, float], dict[str, Estimate]]:
    """Values, by key, and estimates, by `owner` and key, of constants of which unit, bounds and off are known."""
    values, estimates = {}, {}
    check_keys(given, known, place)
    for key in (key for key in given if key in known):
        item = given[key] if isinstance(given[key], Mapping) else {"value": given[key]}
        found = usable(ParameterEntry, item, place.below(key), {})
        value, (low, high) = found.get("value"), known[key]["bounds"]
        if value is not None and (isinstance(value, bool) or value != known[key]["off"]):
            value = read_value(key, value, float, Allowed(low, high, known[key]["unit"]), place)
        if value is not None:
            values[key] = float(value)
            estimates[f"{owner}{key}"] = Estimate(found.get("sd", math.nan), found.get("source", ""))
    return values, estimates


def read_model(path: Path | str) -> Model:
    """Read a model file; BadInput names what is wrong in it."""
    file = read_toml(path, ModelFile, MODEL_FORMAT, "name a model file")
    faults = Faults()
    usable(FitEntries, file.fit, Place(str(path), faults, name="fit"), {})
    place = Place(str(path), faults, name="native")
    values, estimates = _parameters(file.native, "native.", Native.parameters(), place)
    model = Model(file.table, file.ball, Native(**values), fitted=file.fit, execution=file.execution)
    metas = {name: model.meta(name) for name in SIZE_NAMES}
    sizes, known = _parameters(file.size, "", metas, Place(str(path), faults, name="size"))
    model, estimates = model.with_values(sizes), estimates | known
    for given in file.effect:
        try:
            kind = effect_class(str(given.get("name", "")))
        except BadInput as error:
            own = given.get(OWN_FILE_KEY)
            hint = (
                f"effect {given.get('name')!r} is one of your own: name its folder, --effects {Path(str(own)).parent}"
            )
            faults.add(str(path), hint if own else str(error))
            continue
        rest = {key: value for key, value in given.items() if key not in ("name", OWN_FILE_KEY)}
        place = Place(str(path), faults, name=f"effect {kind.name()}")
        values, known = _parameters(rest, f"{kind.name()}.", kind.parameters(), place)
        estimates |= known
        model = model.add(kind(**values))
    return faults.settle(dataclasses.replace(model, estimates=estimates))


def _origin(effect: Effect) -> dict[str, str]:
    """The source of a user's effect; empty for one of the catalogue."""
    own = own_file(type(effect))
    return {} if own is None else {OWN_FILE_KEY: str(own)}


def write_model(model: Model, path: Path | str) -> None:
    """Write a model file, whole or not at all."""
    path = Path(path)

    def item(name: str, value: float, meta: Mapping[str, Any]) -> dict[str, Any]:
        known = model.estimates.get(name, Estimate(source=meta["source"]))
        out = {"value": float(value), "unit": meta["unit"], "source": known.source}
        return out | ({"sd": known.sd} if math.isfinite(known.sd) else {})

    def entry(effect: Effect) -> dict[str, Any]:
        known = effect.parameters()
        return {key: item(f"{effect.name()}.{key}", getattr(effect, key), meta) for key, meta in known.items()}

    data: dict[str, Any] = {
        "format": MODEL_FORMAT,
        "table": dataclasses.asdict(model.table),
        "ball": dataclasses.asdict(model.ball),
        "effect": [{"name": e.name(), **_origin(e), **entry(e)} for e in model.effects],
    }
    if model.sizes:  # what was fitted goes before the native contact, which plays where there is no effect
        data["size"] = {name: item(name, value, model.meta(name)) for name, value in model.sizes.items()}
    if model.fitted:
        data["fit"] = dict(model.fitted)
    if model.execution:
        data["execution"] = dict(model.execution)
    data["native"] = entry(model.native)
    write_whole(path, tomli_w.dumps(data).encode(), parents=True)
