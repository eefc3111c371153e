"""The clip set: the folder of tracked shots that every command reads, in the format `billiard-clips/1`."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import Ball, Table
from sysid.clips_check import check_rows, check_struck
from sysid.clips_faults import Faults, one_line, read_text
from sysid.clips_header import Entry, read_header
from sysid.clips_rows import Rows, parse_rows

Array = NDArray[np.float64]

SHOWN_PER_FILE = 10  # faults that `check_clip_set` lists of one file


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
    extra: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # n cells of each column that is not known here


@dataclass(frozen=True)
class Clip:
    """One tracked shot."""

    file: str  # as named in clips.toml, relative to the folder
    struck: str
    balls: Mapping[str, Observation]
    cue: Cue | None = None
    note: str = ""
    extra: Mapping[str, Any] = field(default_factory=dict)  # keys of its [[clip]] that are not known here
    order: float = 0.0  # place in the session, 0 for the first clip of the set, 1 for the last
    running: bool = False  # a piece of a shot, which begins with a ball on its way


@dataclass(frozen=True)
class ClipSet:
    """A folder of tracked shots on one table with one camera."""

    table: Table
    ball: Ball
    fps: float  # nominal frame rate [1/s]
    clips: tuple[Clip, ...]
    sigma: float | None = None  # position noise, one standard deviation per axis [m]; None when unknown
    folder: Path = field(default=Path("."))
    extra: Mapping[str, Any] = field(default_factory=dict)  # keys of clips.toml that are not known here


def read_clip_set(folder: Path | str) -> ClipSet:
    """Read a clip set; BadInput names its first fault and how many more there are."""
    faults = Faults()
    clip_set = _read(Path(folder), faults)
    if faults or clip_set is None:
        first, others = faults.lines()[0], len(faults) - 1
        raise BadInput(first + (one_line(f" ({others} more: sysid check {folder})") if others else ""))
    return clip_set


def check_clip_set(folder: Path | str) -> list[str]:
    """Every fault of a clip set, one line each; of a file with very many the first ones and their number."""
    faults = Faults()
    _read(Path(folder), faults)
    return faults.lines(SHOWN_PER_FILE)


def write_clip_set(clip_set: ClipSet, folder: Path | str) -> None:
    """Write a clip set so that `folder` holds all of it or what it held before.

    Times and positions keep 6 decimals. A clip set that is there is replaced; any other file is BadInput, and so is
    a clip set that `read_clip_set` would refuse.
    """
    from sysid.clips_write import replace_folder, texts_of

    replace_folder(Path(folder), texts_of(clip_set), check_clip_set)


def _read(folder: Path, faults: Faults) -> ClipSet | None:
    """The clip set, None if there are faults that leave none."""
    try:
        root = Path(os.path.realpath(folder, strict=True))
    except (OSError, ValueError):
        faults.add(str(folder), "no such folder: name the folder that holds clips.toml and its clips")
        return None
    if not root.is_dir():
        faults.add(str(folder), "is not a folder: name the folder that holds clips.toml and its clips")
        return None
    header = read_header(root, faults)
    if header is None:
        return None
    clips = []
    last = max(len(header.entries) - 1, 1)
    for number, entry in enumerate(header.entries):
        text = read_text(entry.path, entry.file, faults)
        rows = None if text is None else parse_rows(text, entry.file, faults)
        if rows is not None:
            check_rows(rows, entry.file, header.table, header.ball, header.camera, faults)
            check_struck(rows, entry, faults)
            clips.append(_clip(entry, rows, number / last))
    if faults or header.table is None or header.ball is None:
        return None
    camera = header.camera
    return ClipSet(header.table, header.ball, camera["fps"], tuple(clips), camera.get("sigma"), folder, header.extra)


def _clip(entry: Entry, rows: Rows, order: float) -> Clip:
    balls = {}
    for k, name in enumerate(rows.names):
        own = np.flatnonzero(rows.ball == k)
        extra = {key: tuple(cells[i] for i in own.tolist()) for key, cells in rows.extra.items()}
        balls[name] = Observation(rows.time[own], rows.xy[own], rows.theta[own], extra)
    cue = None if entry.cue is None else Cue(**entry.cue)
    return Clip(entry.file, entry.struck, balls, cue, entry.note, entry.extra, order)
