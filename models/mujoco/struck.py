"""Shots whose first ball the launcher's tip strikes, simulated to their end in MuJoCo.

The stroke runs in a world with the launcher (models/mujoco/launcher.py), at the small steps that its leather needs.
Once the tip has left, the balls go on as they are in a world without it, many shots side by side
(models/mujoco/play.py). Effects of the model on strokes act on what the tip gave.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from models.mjcf.launcher import CueProperties
from models.mujoco.launcher import Launcher, SimulatedStroke
from models.mujoco.play import play
from models.mujoco.world import World
from models.shot import Array, Shot, Track

if TYPE_CHECKING:
    from models.model_file import Model

SQUIRT_SLOT = "squirt"  # name and slot of effects that turn a stroke's direction


@dataclass(frozen=True)
class TipStroke:
    """The stroke that the launcher is asked for."""

    cue_speed: float  # along its axis [m/s]
    azimuth: float  # of the cue [rad]
    side: float  # of the cue's axis from the ball's centre, to the right [m]
    height: float  # the same, up [m]


def without_squirt(model: Model) -> Model:
    """The model without effects that turn a stroke's direction: the tip makes it."""
    return dataclasses.replace(model, effects=tuple(e for e in model.effects if SQUIRT_SLOT not in (e.name(), e.slot)))


def play_struck(
    model: Model, places: Mapping[str, ArrayLike], strokes: Sequence[TipStroke], times: Sequence[Array], *,
    device: CueProperties | None = None, jaws: bool = False, threads: int = 0,
) -> tuple[list[Track], list[SimulatedStroke]]:  # fmt: skip
    """Tracks of strokes from the same places, and the strokes themselves.

    Args:
        model: table, ball and effects; its parameters are numbers, or (len(strokes),) arrays.
        places: of the balls (2,) [m]; the first is struck.
        strokes: what the launcher is asked for in each.
        times: at which each track is wanted [s], from when the tip touches the ball.
        device: what the tip feels of the cue.
        jaws: whether pockets have jaws and an edge.
        threads: that step the simulations, 0 for one a core.

    Raises:
        BadInput: a stroke is out of the launcher's range, or misses the ball.
    """
    names = tuple(places)
    world = World(model, names, jaws=jaws, rows=len(strokes))
    launcher = Launcher(world, device)
    made, shots = [], []
    try:
        for row, (stroke, wanted) in enumerate(zip(strokes, times, strict=True)):
            data = world.place(places)
            launcher.aim(data, stroke.azimuth)
            one = launcher.strike(data, stroke.cue_speed, stroke.side, stroke.height, run_up=False, row=row)
            position, velocity, spin = world.states(data)
            later = wanted[wanted > one.since]
            made.append(one)
            shots.append(Shot(names, position, velocity, spin, np.concatenate([[0.0], later - one.since])))
    finally:
        world.forget()
    at_rest = np.array([places[name] for name in names], float)
    tracks = play(model, shots, threads=threads, jaws=jaws)
    return [_whole(*part, at_rest) for part in zip(tracks, times, made, strict=True)], made


def _whole(track: Track, times: Array, stroke: SimulatedStroke, at_rest: Array) -> Track:
    """A track from the touch on; until the tip has left, the struck ball is interpolated linearly."""
    early = int(np.sum(times <= stroke.since))
    part = (times[:early] / stroke.since)[:, None, None]
    before = at_rest + part * (track.position[0] - at_rest)
    after = slice(1, None)
    position = np.concatenate([before, track.position[after]])
    velocity = np.concatenate([part * track.velocity[0], track.velocity[after]])
    spin = np.concatenate([part * track.spin[0], track.spin[after]])
    theta = np.concatenate([np.zeros((early, len(track.names))), track.theta[after]])
    events = tuple(dataclasses.replace(e, time=e.time + stroke.since) for e in track.events)
    return Track(track.names, times, position, velocity, spin, theta, events)
