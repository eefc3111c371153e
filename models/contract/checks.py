"""The contract of every effect, shipped or a user's: each check returns its faults, one line each.

Shots of each kind are played with and without the effect, and the camera's reports are compared to the last bit if the
effect must change nothing; the event engine and the MuJoCo world must agree to 0.05 mm.
"""

from __future__ import annotations

import dataclasses
import math
import pickle
import re
import sys
import traceback
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from models.contract.switches import jump_of
from models.effect import Effect
from models.effect_catalogue import effect_class
from models.engine.play import lacking
from models.files import scratch_folder
from models.hooks import COMPILED_HOOKS, HookError, address
from models.mjcf.native import Native
from models.model_file import Model, full_model, read_model, write_model
from models.shot import Array, Ball, Shot, Table, Track
from models.simulation.observe import observed
from models.simulation.simulate import simulate

TABLE, BALL = Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21)
SAMPLE_TIMES_S = np.linspace(0, 2.5, 51)
TEST_STROKES = (  # velocity [m/s] and spin [rad/s] of the struck ball
    ((2.4, 0.02), (0.0, 20.0, 15.0)),  # a break
    ((-1.0, 1.9), (30.0, -20.0, -60.0)),  # swerve, off two cushions
    ((-1.5, -0.6), (20.0, -50.0, 0.0)),  # rolls to the other two
    ((3.0, 1.4), (0.0, -40.0, 40.0)),  # draw with side, far
    ((0.02, 0.0), (0.0, 0.0, 60.0)),  # spins where it is
)
FEW_STROKES = 2  # number of strokes for a quick comparison
MOTION_TOLERANCE_M = 1e-4  # between the event engine and MuJoCo, with steps of 1 ms, before the first impact
IMPACT_TOLERANCE_M = 0.005  # likewise before the second impact, since impacts have a duration in MuJoCo
Contract = Callable[[type[Effect]], list[str]]


class Broken(Exception):
    """An error raised by an effect's code."""


def played(count: int = len(TEST_STROKES)) -> list[Shot]:
    """Shots of the struck ball past or into two others."""
    names, place = ("white", "yellow", "red"), np.array([[-0.8, 0.1], [0.3, 0.12], [0.9, -0.3]])
    found = []
    for velocity, spin in TEST_STROKES[:count]:
        v, w = np.zeros((3, 2)), np.zeros((3, 3))
        v[0], w[0] = velocity, spin
        found.append(Shot(names, place, v, w, SAMPLE_TIMES_S))
    return found


def numbers(tracks: Sequence[Track]) -> list[bytes]:
    """All numbers of all tracks."""
    return [b"".join(a.tobytes() for a in (t.times, t.position, t.velocity, t.spin, t.theta)) for t in tracks]


def tried(kind: type[Effect], key: str) -> Array:
    """Two values of a parameter, within its bounds."""
    meta = kind.parameters()[key]
    low, high = meta["bounds"]
    near = meta["default"] + 0.1 * (high - low)
    return np.array([meta["default"], near if near <= high else meta["default"] - 0.1 * (high - low)])


def base_without(kind: type[Effect]) -> Model:
    """The full model without the effects that the effect would replace, but with one that it acts on."""
    model = full_model(TABLE, BALL)
    kept = [e for e in model.effects if e.name() != kind.name() and (not kind.slot or e.slot != kind.slot)]
    acted_on = [effect_class(name)() for name in kind.beside[:1]]
    return dataclasses.replace(model, effects=(*kept, *acted_on))


def switched_off(kind: type[Effect]) -> Effect:
    """The effect with every parameter at its off value, if it has one."""
    return kind(**{key: meta["off"] for key, meta in kind.parameters().items() if meta["off"] is not None})


def declared(kind: type[Effect]) -> list[str]:
    """Check docstrings, frozenness, and parameters with unit, bounds, source and off value."""
    faults = []
    if not (sys.modules[kind.__module__].__doc__ or "").strip():
        faults.append("the file has no docstring; state the formula, its source and what it leaves out")
    if not kind.__doc__ or kind.__doc__.startswith(f"{kind.__name__}("):  # written by dataclass
        faults.append(f"class {kind.__name__} has no docstring; describe it in one line")
    if not dataclasses.is_dataclass(kind) or not kind.__dataclass_params__.frozen:  # type: ignore[attr-defined]
        faults.append(f"class {kind.__name__} is not frozen; put @dataclass(frozen=True) above it")
    if not any(meta["off"] is not None for meta in kind.parameters().values()):
        faults.append("no parameter has an off value, so that it is never on; give off to the one that sets the size")
    for name, meta in kind.parameters().items():
        low, high = meta["bounds"]
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            faults.append(f"{name}: bounds {low}, {high}; give two finite numbers, the lower first")
        elif not low <= meta["default"] <= high:
            faults.append(f"{name}: default {meta['default']} is outside {low} to {high}")
        if meta["off"] is not None and not math.isfinite(meta["off"]):
            faults.append(f"{name}: off is {meta['off']}; give a finite number, or None if it only shapes the effect")
        if not meta["unit"].strip():
            faults.append(f"{name}: no unit; a pure number has the unit 1")
        published = meta.get("published")
        if published is not None and not published[0] < meta["default"] <= published[1]:
            low, high = published
            faults.append(f"{name}: default {meta['default']} is outside the published {low} to {high}")
        if len(meta["source"]) <= 5:
            faults.append(f"{name}: no source; state where its value and bounds come from")
    return faults


def compiles(kind: type[Effect]) -> list[str]:
    """Check that every hook compiles, with only its parameters."""
    found = []
    for hook in COMPILED_HOOKS:
        if kind.opens(hook):
            try:
                address(getattr(kind, hook), hook, kind.layout())
            except HookError as error:
                found.append(str(error))
    return found


def off_is_absent(kind: type[Effect]) -> list[str]:
    """Check that it is absent at its off values, to the last bit."""
    without, off = base_without(kind), switched_off(kind)
    if not off.is_off():
        return ["is_off() is not true at the off values"]
    if numbers(observed(without.add(off), played(FEW_STROKES))) != numbers(observed(without, played(FEW_STROKES))):
        return ["shots with every parameter off differ from those without the effect"]
    return []


def usual_acts(kind: type[Effect]) -> list[str]:
    """Check that it is on at its default values, and changes the report of some shot."""
    without, effect = base_without(kind), kind()
    if effect.is_off():
        return ["it is off at its default values; give a default that has an effect"]
    seen = observed(without.add(effect), played())
    if any(not np.isfinite(t.position).all() for t in seen):
        return ["positions are not finite at its default values"]
    if numbers(seen) == numbers(observed(without, played())):
        return ["no shot is changed by its default values; use a hook, or a larger default"]
    return []


def one_value_a_shot(kind: type[Effect]) -> list[str]:
    """Check that a batch with one value per shot equals single shots, to the last bit."""
    without, shots, faults = base_without(kind), played(FEW_STROKES), []
    for key in kind.parameters():
        values = tried(kind, key)
        together = observed(without.add(kind(**{key: values})), shots)
        for k, shot in enumerate(shots):
            alone = observed(without.add(kind(**{key: float(values[k])})), [shot])
            if numbers(together[k : k + 1]) != numbers(alone):
                faults.append(
                    f"{key}: shot {k} of a batch differs from the same alone; let hooks read only self, keep no state"
                )
    return faults


def repeatable(kind: type[Effect]) -> list[str]:
    """Check that a repeated shot is the same, and that a pickled effect is the same effect."""
    model = base_without(kind).add(kind())
    faults = []
    if numbers(observed(model, played(1))) != numbers(observed(model, played(1))):
        faults.append("the same shot differs when played again; keep no state, draw no random numbers")
    if pickle.loads(pickle.dumps(kind())) != kind():
        faults.append("a pickled effect is restored as a different one")
    return faults


def gives_way(kind: type[Effect]) -> list[str]:
    """Check that an effect added twice is there once, and that a slot holds one effect."""
    model = full_model(TABLE, BALL).add(kind()).add(kind())
    slots = [e.slot for e in model.effects if e.slot]
    once = [e.name() for e in model.effects].count(kind.name()) == 1 and len(slots) == len(set(slots))
    return [] if once else [f"after adding it twice, it or its slot {kind.slot!r} is there twice"]


def file_keeps_it(kind: type[Effect]) -> list[str]:
    """Check that a model file restores the effect."""
    effect = kind(**{key: float(tried(kind, key)[1]) for key in kind.parameters()})
    with scratch_folder() as folder:
        path = folder / "model.toml"
        write_model(full_model(TABLE, BALL).add(effect), path)
        back = next(e for e in read_model(path).effects if e.name() == kind.name())
    return [] if back == effect else [f"a model file restores {back} for {effect}"]


def jumps_announced(kind: type[Effect]) -> list[str]:
    """Check that forces which jump along a ball's path have a `horizon` that announces it."""
    if not kind.opens("forces") or kind.opens("horizon"):
        return []
    jump = jump_of(kind(), TABLE, BALL)
    if jump is None:
        return []
    s = jump.state
    where = f"x = {s.x:.4g}, y = {s.y:.4g}, speed {math.hypot(s.vx, s.vy):.4g} m/s, time {s.time:.4g} s"
    return [
        f"forces changes ball.{jump.field} by {jump.size:.3g} abruptly ({where}), within a step of the event engine, "
        "so that fits do not converge: add horizon(self, ball), which returns the time until it switches, or make it "
        "change smoothly (example: models/effects/cloth/worn_patch.py)"
    ]


def engines_agree(kind: type[Effect]) -> list[str]:
    """Check that the event engine and the MuJoCo world agree; skipped if only MuJoCo can play the effect."""
    model, faults = base_without(kind).add(kind()), []
    if lacking(model):
        return []
    shots = played(FEW_STROKES)
    by_engine = [simulate(dataclasses.replace(model, engine=engine), shots) for engine in ("events", "mujoco")]
    for k, (one, other) in enumerate(zip(*by_engine, strict=True)):
        ends = [min(t.events[n].time if len(t.events) > n else math.inf for t in (one, other)) for n in (0, 1)]
        away = np.abs(one.position - other.position)
        apart = [float(away[one.times < end].max(initial=0.0)) for end in ends]
        if not (apart[0] <= MOTION_TOLERANCE_M and apart[1] <= IMPACT_TOLERANCE_M):
            faults.append(
                f"shot {k}: event engine and MuJoCo differ by {1e3 * apart[0]:.3g} mm before the first impact, "
                f"{1e3 * apart[1]:.3g} mm before the second; "
                "let `horizon` announce when a force jumps, and let hooks read only self and their state"
            )
    return faults


CONTRACTS: dict[str, Contract] = {
    c.__name__: c
    for c in (
        declared, compiles, off_is_absent, usual_acts, one_value_a_shot, repeatable, gives_way, file_keeps_it,
        jumps_announced, engines_agree,
    )
}  # fmt: skip
BASIC_CONTRACTS = ("declared", "compiles")  # if these fail, the others give no information


def kept(kind: type[Effect], contract: str) -> list[str]:
    """The faults of one check, including errors in the effect's own code."""
    try:
        return _guarded(CONTRACTS[contract], kind)
    except Broken as error:
        return [str(error)]


def _guarded(contract: Contract, kind: type[Effect]) -> list[str]:
    try:
        return contract(kind)
    except HookError as error:
        raise Broken(str(error)) from error
    except Exception as error:
        own = sys.modules[kind.__module__].__file__
        lines = [n for frame, n in traceback.walk_tb(error.__traceback__) if frame.f_code.co_filename == own]
        where = f"line {lines[-1]}: " if lines else ""
        raise Broken(f"{where}{type(error).__name__}: {' '.join(str(error).split())}") from error


def faults(kind: type[Effect]) -> list[str]:
    """All faults of an effect; only those of its declaration and compilation if there are any."""
    for name in BASIC_CONTRACTS:
        found = [f"{name}: {text}" for text in kept(kind, name)]
        if found or kind is Native:
            return found
    return [f"{name}: {text}" for name in CONTRACTS if name not in BASIC_CONTRACTS for text in kept(kind, name)]


LISTED_HOOKS = ("edit", "forces", "impact", "strike", "exposures", "observe")


def described(kind: type[Effect]) -> dict[str, Any]:
    """The description of an effect: name, hooks, slot, title, first sentence of the formula, parameters."""
    module = sys.modules[kind.__module__]
    says, _, rest = (module.__doc__ or kind.__doc__ or "").strip().partition("\n\n")
    formula = re.split(r"(?<=[^.]\.)\s", " ".join(rest.split()), maxsplit=1)[0]
    return {
        "name": kind.name(), "doors": [hook for hook in LISTED_HOOKS if kind.opens(hook)],
        "slot": kind.slot, "says": " ".join(says.split()),
        "formula": "" if formula.startswith("Source") else formula, "file": module.__file__,
        "parameters": {key: dict(meta) | {"bounds": list(meta["bounds"])} for key, meta in kind.parameters().items()},
    }  # fmt: skip
