"""The clip set: the folder of tracked shots that every command reads."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.shot import Ball, Table

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cue:
    """What was commanded; real shots differ from it a little."""

    speed: float  # of the ball [m/s]
    azimuth: float  # of the aim [rad]
    side: float = 0.0  # contact point, positive to the right as the player sees it [m]
    height: float = 0.0  # contact point above the centre [m]
    elevation: float = 0.0  # of the cue [rad]


@dataclass(frozen=True)
class Observation:
    """Where one ball was seen."""

    time: Array  # (n,) [s], increasing
    xy: Array  # (n, 2) [m], table frame
    theta: Array  # (n,) [rad], turned angle of the mark about the vertical, unwrapped; NaN where unseen


@dataclass(frozen=True)
class Clip:
    """One tracked shot."""

    file: str  # as named in clips.toml, relative to the folder
    struck: str
    balls: Mapping[str, Observation]
    cue: Cue | None = None
    note: str = ""


@dataclass(frozen=True)
class ClipSet:
    """A folder of tracked shots on one table with one camera."""

    table: Table
    ball: Ball
    fps: float  # nominal frame rate [1/s]
    clips: tuple[Clip, ...]
    sigma: float | None = None  # position noise, one standard deviation per axis [m]; None when unknown
    folder: Path = field(default=Path("."))


def read_clip_set(folder: Path | str) -> ClipSet: ...


def write_clip_set(clip_set: ClipSet, folder: Path | str) -> None: ...
