"""What a plain file leaves out of a model's motion, in metres, by cause.

In: a model and the native terms of its file. Out: `Cost`s, the median over shots of how far the struck ball is away.

Causes are left out one at a time. The cloth gives way to MuJoCo's contact in models/mujoco, where impacts stay as they
are; each impact of a kind is played in the file, and what is between them by the model; an effect that a file does not
say is taken away. They do not add up to what is lost all together, the distance between the model and the file.
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
from sysid.mjcf.said import SAID, is_said, without
from sysid.mjcf.terms import FittedTerms
from sysid.validation.match import SETTLING_TIME_S
from sysid.validation.shots import LEAD_TIME_S, two_ball_shots

log = logging.getLogger(__name__)
SHOTS, SECONDS = 200, 4.0
ALL_TOGETHER = "all together"
OF_CONTACTS = {  # what MuJoCo's contacts cannot do, by what an effect takes over
    "cloth": "MuJoCo's cloth, where sliding, rolling and turning share one friction",
    "ball": "MuJoCo's impacts between balls, in the shots that have one",
    "cushion": "MuJoCo's impacts at cushions, in the shots that have one",
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
    """Where struck balls end if the file plays every impact of a kind, the model the rest: (n, 2) [m]; nan without."""
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
    """A shot that goes on from where a track ends."""
    position, velocity, spin = (getattr(track, key)[-1] for key in ("position", "velocity", "spin"))
    return dataclasses.replace(shot, position=position, velocity=velocity, spin=spin, struck=False)


def left_out(model: Model) -> tuple[Effect, ...]:
    """Effects of the motion that neither MJCF says nor MuJoCo's contacts stand for."""
    return tuple(e for e in model.stack()[1:] if moves_balls(e) and not is_said(e) and not taken_over(e))


def moves_balls(effect: Effect) -> bool:
    """Whether it changes the motion, and not only what is seen of it."""
    return effect.opens("forces", "horizon", "impact", "strike", "edit")


def _ends(tracks: Sequence[Track]) -> Array:
    return np.array([track.position[-1, 0] for track in tracks])


def _apart(one: Array, two: Array) -> float:
    """Median distance of places (n, 2) [m], of those that are known."""
    return float(np.nanmedian(np.hypot(*(one - two).T)))
