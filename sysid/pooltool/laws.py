"""A model's constants as pooltool's, by the laws there that come nearest, and what of the model no law there has.

Cloth: sliding and rolling friction are the same laws; u_sp = 2 R alpha / (5 g) gives the deceleration alpha of
sidespin. Balls: `frictional_mathavan` is Mathavan 2014, its friction constant (`average`) or a + b exp(-c v)
(`alciatore`), there at the slip before the impact. Cushions: `mathavan_2010`, with the nose's height; a nose that gives
way along its face may come nearer to `stronge_compliant`, which knows no cloth: there omega_t / omega_n is sqrt(7 / (2
compliance)), and the contact's normal points from the nose's height at a distance R, so that a sine s of it needs the
height R (1 + s / sqrt(1 - s^2)).

pooltool's systems hold no laws: these go into a file of their own, for `Resolver.load`. Left out are effects that no
law there has; their cost is measured (sysid/pooltool/losses.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from models.engine.play import lacking
from models.errors import BadInput
from models.model_file import Model, effect_class
from models.shot import GRAVITY, NOSE_SINE, RAIL_NAMES

RESOLVER_VERSION = 9  # of pooltool 0.6
MIN_FRICTION = 1e-9  # pooltool takes none that is 0
# Its impacts take steps of the first order. Two balls part up to one of them too late, by (1 + e) / (2 n) of the speed:
# with n = 50,000 a ball of 2 m/s rolls out less than a millimetre further. Those at cushions end exactly.
BALL_STEPS, CUSHION_STEPS = 50_000, 10_000
IMPULSE_STEP = 1e-5  # [N s], at least, of those at cushions
OMEGA_RATIOS = (1.0, 2.0)  # that `stronge_compliant` takes
DEFAULT_OMEGA_RATIO = 1.8  # of pooltool's own laws
ALCIATORE = {"a": 0.009951, "b": 0.108, "c": 1.088}  # friction of its balls by its own laws (Alciatore TP A.14)
END_MASS_RATIO = 30.0  # of a ball over the end of pooltool's own cue
CONSTANT_EFFECTS = ("decoupled_cloth", "ball_impact", "cushion_impact")
TAKEN = (*CONSTANT_EFFECTS, "ball_friction_speed", "nose_height", "struck_ball_slide", "struck_ball_roll", "squirt")
CUSHION_LAW_EFFECTS = ("cushion_compliance", "soft_bed")
RAIL_EFFECTS = dict(
    zip(RAIL_NAMES, ("nose_height_px", "nose_height_mx", "nose_height_py", "nose_height_my"), strict=True)
)


@dataclass(frozen=True)
class Laws:
    """What pooltool plays for a model."""

    struck: Mapping[str, float]  # its `BallParams` of the struck ball
    others: Mapping[str, float]
    heights: Mapping[str, float]  # of the noses, by rail [m]
    end_mass: float  # of its cue [kg]
    resolver: Mapping[str, Any]  # its `Resolver`, as plain values
    cushion: str  # name there of the law of cushions
    played: Model  # the same in our effects
    lost: tuple[str, ...]  # effects that no law there has


def laws_of(model: Model, *, compliant: bool = False) -> Laws:
    """A model as pooltool has it.

    Args:
        model: with the sizes that are played (`Model.as_played`).
        compliant: by `stronge_compliant` at cushions in place of `mathavan_2010`.

    Raises:
        BadInput: for a model without effects for cloth, balls and cushions.
    """
    acting = {e.name(): e for e in model.stack()[1:]}
    if missing := [name for name in CONSTANT_EFFECTS if name not in acting]:
        why = lacking(model) or f"it has no {missing[0]}"
        raise BadInput(f"the model is none that pooltool has laws for: {why}; fit one that starts from the base")
    values = {name: float(value) for name, value in model.parameters().items() if "." in name}
    radius, mass = model.ball.radius, model.ball.mass
    shared = {
        "m": mass, "R": radius, "u_b": _some(values["ball_impact.friction"]), "e_b": values["ball_impact.restitution"],
        "e_c": values["cushion_impact.restitution"], "f_c": _some(values["cushion_impact.friction"]), "g": GRAVITY,
        "u_s": _some(values["decoupled_cloth.slide"]), "u_r": _some(values["decoupled_cloth.roll"]),
        "u_sp_proportionality": _some(0.4 * values["decoupled_cloth.spin"] / GRAVITY),
    }  # fmt: skip
    struck = dict(shared)
    struck["u_s"] *= 1.0 + values.get("struck_ball_slide.change", 0.0)
    struck["u_r"] *= 1.0 + values.get("struck_ball_roll.change", 0.0)
    end_mass, throttle = _squirt(values.get("squirt.per_offset", 0.0), radius, mass)
    ratio = values.get("cushion_compliance.ratio", 0.0)
    omega = min(max(math.sqrt(3.5 / ratio) if ratio > 0 else OMEGA_RATIOS[1], OMEGA_RATIOS[0]), OMEGA_RATIOS[1])
    heights = {}
    for rail in RAIL_NAMES:
        sine = NOSE_SINE + values.get("nose_height.change", 0.0) + values.get(f"{RAIL_EFFECTS[rail]}.change", 0.0)
        heights[rail] = radius * (1.0 + (sine / math.sqrt(1.0 - sine * sine) if compliant else sine))
    friction: dict[str, Any] = {"model": "average"}
    if "ball_friction_speed" in acting:
        curve = (values["ball_impact.friction"], *(values[f"ball_friction_speed.{key}"] for key in ("gain", "decay")))
        friction = {**dict(zip("abc", curve, strict=True)), "model": "alciatore"}
    lost = tuple(
        name
        for name, effect in acting.items()
        if name not in (*TAKEN, *RAIL_EFFECTS.values()) and effect.opens("forces", "impact", "strike", "edit")
        and not (compliant and name in CUSHION_LAW_EFFECTS)
    )  # fmt: skip
    played = model
    for name in lost:
        played = played.without(name)
    if compliant:
        played = with_effect(played, "cushion_compliance", ratio=3.5 / omega**2)
        played = with_effect(played, "soft_bed", share=1.0)
    name = "stronge_compliant" if compliant else "mathavan_2010"
    cushion = {"omega_ratio": omega} if compliant else {"max_steps": CUSHION_STEPS, "delta_p": IMPULSE_STEP}
    resolver = {
        "ball_ball": {"friction": friction, "num_iterations": BALL_STEPS, "model": "frictional_mathavan"},
        "ball_linear_cushion": {**cushion, "model": name}, "ball_circular_cushion": {**cushion, "model": name},
        "ball_pocket": {"model": "canonical"},
        "stick_ball": {"english_throttle": 1.0, "squirt_throttle": throttle, "model": "instantaneous_point"},
        "transition": {"model": "canonical"}, "version": RESOLVER_VERSION,
    }  # fmt: skip
    return Laws(struck, shared, heights, end_mass, resolver, name, played, lost)


def own_cushions(played: Model) -> Model:
    """What is played, with the cushions of pooltool's own laws, which it takes where no laws are loaded."""
    sine = NOSE_SINE + float(played.parameters().get("nose_height.change", 0.0))
    # A height meant for mathavan_2010 is read by stronge_compliant at a distance R.
    change = math.sin(math.atan(sine)) - NOSE_SINE
    model = with_effect(with_effect(played, "soft_bed", share=1.0), "nose_height", change=change)
    return with_effect(model, "cushion_compliance", ratio=3.5 / DEFAULT_OMEGA_RATIO**2)


def own_ball_friction(played: Model) -> Model:
    """What is played, with the friction of balls of pooltool's own laws."""
    model = played.with_values({"ball_impact.friction": ALCIATORE["a"]})
    return with_effect(model, "ball_friction_speed", gain=ALCIATORE["b"], decay=ALCIATORE["c"])


def with_effect(model: Model, name: str, **values: float) -> Model:
    """The model with an effect of these values, in place of one of that name."""
    return model.add(effect_class(name)(**values))


def _some(friction: float) -> float:
    return max(friction, MIN_FRICTION)


def _squirt(per_offset: float, radius: float, mass: float) -> tuple[float, float]:
    """End mass of the cue [kg], and pooltool's throttle of squirt, for an angle per offset [rad/m].

    tan = 5/2 a / (7/2 + M / m_e) for a small offset a R; the throttle does what no end mass would.
    """
    ratio = 2.5 / (per_offset * radius) - 3.5 if per_offset > 0 else 0.0
    if ratio > 1.0:
        return mass / ratio, 1.0
    return mass / END_MASS_RATIO, per_offset * radius * (3.5 + END_MASS_RATIO) / 2.5
