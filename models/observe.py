"""What the camera reports of shots: when it looked, and where it believes the balls to be.

Effects with the doors `exposures` and `observe` are the camera. Positions pass through `observe` in the order of the
model's stack, from the table to the report; time stamps pass through `exposures` the other way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from models.effect import Effect
from models.errors import BadInput
from models.model_file import Model
from models.shot import Array, Shot, Track
from models.simulate import simulate

UNDONE = 1e-13  # change of a place that is looked for, below which it is found [m]
FAR = 1.0  # beyond it the search runs away [m]
ROUNDS = 200


def camera(model: Model) -> tuple[Effect, ...]:
    """The effects that stand between what happens and what is reported."""
    return tuple(e for e in model.stack()[1:] if e.opens("observe", "exposures"))


def observed(model: Model, shots: Sequence[Shot], begun: Sequence[float] | None = None) -> list[Track]:
    """Play shots and return what the camera reports of them; `simulate` itself where nothing distorts.

    Args:
        model: table, ball and effects; parameters are numbers or (len(shots),) arrays.
        shots: the balls' true states when they begin, and the time stamps wanted, counted from there.
        begun: the stamp at which each shot begins [s], where that is not 0.

    Returns:
        A track for every shot, in order: its times and those of its events are stamps, its positions what the camera
        reports; velocity, spin and angle are the true ones.
    """
    eyes = camera(model)
    if not eyes:
        return simulate(model, shots)
    own = [[e.select(k) for e in eyes] for k in range(len(shots))]
    starts = np.zeros(len(shots)) if begun is None else np.asarray(begun, float)
    since = [float(_exposed(c, np.array([s]))[0]) for c, s in zip(own, starts, strict=True)]
    true = [_exposed(c, s + np.asarray(shot.times, float)) for c, s, shot in zip(own, starts, shots, strict=True)]
    played = [
        dataclasses.replace(shot, times=_checked(eyes, t - t0)) for shot, t, t0 in zip(shots, true, since, strict=True)
    ]
    tracks = simulate(model, played)
    return [_report(c, track, t, shot) for c, track, t, shot in zip(own, tracks, true, shots, strict=True)]


def undone(model: Model, shots: Sequence[Shot]) -> list[Shot]:
    """The shots with the resting balls, all but the first, moved to where they lie if the camera sees them there."""
    eyes = [e for e in camera(model) if e.opens("observe")]
    if not eyes:
        return list(shots)
    known: dict[tuple[bytes, ...], Array] = {}
    out = []
    for k, shot in enumerate(shots):
        own = [e.select(k) for e in eyes]
        reported = np.asarray(shot.position, float)[1:]
        values = [np.array([getattr(e, p) for p in e.parameters()], float).tobytes() for e in own]
        key = (repr(shot.names).encode(), reported.tobytes(), *values)
        if key not in known:
            known[key] = _place(own, shot.names[1:], reported)
        out.append(dataclasses.replace(shot, position=np.concatenate([shot.position[:1], known[key]])))
    return out


def _place(eyes: Sequence[Effect], names: tuple[str, ...], reported: Array) -> Array:
    """Where balls at rest lie that are reported at (n, 2) [m]: the fixed point of x - (observe(x) - reported).

    Where no place is reported so (a lens so strong that it folds the table's corners), the reported one.
    """
    n, place = len(names), reported
    zero = np.zeros((1, n, 3))
    for _ in range(ROUNDS if n else 0):
        seen = Track(names, np.zeros(1), place[None], zero[..., :2], zero, zero[..., 0])
        for effect in eyes:
            seen = effect.observe(seen)
        miss = seen.position[0] - reported
        place = place - miss
        if not np.abs(miss).max() < FAR:
            return reported
        if np.abs(miss).max() < UNDONE:
            break
    return place


def _exposed(eyes: Sequence[Effect], stamps: Array) -> Array:
    for effect in reversed(eyes):
        stamps = effect.exposures(stamps)
    return stamps


def _checked(eyes: Sequence[Effect], times: Array) -> Array:
    """Times that can be simulated; BadInput names the effects that made others."""
    if times.size and not (times[0] >= 0 and (np.diff(times) >= 0).all()):
        names = ", ".join(e.name() for e in eyes if e.opens("exposures"))
        raise BadInput(f"{names}: exposures go backwards, or to before the shot; correct the effect or its bounds")
    return times


def _report(eyes: Sequence[Effect], track: Track, true: Array, shot: Shot) -> Track:
    """A track as the camera tells it; `true` are its times on the camera's own axis, those of the shot are stamps."""
    seen = dataclasses.replace(track, times=true)
    for effect in eyes:
        seen = effect.observe(seen)
    when = np.interp([e.time for e in track.events], np.append(0.0, track.times), np.append(0.0, shot.times))
    events = tuple(dataclasses.replace(e, time=float(t)) for e, t in zip(track.events, when, strict=True))
    return dataclasses.replace(seen, times=shot.times, events=events)
