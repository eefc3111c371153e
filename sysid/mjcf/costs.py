"""What a plain file leaves out of a model's motion, in metres, by cause.

In: a model and the native terms of its file. Out: `Cost`s, the median over shots of how far the struck ball is away.

Causes are left out one at a time: the cloth, and each kind of impact, gives way to MuJoCo's contact in models/mujoco,
where the others stay; an effect that a file does not say is taken away. They do not add up to what is lost all
together, which is the distance between the model and the file itself.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model
from models.shot import Array, Track
from models.simulation.simulate import simulate
from sysid.mjcf.player import play_plain
from sysid.mjcf.said import SAID, is_said, without
from sysid.mjcf.terms import FittedTerms
from sysid.validation.native_fit import TERMS_BY_CASE, tune
from sysid.validation.shots import two_ball_shots

log = logging.getLogger(__name__)
SHOTS, SECONDS = 200, 4.0
ALL_TOGETHER = "all together"
OF_CONTACTS = {  # what MuJoCo's contacts cannot do, by what an effect takes over
    "cloth": "MuJoCo's cloth, where sliding, rolling and turning share one friction",
    "ball": "MuJoCo's impacts between balls",
    "cushion": "MuJoCo's impacts at cushions",
}


@dataclass(frozen=True)
class Cost:
    """By how much something that a file leaves out moves the struck ball."""

    cause: str
    median_m: float


def taken_over(effect: Effect) -> str:
    """Which contact of MuJoCo's an effect takes over, of OF_CONTACTS; "" for none."""
    return "cloth" if effect.slot == "cloth" else effect.resolves


def costs_of(model: Model, terms: FittedTerms) -> tuple[Cost, ...]:
    """What the file of a model leaves out of its motion: all together, then by cause, the largest first; or nothing."""
    if not left_out(model) and not any(map(taken_over, model.stack()[1:])):
        return ()
    model = dataclasses.replace(model, table=dataclasses.replace(model.table, pockets=False), native=terms.native)
    shots = [
        dataclasses.replace(shot, times=np.array([0.0, SECONDS]))
        for shot in two_ball_shots(SHOTS, model.table, model.ball)
    ]

    def ends(played: Model, cause: str) -> Array:
        log.info("%d shots: %s", len(shots), cause)
        return _ends(simulate(played, shots))

    whole = ends(model, "the model")
    log.info("%d shots: the file", len(shots))
    found = [Cost(ALL_TOGETHER, _apart(_ends(play_plain(model, shots, terms.of_rails)), whole))]
    level = without(model, SAID)
    flat = whole if level.effects == model.effects else ends(level, "the model without what the file says")
    parts = []
    for contact, cause in OF_CONTACTS.items():
        own = [e.name() for e in level.stack()[1:] if taken_over(e) == contact]
        if own:
            rest = without(level, own)
            native = terms.native
            if contact == "cushion":  # whose terms depend on how the slate answers the nose
                native = tune(contact, TERMS_BY_CASE[contact], native, level, kept=rest.effects)
            hybrid = dataclasses.replace(rest, native=native, engine="mujoco")
            parts.append(Cost(cause, _apart(ends(hybrid, cause), flat)))
    for effect in left_out(model):
        parts.append(Cost(effect.name(), _apart(ends(without(model, (effect.name(),)), effect.name()), whole)))
    return (*found, *sorted(parts, key=lambda cost: -cost.median_m))


def left_out(model: Model) -> tuple[Effect, ...]:
    """Effects of the motion that neither MJCF says nor MuJoCo's contacts stand for."""
    return tuple(e for e in model.stack()[1:] if moves_balls(e) and not is_said(e) and not taken_over(e))


def moves_balls(effect: Effect) -> bool:
    """Whether it changes the motion, and not only what is seen of it."""
    return effect.opens("forces", "horizon", "impact", "strike", "edit")


def _ends(tracks: Sequence[Track]) -> Array:
    return np.array([track.position[-1, 0] for track in tracks])


def _apart(one: Array, two: Array) -> float:
    """Median distance of places (n, 2) [m]."""
    return float(np.median(np.hypot(*(one - two).T)))
