"""What every effect owes the workbench, shipped or new: declared parameters, off is absent, files that come back."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from models.effect import Effect
from models.errors import BadInput
from models.model_file import Estimate, Model, catalogue, full_model, read_model, write_model
from models.native import Native
from models.shot import Array, Ball, Shot, Table, Track
from models.simulate import simulate

TABLE, BALL = Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)
EFFECTS = sorted(catalogue())
KINDS = [*(catalogue()[name] for name in EFFECTS), Native]
TIMES = np.linspace(0, 2.5, 51)
FAULTS = [  # text to replace in a good file, its replacement, what the message must name
    ('format = "billiard-model/1"', 'format = "billiard-model/9"', ["billiard-model/9", "reads billiard-model/1"]),
    ("length = 2.84", 'length = "long"', ["length", "'long'", "positive number"]),
    ("width = 1.42", "width = -1.0", ["width", "-1.0", "positive number"]),
    ("mass = 0.21", "", ["mass", "None", "kg"]),
    ("pockets = false", 'pockets = "no"', ["pockets", "'no'", "true or false"]),
    ('name = "decoupled_cloth"', 'name = "decoupled_cloht"', ["decoupled_cloht", "did you mean decoupled_cloth"]),
    ('name = "decoupled_cloth"', "", ["unknown effect", "choose from"]),
    ("[effect.slide]", "[effect.slid]", ["decoupled_cloth", "slid", "did you mean slide"]),
    ("value = 0.0127", 'value = "slow"', ["roll", "'slow'", "give a number"]),
    ("value = 0.0127", "value = nan", ["roll", "nan", "outside 0.001 to 0.05"]),
    ("value = 22.0", "value = 500.0", ["spin", "500.0", "outside 1.0 to 80.0", "rad/s^2"]),
    ("value = 22.0", "value = 22.0\nsd = -1.0", ["spin", "-1.0", "positive"]),
    ("[native.slide]", "[nativ.slide]", ["nativ", "did you mean native"]),
    ("[table]", "[table", ["not TOML", "correct that line"]),
]


def shots() -> list[Shot]:
    """A break into three balls, and a swerving shot off two cushions."""
    names = ("white", "yellow", "red")
    place = np.array([[-0.8, 0.1], [0.3, 0.12], [0.9, -0.3]])
    still = np.zeros((3, 2))
    made = []
    for velocity, spin in (([2.4, 0.02], [0, 20, 15]), ([-1.0, 1.9], [30, -20, -60])):
        v, w = still.copy(), np.zeros((3, 3))
        v[0], w[0] = velocity, spin
        made.append(Shot(names, place, v, w, TIMES))
    return made


def blob(track: Track) -> bytes:
    """Every number of a track."""
    return b"".join(a.tobytes() for a in (track.position, track.velocity, track.spin, track.theta))


def bytes_of(tracks: list[Track]) -> list[bytes]:
    """Every number of every track."""
    return [blob(track) for track in tracks]


def tried(kind: type[Effect], key: str) -> Array:
    """Two values of a parameter, within its bounds and not off."""
    meta = kind.parameters()[key]
    low, high = meta["bounds"]
    near = meta["default"] + 0.1 * (high - low)
    return np.array([meta["default"], near if near <= high else meta["default"] - 0.1 * (high - low)])


def base_without(kind: type[Effect]) -> Model:
    """The full model, without what the effect would replace."""
    model = full_model(TABLE, BALL)
    kept = [e for e in model.effects if e.name() != kind.name() and (not kind.slot or e.slot != kind.slot)]
    return dataclasses.replace(model, effects=tuple(kept))


def test_the_shipped_effects_are_found() -> None:
    assert {"decoupled_cloth", "ball_impact", "cushion_impact"} <= set(EFFECTS)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name())
def test_every_parameter_is_declared(kind: type[Effect]) -> None:
    assert dataclasses.is_dataclass(kind)
    assert kind.__doc__
    assert kind.parameters()
    for name, meta in kind.parameters().items():
        assert {"default", "off", "unit", "bounds", "source"} <= set(meta), name
        low, high = meta["bounds"]
        assert math.isfinite(low) and math.isfinite(high), name
        assert low < high, name
        assert low <= meta["default"] <= high, name
        assert meta["off"] is None or math.isfinite(meta["off"]), name
        assert meta["unit"].strip(), f"{name}: a pure number has the unit 1"
        assert len(meta["source"]) > 5, name


@pytest.mark.parametrize("name", EFFECTS)
def test_effects_are_frozen(name: str) -> None:
    effect = catalogue()[name]()
    key = next(iter(effect.parameters()))
    with pytest.raises(dataclasses.FrozenInstanceError):
        setattr(effect, key, 0.0)


@pytest.mark.parametrize("name", EFFECTS)
def test_off_is_absent_to_the_last_bit(name: str) -> None:
    kind = catalogue()[name]
    off = kind(**{key: meta["off"] for key, meta in kind.parameters().items() if meta["off"] is not None})
    without = base_without(kind)
    assert off.is_off()
    assert bytes_of(simulate(without.add(off), shots())) == bytes_of(simulate(without, shots()))


@pytest.mark.parametrize("name", EFFECTS)
def test_the_usual_value_does_something(name: str) -> None:
    without, effect = base_without(catalogue()[name]), catalogue()[name]()
    assert not effect.is_off()
    seen = simulate(without.add(effect), shots())
    changed = bytes_of(seen) != bytes_of(simulate(without, shots()))
    kind = type(effect)
    assert changed or kind.observe is not Effect.observe


@pytest.mark.parametrize(("name", "key"), [(n, k) for n in EFFECTS for k in catalogue()[n].parameters()])
def test_one_value_a_shot_is_the_same_as_one_after_another(name: str, key: str) -> None:
    kind = catalogue()[name]
    without, values = base_without(kind), tried(kind, key)
    together = simulate(without.add(kind(**{key: values})), shots())
    for k, shot in enumerate(shots()):
        alone = simulate(without.add(kind(**{key: float(values[k])})), [shot])
        assert blob(together[k]) == blob(alone[0])


@pytest.mark.parametrize("key", sorted(Native.parameters()))
def test_native_terms_may_differ_from_shot_to_shot(key: str) -> None:
    model, values = Model(TABLE, BALL), tried(Native, key)
    short = [dataclasses.replace(shot, times=TIMES[:5]) for shot in shots()]
    together = simulate(dataclasses.replace(model, native=Native(**{key: values})), short)
    for k, shot in enumerate(short):
        alone = simulate(dataclasses.replace(model, native=Native(**{key: float(values[k])})), [shot])
        assert blob(together[k]) == blob(alone[0])


def test_select_narrows_arrays_and_leaves_numbers() -> None:
    effect = catalogue()["ball_impact"](restitution=np.array([0.8, 0.9, 0.95]), friction=0.05)
    some = effect.select(np.array([2, 0]))
    assert some.restitution.tolist() == [0.95, 0.8]
    assert some.friction == 0.05


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_of_the_same_slot_gives_way(name: str) -> None:
    kind = catalogue()[name]
    model = full_model(TABLE, BALL).add(kind()).add(kind())
    assert [e.name() for e in model.effects].count(name) == 1
    slots = [e.slot for e in model.effects if e.slot]
    assert len(slots) == len(set(slots))


def test_effects_that_react_come_last() -> None:
    stack = full_model(TABLE, BALL).stack()
    assert stack[0].name() == "native"
    assert stack[-1].last


@pytest.mark.parametrize("name", EFFECTS)
def test_model_files_come_back_as_they_were(name: str, tmp_path: Path) -> None:
    kind = catalogue()[name]
    values = {key: float(tried(kind, key)[1]) for key in kind.parameters()}
    model = dataclasses.replace(
        full_model(TABLE, BALL).add(kind(**values)),
        native=Native(slide=0.23),
        estimates={f"{name}.{key}": Estimate(0.01 * k + 0.01, "a fit") for k, key in enumerate(values)},
        fitted={"clips": 12, "command": "sysid fit"},
    )
    path = tmp_path / "deep" / "model.toml"
    write_model(model, path)
    back = read_model(path)
    assert (back.table, back.ball, back.native, back.fitted) == (model.table, model.ball, model.native, model.fitted)
    assert back.effects == model.effects
    assert {key: back.estimates[key] for key in model.estimates} == model.estimates
    again = tmp_path / "again.toml"
    write_model(back, again)
    assert again.read_bytes() == path.read_bytes()
    assert [p.name for p in path.parent.iterdir()] == ["model.toml"], "no scratch file is left"


@pytest.mark.parametrize(("old", "new", "words"), FAULTS, ids=[new or f"no {old}" for old, new, _ in FAULTS])
def test_a_bad_model_file_is_named_in_one_line(old: str, new: str, words: list[str], tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(full_model(TABLE, BALL), path)
    text = path.read_text(encoding="utf-8")
    at = text.rindex(old)
    path.write_text(text[:at] + new + text[at + len(old) :], encoding="utf-8")
    with pytest.raises(BadInput) as error:
        read_model(path)
    message = str(error.value)
    assert "\n" not in message
    for word in (str(path), *words):
        assert word in message


def test_files_that_cannot_be_read_or_written_are_named(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"nowhere\.toml: cannot be read"):
        read_model(tmp_path / "nowhere.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match=r"binary\.toml: cannot be read"):
        read_model(tmp_path / "binary.toml")
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="cannot be written"):
        write_model(full_model(TABLE, BALL), tmp_path / "file" / "model.toml")


def test_constants_are_named_by_effect_and_parameter() -> None:
    model = full_model(TABLE, BALL)
    names = set(model.parameters())
    assert {"decoupled_cloth.slide", "cushion_impact.restitution"} <= names
    assert not any(name.startswith("native.") for name in names), "every native term is replaced"
    assert model.meta("decoupled_cloth.spin")["unit"] == "rad/s^2"
    other = model.with_values({"decoupled_cloth.slide": 0.25, "native.slide": 0.3})
    assert (other.parameters()["decoupled_cloth.slide"], other.native.slide) == (0.25, 0.3)
    assert model.parameters()["decoupled_cloth.slide"] == 0.2
