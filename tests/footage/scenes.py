"""Shots of a clip set's truth, played again by the program that made them, one after another as in a recording."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.shot import Array, Table, Track
from sysid.clips import read_clip_set
from tests.footage.motion import Cue, Motion, motion_of
from tests.truth.cloth import Constants
from tests.truth.physics import Start, simulate
from tests.truth.physics import Table as TrueTable

LEAD = 0.45  # filmed before a strike [s]
FINE = 1e-3  # between two places of a motion [s]
TIP = 0.75  # speed of a cue's tip over that of the ball it strikes
IMPACT_M_S = 0.02  # by which a speed changes between two places of a motion in an impact only
NAMES = {"cue": "white"}  # of balls, as their colours are called
SHORT = {"R": "radius", "m": "mass"}


@dataclass(frozen=True)
class Scene:
    """One shot of a recording."""

    kind: str
    begins: float  # in the recording [s]
    struck: float  # when the ball is struck, in the recording [s]
    ends: float  # in the recording [s]
    track: Track  # from the strike on
    motion: Motion
    velocity: Array  # (2,) of the struck ball at first [m/s]
    spin: float  # about the vertical at first [rad/s]

    def places(self, name: str, times: Array) -> Array:
        """Where a ball is at times of the recording: (n, 2) [m]; NaN once potted."""
        k = self.track.names.index(name)
        at = np.clip(np.asarray(times) - self.struck, 0.0, None)
        return np.column_stack([np.interp(at, self.track.times, self.track.position[:, k, axis]) for axis in (0, 1)])

    def impacts(self, name: str) -> Array:
        """When a ball is struck, or meets a ball or a cushion, in the recording: (n,) [s]."""
        velocity = self.track.velocity[:, self.track.names.index(name)]
        change = np.linalg.norm(np.diff(velocity, axis=0, prepend=np.zeros((1, 2))), axis=1)
        return np.asarray(self.struck + self.track.times[change > IMPACT_M_S])

    def turned(self, name: str, times: Array) -> Array:
        """How far it has turned about the vertical since the strike: (n,) [rad]."""
        at = np.clip(np.asarray(times) - self.struck, 0.0, None)
        return np.interp(at, self.track.times, self.track.theta[:, self.track.names.index(name)])


def scenes(folder: Path) -> tuple[Table, float, float, list[Scene]]:
    """Table, diameter [m], frame rate [1/s] and shots of a clip set beside which its truth lies."""
    clip_set = read_clip_set(folder)
    truth = json.loads(folder.with_name(folder.name + ".truth.json").read_text(encoding="utf-8"))
    constants = Constants()._replace(**{SHORT.get(k, k): v for k, v in truth["parameters"].items()})
    table = TrueTable(clip_set.table.length, clip_set.table.width, clip_set.table.pockets)
    found, now = [], 0.0
    for clip, entry in zip(clip_set.clips, truth["clips"], strict=True):
        own = constants._replace(**{k: v for k, v in entry.items() if k in Constants._fields})
        length = max(float(seen.time[-1]) for seen in clip.balls.values())
        found.append(_scene(entry, own, table, now, length))
        now = found[-1].ends
    return clip_set.table, clip_set.ball.diameter, clip_set.fps, found


def _scene(entry: Mapping[str, Any], constants: Constants, table: TrueTable, begins: float, length: float) -> Scene:
    balls = {
        name: Start(*(tuple(ball[k]) for k in ("xy", "velocity", "omega"))) for name, ball in entry["balls"].items()
    }
    times = np.arange(int(length / FINE) + 2) * FINE
    played = simulate(table, constants, balls, times)
    names = tuple(NAMES.get(name, name) for name in played.names)
    track = Track(names, times, played.xy, played.velocity, played.omega, played.theta)
    struck = begins + LEAD
    motion = motion_of(track, cue=_cue(entry, balls, constants.radius) if entry["cue"] else None)
    first = next(iter(balls.values()))
    return Scene(
        entry["kind"], begins, struck, struck + length, track, motion, np.array(first.velocity), first.omega[2]
    )  # fmt: skip


def _cue(entry: Mapping[str, Any], balls: Mapping[str, Start], radius: float) -> Cue:
    cue, place = entry["cue"], np.array(next(iter(balls.values())).xy)
    way = np.array([np.cos(cue["azimuth"]), np.sin(cue["azimuth"])])
    right, side, height = np.array([way[1], -way[0]]), cue["side"], cue["height"]
    contact = place - np.sqrt(radius**2 - side**2 - height**2) * way + side * right
    return Cue(0.0, (*contact, radius + height), cue["azimuth"], TIP * cue["speed"], cue["elevation"])
