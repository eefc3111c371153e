"""What every effect owes the workbench, shipped or new: declared parameters, off is absent, files that come back."""

from __future__ import annotations

import dataclasses
import math
import random
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from models.contract.checks import BALL, CONTRACTS, SAMPLE_TIMES_S, TABLE, faults, kept, numbers, played, tried
from models.effect import BallState, Effect, ImageState, param, push_along
from models.effect_catalogue import catalogue
from models.errors import BadInput
from models.mjcf.native import Native
from models.model_file import Estimate, Model, full_model, read_model, write_model
from models.simulation.simulate import simulate

EFFECTS = sorted(catalogue())
FAULTS = [  # text to replace in a good file, its replacement, what the message must name
    (
        'format = "billiard-model/1"',
        'format = "billiard-model/9"',
        ["billiard-model/9", 'reads format = "billiard-model/1"'],
    ),
    ("length = 2.84", 'length = "long"', ["length", "'long'", "a number in m"]),
    ("width = 1.42", "width = -1.0", ["width", "-1.0", "not positive"]),
    ("mass = 0.21", "", ["mass is missing", "kg"]),
    ("pockets = false", 'pockets = "no"', ["pockets", "'no'", "true or false"]),
    ('name = "decoupled_cloth"', 'name = "decoupled_cloht"', ["decoupled_cloht", "did you mean decoupled_cloth"]),
    ('name = "decoupled_cloth"', "", ["unknown effect", "see sysid effects"]),
    ("[effect.slide]", "[effect.slid]", ["decoupled_cloth", "slid", "did you mean 'slide'"]),
    ("value = 0.0127", 'value = "slow"', ["roll", "'slow'", "write a number"]),
    ("value = 0.0127", "value = nan", ["roll = nan is not finite", "0.001 to 0.05"]),
    ("value = 22.0", "value = 500.0", ["spin", "500.0", "outside 1 to 80", "rad/s^2"]),
    ("value = 22.0", "value = 22.0\nsd = -1.0", ["spin", "-1.0", "positive"]),
    ("[native.slide]", "[nativ.slide]", ["nativ", "did you mean 'native'"]),
    ("[table]", "[table", ["not TOML", "correct that line"]),
]


def test_the_shipped_effects_are_found() -> None:
    assert {"decoupled_cloth", "ball_impact", "cushion_impact"} <= set(EFFECTS)


@pytest.mark.parametrize("contract", CONTRACTS)
@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_keeps_its_contract(name: str, contract: str) -> None:
    assert kept(catalogue()[name], contract) == []


def test_native_terms_are_declared() -> None:
    assert faults(Native) == []


@pytest.mark.parametrize("key", sorted(Native.parameters()))
def test_native_terms_may_differ_from_shot_to_shot(key: str) -> None:
    model, values = Model(TABLE, BALL), tried(Native, key)
    short = [dataclasses.replace(shot, times=SAMPLE_TIMES_S[:5]) for shot in played(2)]
    together = simulate(dataclasses.replace(model, native=Native(**{key: values})), short)
    for k, shot in enumerate(short):
        alone = simulate(dataclasses.replace(model, native=Native(**{key: float(values[k])})), [shot])
        assert numbers(together[k : k + 1]) == numbers(alone)


def test_select_narrows_arrays_and_leaves_numbers() -> None:
    effect = catalogue()["ball_impact"](restitution=np.array([0.8, 0.9, 0.95]), friction=0.05)
    some = effect.select(np.array([2, 0]))
    assert some.restitution.tolist() == [0.95, 0.8]
    assert some.friction == 0.05


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
        fitted={"clips": ["clips/0001.csv"], "command": "sysid fit"},
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
    (tmp_path / "binary.toml").write_bytes(b"\xff\x00")
    with pytest.raises(BadInput, match=r"binary\.toml, line 1: byte 0xff is not UTF-8"):
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


@dataclass(frozen=True)
class Careless(Effect):
    """It does what no effect may do."""

    size: float = param(5.0, off=None, unit=" ", bounds=(0.0, 1.0), source="?")


@dataclass(frozen=True)
class Push(Effect):
    """A push that is still there when it is off."""

    size: float = param(0.1, off=0.0, unit="m/s^2", bounds=(0.0, 1.0), source="nowhere")

    def is_off(self) -> bool:
        return False

    def forces(self, ball: BallState) -> None:
        ball.ax += self.size + 0.01


@dataclass(frozen=True)
class Listing(Effect):
    """A hook that is no arithmetic on numbers."""

    size: float = param(0.1, off=0.0, unit="m/s^2", bounds=(0.0, 1.0), source="nowhere")

    def forces(self, ball: BallState) -> None:
        ball.ax += {"x": self.size}.copy().nothing


@dataclass(frozen=True)
class Misspelt(Effect):
    """A field that the state does not have."""

    size: float = param(0.1, off=0.0, unit="m/s^2", bounds=(0.0, 1.0), source="nowhere")

    def forces(self, ball: BallState) -> None:
        ball.acceleration += self.size  # type: ignore[attr-defined]


@dataclass(frozen=True)
class Step(Effect):
    """A force on a strip of the cloth, which does not say when a ball comes to it."""

    size: float = param(1.0, off=0.0, unit="m/s^2", bounds=(0.0, 2.0), source="nowhere")

    def forces(self, ball: BallState) -> None:
        if ball.weight > 0 and -0.5 < ball.x < -0.3:
            ball.ay += self.size


@dataclass(frozen=True)
class Faint(Effect):
    """A drag from some speed on, so slight that engines agree on a few shots."""

    size: float = param(0.002, off=0.0, unit="m/s^2", bounds=(0.0, 2.0), source="nowhere")

    def forces(self, ball: BallState) -> None:
        if ball.rolling and math.hypot(ball.vx, ball.vy) > 0.7:
            push_along(ball, -self.size, 0.0)


@dataclass(frozen=True)
class Idle(Effect):
    """Nothing."""

    size: float = param(0.1, off=0.0, unit="1", bounds=(0.0, 1.0), source="nowhere")


@dataclass(frozen=True)
class Drunk(Effect):
    """Another camera every time."""

    size: float = param(0.1, off=0.0, unit="1", bounds=(0.0, 1.0), source="nowhere")

    def observe(self, image: ImageState) -> None:
        image.x += self.size * random.random()


@pytest.mark.parametrize(
    ("kind", "contract", "says"),
    [
        (Careless, "declared", ["never on", "default 5.0 is outside", "no unit", "no source"]),
        (Listing, "compiles", ["Listing.forces does not compile", "line ", "write plain arithmetic on numbers"]),
        (Misspelt, "compiles", ["Misspelt.forces uses 'acceleration'", "correct the name"]),
        (Push, "off_is_absent", ["is_off()"]), (Step, "engines_agree", ["differ by", "let `horizon` announce"]),
        (Step, "jumps_announced", ["ball.ay by 1 abruptly", "add horizon(self, ball)"]),
        (Faint, "jumps_announced", ["abruptly", "speed 0.7 m/s", "add horizon(self, ball)"]),
        (Idle, "usual_acts", ["no shot is changed"]), (Drunk, "repeatable", ["differs when played again"]),
    ],
)  # fmt: skip
def test_broken_contracts_are_named(kind: type[Effect], contract: str, says: list[str]) -> None:
    found = "\n".join(kept(kind, contract))
    for text in says:
        assert text in found
    assert all(line.isprintable() for line in found.splitlines())


def test_a_hook_that_does_not_compile_is_the_only_fault_told() -> None:
    [line] = faults(Listing)
    assert line.startswith("compiles: Listing.forces does not compile") and line.isprintable()
