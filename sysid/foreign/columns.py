"""The meaning of columns, by their names: times, balls, positions and commands; one row per ball or per frame.

In: the `TextColumns` of a file. Out: `RawTrack`s in the file's units, and the units that the names state.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.errors import BadInput
from models.files.faults import closest, listed, shown
from models.files.limits import MAX_BALLS, excess
from models.messages import Option, OptionError
from models.shot import Array
from sysid.clips.consistency.readings import METRES_BY_UNIT
from sysid.clips.rows import MAX_PLACE, MAX_STAMP
from sysid.foreign.records import TextColumns, numbers

KNOWN_NAMES: Mapping[str, tuple[str, ...]] = {
    "t": ("t", "time", "timestamp", "time_stamp", "stamp", "sec", "secs", "seconds", "ms", "milliseconds"),
    "frame": ("frame", "frames", "frame_number", "frame_id", "frameid", "frame_no", "frame_idx", "frame_index"),
    "ball": ("ball", "ball_id", "ball_name", "id", "name", "label", "object", "object_id", "track", "track_id",
             "trackid", "colour", "color", "class"),
    "x": ("x", "pos_x", "x_pos", "position_x", "cx", "x_center", "center_x", "centre_x", "x_centre", "u", "px"),
    "y": ("y", "pos_y", "y_pos", "position_y", "cy", "y_center", "center_y", "centre_y", "y_centre", "v", "py"),
    "theta": ("theta", "turned"),
    "shot": ("shot", "shot_id", "shot_no", "shot_number", "shotid", "stroke", "clip", "clip_id", "take"),
    "cue.speed": ("cue_speed", "v0"),
    "cue.azimuth": ("cue_azimuth", "aim", "azimuth"),
    "cue.side": ("cue_side",),
    "cue.height": ("cue_height",),
    "cue.elevation": ("cue_elevation",),
}  # fmt: skip
UNIT_IN_NAME = re.compile(r"[\s_]*[\[(]?\b(s|ms|us|mm|cm|m|in|inch|inches|ft|px|pixel|pixels|deg|rad)[\])]?$")
UNIT_ALIASES = {"inch": "in", "inches": "in", "pixel": "px", "pixels": "px", "ms": "milliseconds", "us": "microseconds"}
TIME_UNITS = {"s": "seconds", "milliseconds": "milliseconds", "microseconds": "microseconds"}
NOT_BALLS = {"v", "vel", "velocity", "speed", "a", "acc", "d", "w", "min", "max", "start", "end"}  # paired with x, y
MAX_SHOTS = 10_000  # most shots in one file
LONE_BALL = "cue"  # name of the ball in a file that names none


@dataclass(frozen=True)
class RawTrack:
    """One ball's track in the units of its file, in order of time."""

    time: Array  # (n,)
    xy: Array  # (n, 2)
    theta: Array  # (n,) [rad], NaN where not seen


@dataclass(frozen=True)
class RawClip:
    """One shot in the units of its file."""

    file: str  # for messages
    balls: Mapping[str, RawTrack]
    time_unit: str | None = None  # as the columns' names say
    length_unit: str | None = None
    cue: Mapping[str, float] = field(default_factory=dict)  # the command, if columns hold it
    left_out: tuple[str, ...] = ()  # columns that are not used


def named(**columns: str) -> Option:
    """The option that names columns, by their meaning."""
    pairs = ",".join(f"{what}={name}" for what, name in columns.items())
    return Option(f"--columns {pairs}", f"columns={json.dumps(columns, ensure_ascii=False)}")


def read_clip(found: TextColumns, given: Mapping[str, str]) -> RawClip:
    """The tracks of a file; `given` maps meanings (t, frame, ball, x, y, theta, cue.speed) to names of columns."""
    for what, name in given.items():
        if what not in KNOWN_NAMES:
            raise OptionError(named(**{what: name}), f": name one of {', '.join(KNOWN_NAMES)}")
        if name not in found.cells:
            meant = closest(name, found.names)
            hint = f"did you mean {meant!r}?" if meant else f"it has {listed(found.names)}"
            raise OptionError(named(**{what: name}), f": {found.file} has no column {name!r}; {hint}")
    known = {what: given.get(what) or _by_name(found.names, what) for what in KNOWN_NAMES}
    columns = {what: name for what, name in known.items() if name}
    stamp = columns.get("t") or columns.get("frame")
    pairs = {LONE_BALL: (columns["x"], columns["y"])} if {"x", "y"} <= columns.keys() else _wide(found.names)
    if stamp is None or not pairs:
        missing = "time" if stamp is None else "place"
        raise OptionError(
            f"{found.file}: no column of {listed(found.names)} is a {missing}: name it with ",
            named(t="NAME", ball="NAME", x="NAME", y="NAME"), ", or name pairs such as cue_x, cue_y",
        )  # fmt: skip
    used = {*columns.values(), *(name for pair in pairs.values() for name in pair)}
    time_unit = TIME_UNITS.get(_unit(stamp) or "") if columns.get("t") else "frames"
    if columns.get("t") and _bare(stamp) in ("ms", "milliseconds"):
        time_unit = "milliseconds"
    lengths = {_unit(name) for pair in pairs.values() for name in pair} & {*METRES_BY_UNIT, "px"}
    if len(lengths) > 1:
        raise BadInput(f"{found.file}: columns are named in {' and '.join(sorted(map(str, lengths)))}: use one unit")
    return RawClip(
        found.file, _tracks(found, stamp, columns, pairs), time_unit, lengths.pop() if lengths else None,
        _commands(found, columns), tuple(name for name in found.names if name not in used),
    )  # fmt: skip


def shots_of(found: TextColumns, given: Mapping[str, str]) -> list[tuple[str, TextColumns]]:
    """The shots of a file with their names, in order, separated by the shot column if it has one."""
    name = given.get("shot") or _by_name(found.names, "shot")
    if name is None or name not in found.cells:
        return [("", found)]
    rows: dict[str, list[int]] = {}
    for k, cell in enumerate(found.cells[name]):
        rows.setdefault(cell.removesuffix(".0"), []).append(k)
    if problem := excess(len(rows), MAX_SHOTS, "shots", f"name the column that numbers the shots, not {shown(name)}"):
        raise BadInput(f"{found.file}: {problem}")
    return [(shot, found.rows(kept)) for shot, kept in rows.items()] if len(rows) > 1 else [("", found)]


def _bare(name: str) -> str:
    """A name in lowercase, words joined by _."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _unit(name: str) -> str | None:
    """The unit at the end of a name, as in x_mm or Time (s)."""
    found = UNIT_IN_NAME.search(re.sub(r"_", " ", name.lower()).strip())
    return UNIT_ALIASES.get(found[1], found[1]) if found and found.start() > 0 else None


def _without_unit(name: str) -> str:
    return _bare(UNIT_IN_NAME.sub("", re.sub(r"_", " ", name.lower()).strip())) if _unit(name) else _bare(name)


def _by_name(names: Sequence[str], what: str) -> str | None:
    """The first column whose name has this meaning."""
    for known in KNOWN_NAMES[what]:
        for name in names:
            if known in (_bare(name), _without_unit(name)):
                return name
    return None


def _wide(names: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Pairs of x and y columns by ball: cue_x and cue_y, x1 and y1, red.x and red.y."""
    found: dict[str, dict[str, str]] = {}
    for name in names:
        plain = _without_unit(name)
        match = re.fullmatch(r"(?:(.+?)_?([xy])|([xy])_?(.+?))", plain)
        if match and (ball := match[1] or match[4]) and ball not in NOT_BALLS:
            found.setdefault(_ball_name(ball), {})[match[2] or match[3]] = name
    return {ball: (axes["x"], axes["y"]) for ball, axes in found.items() if len(axes) == 2}


def _tracks(
    found: TextColumns, stamp: str, columns: Mapping[str, str], pairs: Mapping[str, tuple[str, str]]
) -> dict[str, RawTrack]:
    """Every ball's track in order of time, without rows in which it was not seen."""

    def column(name: str, most: float) -> Array:
        values = np.array(numbers(found, name))
        beyond = np.flatnonzero(np.abs(values) > most)
        if len(beyond):
            row = found.line(int(beyond[0]))
            raise BadInput(
                f"{found.file}, row {row}: {name} = {values[beyond[0]]:g} is too large: correct it, or remove the row"
            )
        return values

    time = column(stamp, MAX_STAMP)
    if not np.isfinite(time).all():
        row = found.line(int(np.flatnonzero(~np.isfinite(time))[0]))
        raise BadInput(f"{found.file}, row {row}: {stamp} is empty: give every row its time")
    theta = column(columns["theta"], MAX_PLACE) if "theta" in columns else np.full(len(time), math.nan)
    long = "x" in columns and "ball" in columns
    index: dict[str, int] = {}
    cells = found.cells[columns["ball"]] if long else ("",) * len(time)
    of_row = np.array([index.setdefault(name, len(index)) for name in cells], np.int64)
    if problem := excess(max(len(index), len(pairs)), MAX_BALLS, "balls", "name the column of balls with "):
        raise OptionError(f"{found.file}: {problem}", named(ball="NAME"), f", not {columns.get('ball', '')!r}")
    tracks = {}
    for ball, (x, y) in pairs.items():
        xy = np.column_stack([column(x, MAX_PLACE), column(y, MAX_PLACE)])
        seen = np.isfinite(xy).all(axis=1)
        for one, k in index.items():
            rows = np.flatnonzero((of_row == k) & seen)
            rows = rows[np.argsort(time[rows], kind="stable")]
            name = _ball_name(one) if long else ball
            twice = np.flatnonzero(np.diff(time[rows]) == 0)
            if len(twice):
                line = found.line(int(rows[twice[0] + 1]))
                raise OptionError(
                    f"{found.file}, row {line}: ball {name!r} appears twice at one time: keep "
                    "one row; if there are several shots, name the column that numbers them with ", named(shot="NAME"),
                )  # fmt: skip
            if len(rows):
                angle = theta[rows] if len(pairs) == 1 else np.full(len(rows), math.nan)
                tracks[name] = RawTrack(time[rows], xy[rows], angle)
    if not tracks:
        raise BadInput(f"{found.file}: holds no position of a ball: name the tracker's file")
    return tracks


def _ball_name(text: str) -> str:
    """A ball's name; numbers become names such as ball1."""
    text = text.removesuffix(".0")
    return f"ball {text}" if text.isdigit() else text or LONE_BALL


def _commands(found: TextColumns, columns: Mapping[str, str]) -> dict[str, float]:
    """The command of the cue, if columns hold a single value of each quantity [m/s, rad, m]."""
    cue = {}
    for what, name in columns.items():
        if not what.startswith("cue."):
            continue
        values = np.array(numbers(found, name))
        own = np.unique(values[np.isfinite(values)])
        if len(own) == 1:
            cue[what.removeprefix("cue.")] = float(np.radians(own[0]) if _unit(name) == "deg" else own[0])
    return cue if {"speed", "azimuth"} <= cue.keys() else {}
