"""The camera's report of shots: the times of its exposures, and the places of the balls.

Effects with the hooks `exposures` and `observe` are the camera. Positions pass through `observe` in the order of the
model's stack, from the table to the report; time stamps pass through `exposures` the other way.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from models.compiled import compiled
from models.effect import Effect
from models.errors import BadInput
from models.hooks import (
    IMAGE_FIELDS,
    IMAGE_NUMBER,
    IMAGE_SESSION,
    Hooks,
    call_exposures,
    call_hook,
    hooks_of,
)
from models.model_file import Model
from models.shot import SESSION_FIELDS, Array, Shot, Track
from models.simulation.simulate import simulate

PLACE_TOLERANCE_M = 1e-13  # change of an iterated place below which it has converged [m]
RUNAWAY_M = 1.0  # change of a place above which the iteration diverges [m]
MAX_ROUNDS = 200


def camera(model: Model) -> tuple[Effect, ...]:
    """The effects of the camera."""
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
    hooks = hooks_of(eyes, len(shots))
    starts = np.zeros(len(shots)) if begun is None else np.asarray(begun, float)
    true, since = [], []
    for k, shot in enumerate(shots):
        stamps = np.append(starts[k], starts[k] + np.asarray(shot.times, float))
        looked = expose(stamps, hooks.own[k].ctypes.data, hooks.exposures)
        since.append(float(looked[0]))
        true.append(looked[1:])
    played = [
        dataclasses.replace(shot, times=_checked(eyes, t - t0)) for shot, t, t0 in zip(shots, true, since, strict=True)
    ]
    tracks = simulate(model, played)
    return [
        _report(hooks, k, track, t, shot) for k, (track, t, shot) in enumerate(zip(tracks, true, shots, strict=True))
    ]


@compiled
def expose(stamps, own, hooks):  # type: ignore[no-untyped-def]
    """The true times of stamps (n,), through the hooks from the last to the first."""
    out = stamps.copy()
    for n in range(out.size):
        for k in range(hooks.shape[0] - 1, -1, -1):
            out[n] = call_exposures(hooks[k, 0], own + 8 * hooks[k, 1], out[n])
    return out


@compiled
def see(position, velocity, times, session, own, hooks):  # type: ignore[no-untyped-def]
    """Move positions (n, nball, 2) of a shot, in its session, to where they are reported, in place."""
    image = np.zeros(IMAGE_FIELDS)
    image[IMAGE_SESSION : IMAGE_SESSION + SESSION_FIELDS] = session
    for n in range(position.shape[0]):
        for i in range(position.shape[1]):
            image[0], image[1], image[4] = position[n, i, 0], position[n, i, 1], times[n]
            image[2], image[3], image[IMAGE_NUMBER] = velocity[n, i, 0], velocity[n, i, 1], i
            for k in range(hooks.shape[0]):
                call_hook(hooks[k, 0], own + 8 * hooks[k, 1], image.ctypes.data)
            position[n, i, 0], position[n, i, 1] = image[0], image[1]


@compiled
def unsee(reported, session, own, hooks, place):  # type: ignore[no-untyped-def]
    """Where balls 1 to n at rest lie that are reported at (n, 2) [m]: the fixed point of x - (observe(x) - reported).

    Where no place is reported so (a lens so strong that it folds the table's corners), the reported one.
    """
    image = np.zeros(IMAGE_FIELDS)
    image[IMAGE_SESSION : IMAGE_SESSION + SESSION_FIELDS] = session
    for i in range(reported.shape[0]):
        x, y = reported[i, 0], reported[i, 1]
        for _ in range(MAX_ROUNDS):
            image[0], image[1], image[2], image[3], image[4], image[IMAGE_NUMBER] = x, y, 0.0, 0.0, 0.0, i + 1.0
            for k in range(hooks.shape[0]):
                call_hook(hooks[k, 0], own + 8 * hooks[k, 1], image.ctypes.data)
            dx, dy = image[0] - reported[i, 0], image[1] - reported[i, 1]
            x, y = x - dx, y - dy
            miss = max(abs(dx), abs(dy))
            if not miss < RUNAWAY_M:
                x, y = reported[i, 0], reported[i, 1]
                break
            if miss < PLACE_TOLERANCE_M:
                break
        place[i, 0], place[i, 1] = x, y


def undone(model: Model, shots: Sequence[Shot]) -> list[Shot]:
    """The shots with the resting balls, all but the first, moved to where they lie if the camera sees them there."""
    eyes = [e for e in camera(model) if e.opens("observe")]
    if not eyes:
        return list(shots)
    hooks = hooks_of(eyes, len(shots))
    out = []
    for k, shot in enumerate(shots):
        place = np.array(shot.position, float)
        unsee(place[1:].copy(), shot.session.row, hooks.own[k].ctypes.data, hooks.observe, place[1:])
        out.append(dataclasses.replace(shot, position=place))
    return out


def _checked(eyes: Sequence[Effect], times: Array) -> Array:
    """Times that can be simulated; BadInput names the effects that made others."""
    if times.size and not (times[0] >= 0 and (np.diff(times) >= 0).all()):
        names = ", ".join(e.name() for e in eyes if e.opens("exposures"))
        raise BadInput(f"{names}: exposures go backwards, or to before the shot; correct the effect or its bounds")
    return times


def _report(hooks: Hooks, number: int, track: Track, true: Array, shot: Shot) -> Track:
    """A track as the camera reports it; `true` are its times on the camera's own axis, those of the shot are stamps."""
    position = np.array(track.position)
    velocity, own = np.ascontiguousarray(track.velocity), hooks.own[number].ctypes.data
    see(position, velocity, true, shot.session.row, own, hooks.observe)
    when = np.interp([e.time for e in track.events], np.append(0.0, track.times), np.append(0.0, shot.times))
    events = tuple(dataclasses.replace(e, time=float(t)) for e, t in zip(track.events, when, strict=True))
    return dataclasses.replace(track, times=shot.times, position=position, events=events)
