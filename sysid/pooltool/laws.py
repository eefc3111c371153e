"""A model's constants as pooltool's, by the closest laws, and the effects that pooltool has no law for.

Cloth: sliding and rolling friction are the same laws; u_sp = 2 R alpha / (5 g) gives the deceleration alpha of
sidespin. Balls: `frictional_mathavan` is Mathavan 2014, its friction constant (`average`) or a + b exp(-c v)
(`alciatore`), there at the slip before the impact. Cushions: `mathavan_2010`, with the nose's height; a nose that gives
way along its face may be closer to `stronge_compliant`, which ignores the cloth: there omega_t / omega_n is sqrt(7 / (2
compliance)), and the contact's normal points from the nose's height at a distance R, so that its sine s requires the
height R (1 + s / sqrt(1 - s^2)).

pooltool's systems hold no laws: these go into a separate file, for `Resolver.load`. Effects without a law there are
left out; their cost is measured (sysid/pooltool/losses.py).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from models.effect_catalogue import effect_class
from models.engine.play import lacking
from models.errors import BadInput
from models.model_file import Model
from models.shot import GRAVITY, NOSE_SINE, RAIL_NAMES

RESOLVER_VERSION = 9  # of pooltool 0.6
MIN_FRICTION = 1e-9  # pooltool does not accept 0
# Its impacts use first-order steps. Two balls separate up to a step too late, which adds (1 + e) / (2 n) of the speed:
# with n = 50,000 a ball of 2 m/s rolls less than a millimetre further. Impacts at cushions end exactly.
BALL_STEPS, CUSHION_STEPS = 50_000, 10_000
IMPULSE_STEP = 1e-5  # least step of impacts at cushions [N s]
OMEGA_RATIOS = (1.0, 2.0)  # range that `stronge_compliant` accepts
DEFAULT_OMEGA_RATIO = 1.8  # value in pooltool's own laws
ALCIATORE_FRICTION = {"a": 0.009951, "b": 0.108, "c": 1.088}  # friction of balls in its own laws (TP A.14)
END_MASS_RATIO = 30.0  # mass of a ball over the end mass of pooltool's own cue
CONSTANT_EFFECTS = ("decoupled_cloth", "ball_impact", "cushion_impact")
MAPPED_EFFECTS = (
    *CONSTANT_EFFECTS, "ball_friction_speed", "nose_height", "struck_ball_slide", "struck_ball_roll", "squirt",
)  # fmt: skip
CUSHION_LAW_EFFECTS = ("cushion_compliance", "soft_bed")
RAIL_EFFECTS = dict(
    zip(RAIL_NAMES, ("nose_height_px", "nose_height_mx", "nose_height_py", "nose_height_my"), strict=True)
)


@dataclass(frozen=True)
class Laws:
    """The laws and parameters with which pooltool plays a model."""

    struck: Mapping[str, float]  # its `BallParams` of the struck ball
    others: Mapping[str, float]
    heights: Mapping[str, float]  # of the noses, by rail [m]
    end_mass: float  # of its cue [kg]
    resolver: Mapping[str, Any]  # its `Resolver`, as plain values
    cushion: str  # name there of the law of cushions
    played: Model  # the same laws as our effects
    lost: tuple[str, ...]  # effects that pooltool has no law for


def laws_of(model: Model, *, compliant: bool = False) -> Laws:
    """The laws that represent a model in pooltool.

    Args:
        model: with the sizes used in play (`Model.as_played`).
        compliant: use `stronge_compliant` at cushions instead of `mathavan_2010`.

    Raises:
        BadInput: for a model without effects for cloth, balls and cushions.
    """
    acting = {e.name(): e for e in model.stack()[1:]}
    if missing := [name for name in CONSTANT_EFFECTS if name not in acting]:
        why = lacking(model) or f"it has no {missing[0]}"
        raise BadInput(f"pooltool has no laws for this model: {why}; fit one that starts from the base")
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
        if name not in (*MAPPED_EFFECTS, *RAIL_EFFECTS.values()) and effect.opens("forces", "impact", "strike", "edit")
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
    """The played model with the cushions of pooltool's default laws, used if no laws are loaded."""
    sine = NOSE_SINE + float(played.parameters().get("nose_height.change", 0.0))
    # stronge_compliant interprets a height meant for mathavan_2010 at a distance R.
    change = math.sin(math.atan(sine)) - NOSE_SINE
    model = with_effect(with_effect(played, "soft_bed", share=1.0), "nose_height", change=change)
    return with_effect(model, "cushion_compliance", ratio=3.5 / DEFAULT_OMEGA_RATIO**2)


def own_ball_friction(played: Model) -> Model:
    """The played model with the friction of balls of pooltool's default laws."""
    model = played.with_values({"ball_impact.friction": ALCIATORE_FRICTION["a"]})
    return with_effect(model, "ball_friction_speed", gain=ALCIATORE_FRICTION["b"], decay=ALCIATORE_FRICTION["c"])


def with_effect(model: Model, name: str, **values: float) -> Model:
    """The model with an effect of these values, replacing the one of that name."""
    return model.add(effect_class(name)(**values))


def _some(friction: float) -> float:
    return max(friction, MIN_FRICTION)


def _squirt(per_offset: float, radius: float, mass: float) -> tuple[float, float]:
    """End mass of the cue [kg], and pooltool's throttle of squirt, for an angle per offset [rad/m].

    tan = 5/2 a / (7/2 + M / m_e) for a small offset a R; the throttle covers angles that no end mass gives.
    """
    ratio = 2.5 / (per_offset * radius) - 3.5 if per_offset > 0 else 0.0
    if ratio > 1.0:
        return mass / ratio, 1.0
    return mass / END_MASS_RATIO, per_offset * radius * (3.5 + END_MASS_RATIO) / 2.5
