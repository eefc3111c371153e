"""The error of a plain file relative to its model, in metres, by cause.

In: a model and the native terms of its file. Out: `Cost`s: median distance of the struck ball over shots.

Causes are tested one at a time. For the cloth, MuJoCo's contact replaces it in models/mujoco, where impacts are
unchanged; for a kind of impact, each one is played in the file and the motion between by the model; an effect that a
file cannot express is removed. The costs do not add up to the total, the distance between the model and the file.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.effect import Effect
from models.model_file import Model
from models.shot import Array, Shot, Track
from models.simulation.simulate import simulate
from sysid.mjcf.player import play_plain
from sysid.mjcf.said import EXPRESSIBLE, is_expressible, without
from sysid.mjcf.terms import FittedTerms
from sysid.validation.shots import LEAD_TIME_S, two_ball_shots
from sysid.validation.tested_models import SETTLING_TIME_S

log = logging.getLogger(__name__)
SHOTS, SECONDS = 200, 4.0
ALL_TOGETHER = "all together"
OF_CONTACTS = {  # limits of MuJoCo's contacts, by the contact that an effect replaces
    "cloth": "MuJoCo's cloth, where sliding, rolling and turning share one friction",
    "ball": "MuJoCo's impacts between balls, in the shots that have one",
    "cushion": "MuJoCo's impacts at cushions, in the shots that have one",
}


@dataclass(frozen=True)
class Cost:
    """The displacement of the struck ball by something that a file leaves out."""

    cause: str
    median_m: float


def taken_over(effect: Effect) -> str:
    """The contact of MuJoCo's that an effect replaces, a key of OF_CONTACTS; "" for none."""
    return "cloth" if effect.slot == "cloth" else effect.resolves


def costs_of(model: Model, terms: FittedTerms) -> tuple[Cost, ...]:
    """Costs of the file of a model: in total, then by cause, the largest first; empty if nothing is left out."""
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
    level = without(model, EXPRESSIBLE)
    flat = whole if level.effects == model.effects else ends(level, "the model without the effects in the file")
    parts = []
    for contact, cause in OF_CONTACTS.items():
        own = [e.name() for e in level.stack()[1:] if taken_over(e) == contact]
        if own:
            if contact == "cloth":
                found_ends = ends(dataclasses.replace(without(level, own), engine="mujoco"), cause)
            else:
                log.info("%d shots: %s", len(shots), cause)
                found_ends = _ends_with_impacts(model, shots, contact, terms)
            if np.isfinite(found_ends).any():
                parts.append(Cost(cause, _apart(found_ends, flat if contact == "cloth" else whole)))
    for effect in left_out(model):
        parts.append(Cost(effect.name(), _apart(ends(without(model, (effect.name(),)), effect.name()), whole)))
    return (*found, *sorted(parts, key=lambda cost: -cost.median_m))


def _ends_with_impacts(model: Model, shots: Sequence[Shot], kind: str, terms: FittedTerms) -> Array:
    """Ends of struck balls if the file plays impacts of a kind and the model the rest: (n, 2) [m], nan if none."""
    ends, going = np.full((len(shots), 2), np.nan), np.arange(len(shots))
    now, whole = list(shots), np.array([shot.times[-1] for shot in shots])
    left = whole.copy()
    span = np.array([0.0, LEAD_TIME_S + SETTLING_TIME_S["native"]])
    while going.size:
        tracks = simulate(model, [_until(now[k], left[k]) for k in going])
        first = [next((e.time for e in t.events if e.kind == kind), np.inf) for t in tracks]
        before = np.maximum(np.array(first) - LEAD_TIME_S, 0.0)
        over = before + span[1] > left[going]
        for k, track, done in zip(going, tracks, over, strict=True):
            if done and left[k] < whole[k]:
                ends[k] = track.position[-1, 0]
        going, before = going[~over], before[~over]
        if going.size:
            reached = simulate(model, [_until(now[k], t) for k, t in zip(going, before, strict=True)])
            met = [dataclasses.replace(_from_end(now[k], t), times=span) for k, t in zip(going, reached, strict=True)]
            for k, track in zip(going, play_plain(model, met, terms.of_rails), strict=True):
                now[k] = _from_end(now[k], track)
            left[going] -= before + span[1]
    return ends


def _until(shot: Shot, end: float) -> Shot:
    return dataclasses.replace(shot, times=np.array([0.0, end]))


def _from_end(shot: Shot, track: Track) -> Shot:
    """The shot that continues from the end of a track."""
    position, velocity, spin = (getattr(track, key)[-1] for key in ("position", "velocity", "spin"))
    return dataclasses.replace(shot, position=position, velocity=velocity, spin=spin, struck=False)


def left_out(model: Model) -> tuple[Effect, ...]:
    """Effects on the motion that neither MJCF nor MuJoCo's contacts can express."""
    return tuple(e for e in model.stack()[1:] if moves_balls(e) and not is_expressible(e) and not taken_over(e))


def moves_balls(effect: Effect) -> bool:
    """Whether an effect changes the motion, not only the camera's report."""
    return effect.opens("forces", "horizon", "impact", "strike", "edit")


def _ends(tracks: Sequence[Track]) -> Array:
    return np.array([track.position[-1, 0] for track in tracks])


def _apart(one: Array, two: Array) -> float:
    """Median distance between positions (n, 2) [m], without unknown ones."""
    return float(np.nanmedian(np.hypot(*(one - two).T)))
