"""Effects that MJCF can express: a slope as gravity, nose heights, different rails, the struck ball.

In: a model, and native terms for its contacts. Out: its world as plain MJCF.

The slate is stiffer than that of the shipped table (models/mjcf/base.xml), or a ball that rests on a slope creeps
downhill, and its friction acts within the duration of an impact, or it would be absent while a nose presses the ball
down. In return a slipping ball hops a little higher.

A nose of another height stays where a ball's centre meets it, R cos(theta) from the nose line with the usual theta, as
the effect leaves it (models/effects/impact/nose_height.py): its capsule stands (R + r) cos(theta') from there.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from models.analytic.spring import NOSE_RADIUS
from models.effect import Effect
from models.effects.impact.nose_height import NoseHeight
from models.mjcf.export import spec_of
from models.mjcf.launcher import SLATE_IMPEDANCE
from models.mjcf.native import CONTACT_TIME, Native, solref
from models.mjcf.world import rails
from models.model_file import Model
from models.shot import GRAVITY, NOSE_COSINE, NOSE_SINE, RAIL_NAMES, Array

RAIL_SUFFIXES = dict(zip(RAIL_NAMES, ("px", "mx", "py", "my"), strict=True))  # as in the names of effects
RAIL_EFFECTS = ("nose_height", "cushion_restitution", "cushion_friction")  # each has one effect per rail
OF_RAILS = ("nose_height", *(f"{kind}_{side}" for kind in RAIL_EFFECTS for side in RAIL_SUFFIXES.values()))
OF_STRUCK_BALL = ("cue_ball_mass", "struck_ball_slide", "struck_ball_roll")
EXPRESSIBLE = ("table_tilt", *OF_RAILS, *OF_STRUCK_BALL)  # effects that MJCF can express


def is_expressible(effect: Effect) -> bool:
    """Whether MJCF can express an effect."""
    return effect.name() in EXPRESSIBLE or (effect.opens("edit") and not effect.slot)


def without(model: Model, names: Sequence[str]) -> Model:
    """The model without these effects."""
    return dataclasses.replace(model, effects=tuple(e for e in model.effects if e.name() not in names))


def value(model: Model, name: str, off: float = 0.0) -> float:
    """A parameter of an effect, or its value if the effect is absent."""
    return float(model.parameters().get(name, off))


def at_rail(model: Model, rail: str) -> Model:
    """The model with all cushions like the one at a rail of RAIL_NAMES, whose changes are added to the constants."""
    side, base = RAIL_SUFFIXES[rail], "cushion_impact."
    found = without(model, OF_RAILS)
    for key, high in (("restitution", 1.0), ("friction", np.inf)):
        change = value(model, f"cushion_{key}_{side}.change")
        if change:
            found = found.with_values({base + key: float(np.clip(value(model, base + key) + change, 0.0, high))})
    height = value(model, "nose_height.change") + value(model, f"nose_height_{side}.change")
    return found.add(NoseHeight(height)) if height else found


def plain_spec(
    model: Model, places: Mapping[str, Array], rail_terms: Mapping[str, Native] | None = None, *,
    launcher: bool = False, bare: bool = False,
) -> mujoco.MjSpec:  # fmt: skip
    """A model's world in plain MJCF, including the effects that MJCF can express.

    Args:
        model: its native terms define the contacts.
        places: initial place of each ball, (2,) [m]; the first is the one to be struck.
        rail_terms: native terms of the cushions, by RAIL_NAMES, where they differ.
        launcher: with the cue launcher behind the first ball.
        bare: without purely visual parts.
    """
    spec = spec_of(model, places, launcher=launcher, bare=bare)
    for pair in spec.pairs:
        if "bed" in (pair.geomname1, pair.geomname2):
            pair.solimp, pair.solreffriction = SLATE_IMPEDANCE, [CONTACT_TIME, 1.0]
    slope = [value(model, f"table_tilt.slope_{axis}") for axis in "xy"]
    if any(slope):
        spec.option.gravity = [GRAVITY * slope[0], GRAVITY * slope[1], -GRAVITY]
    _say_struck_ball(spec, model, next(iter(places)))
    radius = model.ball.radius
    for number, rail in enumerate(rails(model.table)):
        name = f"cushion {number} {rail.side}"
        sine = NOSE_SINE + value(at_rail(model, rail.side), "nose_height.change")
        if sine != NOSE_SINE:
            geom = next(g for g in spec.geoms if g.name == name)
            across = (radius + NOSE_RADIUS) * np.sqrt(1.0 - sine * sine) - radius * NOSE_COSINE
            height = radius + (radius + NOSE_RADIUS) * sine
            ends = [np.append(np.array(end) + across * rail.outward, height) for end in (rail.start, rail.end)]
            geom.fromto = np.concatenate(ends)
        if rail_terms and rail.side in rail_terms:
            _say_cushion(spec, name, rail_terms[rail.side])
    for effect in model.stack()[1:]:
        if effect.opens("edit") and not effect.slot:
            effect.edit(spec)
    return spec


def _say_struck_ball(spec: mujoco.MjSpec, model: Model, name: str) -> None:
    body, factor = spec.body(name), value(model, "cue_ball_mass.factor", 1.0)
    if factor != 1.0:
        body.mass, body.inertia = body.mass * factor, np.asarray(body.inertia) * factor
    slide, roll = (1.0 + value(model, f"struck_ball_{key}.change") for key in ("slide", "roll"))
    bed = next(p for p in spec.pairs if {p.geomname1, p.geomname2} == {f"ball {name}", "bed"})
    bed.friction = np.asarray(bed.friction) * [slide, slide, 1.0, roll, roll]


def _say_cushion(spec: mujoco.MjSpec, name: str, native: Native) -> None:
    for pair in spec.pairs:
        if name in (pair.geomname1, pair.geomname2):
            pair.friction = [native.cushion_friction, native.cushion_friction, 0, 0, 0]
            pair.solref = solref(float(native.cushion_restitution))
            pair.solreffriction = [native.cushion_grip, 1.0]
