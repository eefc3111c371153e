"""Tracked shots as values: the observations of each ball, the commanded stroke, and the set of clips."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from models.files.decode import Allowed
from models.files.texts import picked
from models.messages import counted
from models.report.sheet import frame_of
from models.shot import UNKNOWN_SESSION, Array, Ball, Session, Table


@dataclass(frozen=True)
class CueCommand:
    """The commanded stroke; the real one differs from it a little."""

    speed: Annotated[float, Allowed(0.0, 30.0, "m/s")]  # of the ball
    azimuth: Annotated[float, Allowed(-4 * math.pi, 4 * math.pi, "rad")]  # of the aim
    side: Annotated[float, Allowed(-0.05, 0.05, "m")] = 0.0  # contact point, > 0 to the right as the player sees it
    height: Annotated[float, Allowed(-0.05, 0.05, "m")] = 0.0  # contact point above the centre
    elevation: Annotated[float, Allowed(-math.pi / 2, math.pi / 2, "rad")] = 0.0  # of the cue


@dataclass(frozen=True, repr=False)
class Observation:
    """The track of one ball."""

    time: Array  # (n,) [s], increasing; as read, 0 at the first sample of the clip
    xy: Array  # (n, 2) [m], table frame
    theta: Array  # (n,) [rad], turned angle of the mark about the vertical, unwrapped; NaN where unseen
    extra: Mapping[str, Sequence[str]] = field(default_factory=dict)  # n cells of each unknown column

    def __repr__(self) -> str:
        """A line with its extent, without its arrays."""
        return f"<Observation: {counted(len(self.time), 'sample')}>"

    def at(self, rows: NDArray[np.int64]) -> Observation:
        """The observation reduced to some of its samples."""
        extra = {key: picked(cells, rows) for key, cells in self.extra.items()}
        return Observation(self.time[rows], self.xy[rows], self.theta[rows], extra)


@dataclass(frozen=True, repr=False)
class Clip:
    """One tracked shot."""

    file: str  # as named in clips.toml, relative to the folder
    struck: str
    balls: Mapping[str, Observation]
    cue: CueCommand | None = None
    note: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)  # unknown keys of its [[clip]]
    session: Session = UNKNOWN_SESSION
    running: tuple[str, ...] = ()  # balls in motion at its beginning, where that is no strike; the first is `struck`
    origin: float = 0.0  # stamp of the camera's clock at the clip's time 0 [s]

    def __repr__(self) -> str:
        """A line with its balls, without their samples."""
        begins = f"{self.struck} struck" if not self.running else f"{', '.join(self.running)} running"
        return f"<Clip {self.file}: {', '.join(self.balls)}; {begins}>"

    @property
    def first(self) -> tuple[str, ...]:
        """The balls that move first: those in motion when it begins, or the struck one."""
        return self.running or (self.struck,)

    @property
    def order_of_balls(self) -> tuple[str, ...]:
        """All balls, those that move first before the others."""
        return (*self.first, *[name for name in self.balls if name not in self.first])


@dataclass(frozen=True, repr=False)
class ClipSet:
    """A folder of tracked shots on one table with one camera."""

    table: Table
    ball: Ball
    fps: float  # nominal frame rate [1/s]
    clips: tuple[Clip, ...]
    sigma: float | None = None  # position noise, one standard deviation per axis [m]; None when unknown
    folder: Path = field(default=Path("."))
    extra: Mapping[str, Any] = field(default_factory=dict)  # unknown keys of clips.toml

    def __repr__(self) -> str:
        """A line with the table and the number of clips."""
        size = f"{self.table.length:g} x {self.table.width:g} m"
        return f"<ClipSet {self.folder}: {counted(len(self.clips), 'clip')} at {self.fps:g} frames/s, table of {size}>"

    def frame(self) -> Any:
        """A data frame with a row for every sample of every ball: clip, ball, time [s], x, y [m], theta [rad]."""
        rows = [(clip.file, name, seen) for clip in self.clips for name, seen in clip.balls.items()]
        columns: dict[str, list[Any]] = {"clip": [], "ball": [], "time": [], "x": [], "y": [], "theta": []}
        for file, name, seen in rows:
            n = len(seen.time)
            values: tuple[Sequence[Any] | Array, ...] = (
                [file] * n,
                [name] * n,
                seen.time,
                seen.xy[:, 0],
                seen.xy[:, 1],
                seen.theta,
            )
            for column, more in zip(columns.values(), values, strict=True):
                column.extend(more)
        return frame_of(columns)
