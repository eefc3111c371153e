"""`clips.toml` of a clip set: the table, the ball, the camera, and which clips there are.

In: the folder. Out: a `Header`, and its faults in `Faults`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from models.files import parse, read_text
from models.files.decode import Allowed, of_format, usable
from models.files.faults import Faults, shown
from models.files.place import Place
from models.shot import Ball, Table
from models.table.presets import named_table
from sysid.clips.clip_set import CueCommand
from sysid.clips.names import CLIPS_TOML, find_file, name_fault, path_fault
from sysid.clips.session import SessionEntries

CLIP_SET_FORMAT = "billiard-clips/1"
SET_REMEDY = "record it again or take it from a backup"
MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3 = 50.0, 12000.0  # hollow plastic to lead
MIN_BALLS_ACROSS_TABLE = 5  # a table narrower than so many balls has its ball or its table in the wrong unit


@dataclass(frozen=True)
class CameraEntries:
    """The keys of `[camera]`."""

    fps: Annotated[float, Allowed(1.0, 1e6, "1/s")]
    sigma: Annotated[float, Allowed(1e-9, 0.02, "m", form="it in m, such as 0.0005, or leave it out")] = math.nan


@dataclass(frozen=True)
class ClipEntries:
    """The keys of a `[[clip]]`."""

    file: Annotated[str, Allowed(form='file = "clips/0001.csv"')]
    struck: Annotated[str, Allowed(form='struck = "cue"')] = ""
    running: bool = False
    note: Annotated[str, Allowed(form='note = "long draw"')] = ""
    cue: Annotated[Mapping[str, Any] | None, Allowed(form="cue = { speed = 1.9, azimuth = 2.68 }")] = None
    session: Annotated[Mapping[str, Any] | None, Allowed(form="session = { hour = 14.5, temperature = 21.5 }")] = None


@dataclass(frozen=True)
class HeaderEntries:
    """The keys of clips.toml; its tables are read one by one."""

    table: Annotated[Mapping[str, Any], Allowed(form="[table] with length, width")]
    ball: Annotated[Mapping[str, Any], Allowed(form="[ball] with diameter, mass")]
    camera: Annotated[Mapping[str, Any], Allowed(form="[camera] with fps")]
    clip: Annotated[tuple[Mapping[str, Any], ...], Allowed(form="[[clip]] with file and struck for each clip")]


@dataclass(frozen=True)
class Entry:
    """One `[[clip]]`."""

    file: str
    path: Path  # real path
    struck: str
    place: Place
    running: bool = False
    note: str = ""
    cue: Mapping[str, float] | None = None
    session: Mapping[str, float] = field(default_factory=dict)
    extra: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Header:
    """The contents of clips.toml; None where an entry is missing or wrong."""

    table: Table | None
    ball: Ball | None
    camera: Mapping[str, float]
    entries: tuple[Entry, ...]
    extra: Mapping[str, Any]


def read_header(root: Path, faults: Faults) -> Header | None:
    """Read clips.toml in `root`, a real path; None when it cannot be read at all."""
    path = find_file(root, CLIPS_TOML)
    if isinstance(path, str):
        faults.add(CLIPS_TOML, f"{path} ({root} is to hold {CLIPS_TOML} and its clips)")
        return None
    text = read_text(path, CLIPS_TOML, faults, SET_REMEDY)
    document = None if text is None else parse(text, CLIPS_TOML, faults)
    if text is None or document is None:
        return None
    top = Place(CLIPS_TOML, faults, text)
    body = of_format(document, CLIP_SET_FORMAT, HeaderEntries, top)
    if body is None:
        return None
    extra: dict[str, Any] = {}
    found = usable(HeaderEntries, named_table(body, top), top, extra)
    kinds = {"table": Table, "ball": Ball, "camera": CameraEntries}
    table, ball, camera = (_inner(kind, found, name, top, extra) for name, kind in kinds.items())
    # A table with a fault elsewhere, or a ball without a mass, is still good enough to judge the clips.
    of_table = Table(**table) if {"length", "width"} <= table.keys() else None
    of_ball = Ball(**{"mass": math.nan} | ball) if "diameter" in ball else None
    for section, key, problem in size_faults(of_table, of_ball):
        top.below(section).fault(problem, key)
    return Header(of_table, of_ball, camera, _entries(found.get("clip", ()), root, of_ball, top), extra)


def _inner(kind: type[Any], found: Mapping[str, Any], name: str, at: Place, extra: dict[str, Any]) -> dict[str, Any]:
    """The usable keys of a nested table; unknown ones go to `extra`."""
    left: dict[str, Any] = {}
    values = usable(kind, found[name], at.below(name), left) if name in found else {}
    extra |= {name: left} if left else {}
    return values


def size_faults(table: Table | None, ball: Ball | None) -> Iterator[tuple[str, str, str]]:
    """Faults in the combination of sizes and mass: table of the file, key and problem."""
    if table and table.width > table.length:
        yield (
            "table", "width",
            f"width = {table.width:g} exceeds length = {table.length:g}: exchange them, x is along the table",
        )  # fmt: skip
    if ball:
        low, high = (rho * math.pi / 6 * ball.diameter**3 for rho in (MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3))
        if ball.mass < low or ball.mass > high:
            fits = f"does not fit a ball of {ball.diameter:g} m: write {low:.2g} to {high:.2g} (kg)"
            yield "ball", "mass", f"mass = {ball.mass:g} kg {fits}"
    if table and ball and ball.diameter > table.width / MIN_BALLS_ACROSS_TABLE:
        fits = f"does not fit a table {table.width:g} m wide: correct one of them"
        yield "ball", "diameter", f"diameter = {ball.diameter:g} m {fits}"


def _entries(clips: tuple[Mapping[str, Any], ...], root: Path, ball: Ball | None, top: Place) -> tuple[Entry, ...]:
    entries: list[Entry] = []
    seen: dict[Path, int] = {}
    for index, clip in enumerate(clips):
        entry = _entry(clip, root, ball, top.below("clip", index))
        if entry is None:
            continue
        if entry.path in seen:
            problem = f"file = {shown(entry.file)} is clip {seen[entry.path] + 1} already: name each file once"
            entry.place.fault(problem, "file")
            continue
        seen[entry.path] = index
        entries.append(entry)
    sessions = [(entry, clips[entry.place.index or 0].get("session", {})) for entry in entries]
    for key in dict.fromkeys(key for entry in entries for key in entry.session):
        for entry, session in sessions:
            if isinstance(session, Mapping) and key not in session:
                entry.place.fault(f"session.{key} is missing: give it for every clip, or for none", "session")
    return tuple(entries)


def _entry(clip: Mapping[str, Any], root: Path, ball: Ball | None, place: Place) -> Entry | None:
    extra: dict[str, Any] = {}
    running = isinstance(clip, Mapping) and clip.get("running") is True
    found = usable(ClipEntries, clip, place, extra, needs=() if running else ("struck",))
    if running and "cue" in clip:
        place.fault("cue is the command of a strike, and running = true says that none is seen: remove one", "cue")
    if "struck" in found and (problem := name_fault(found["struck"])):
        place.fault(f"struck = {shown(found['struck'])} {problem}", "struck")
    cue = _inner(CueCommand, found, "cue", place, extra)
    offset = math.hypot(cue.get("side", 0.0), cue.get("height", 0.0))
    if ball is not None and offset > ball.radius:
        problem = f"cue.side, cue.height: {offset:g} m off centre misses the ball (radius {ball.radius:g} m)"
        place.fault(f"{problem}: write them in m", "cue")
    if "file" not in found:
        return None
    file, whole = found["file"], cue if {"speed", "azimuth"} <= cue.keys() else None
    path = path_fault(file) or find_file(root, file)
    if isinstance(path, str):
        place.fault(f"file = {shown(file)} {path}", "file")
        return None
    session = _inner(SessionEntries, found, "session", place, extra)
    return Entry(file, path, found.get("struck", ""), place, running, found.get("note", ""), whole, session, extra)
