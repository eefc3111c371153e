"""`clips.toml` of a clip set: the table, the ball, the camera, and which clips there are.

In: the folder. Out: a `Header`, and its faults in `Faults`.
"""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from models.errors import BadInput
from models.pocket_shape import PocketShapes, read_pockets
from models.shot import Ball, Table
from sysid.clips.faults import CLIPS_TOML, Faults, find_file, name_fault, path_fault, read_text, shown
from sysid.clips.keys import NUMBER_BOUNDS, Place, read_numbers, slips, unknown_keys

CLIP_SET_FORMAT = "billiard-clips/1"
SECTION_NAMES = ("table", "ball", "camera")
TOP_LEVEL_KEYS = ("format", "clip", *SECTION_NAMES)
CLIP_TEXTS = {"file": '"clips/0001.csv"', "struck": '"cue"', "note": '"long draw"'}  # with examples
MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3 = 50.0, 12000.0  # hollow plastic to lead
MIN_BALLS_ACROSS_TABLE = 5  # a table narrower than so many balls has its ball or its table in the wrong unit


@dataclass(frozen=True)
class Entry:
    """One `[[clip]]`."""

    file: str
    path: Path  # real path
    struck: str
    place: Place
    note: str = ""
    cue: Mapping[str, float] | None = None
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
    text = read_text(path, CLIPS_TOML, faults)
    document = None if text is None else _parse(text, faults)
    if text is None or document is None:
        return None
    version = document.get("format")
    if version is None and "format" in slips(document, TOP_LEVEL_KEYS):
        unknown_keys(document, TOP_LEVEL_KEYS, Place(text), faults)
        return None
    if version != CLIP_SET_FORMAT:
        problem = "format is missing" if version is None else f"format = {shown(version)} is unknown"
        faults.add(
            CLIPS_TOML, f'{problem}: this program reads format = "{CLIP_SET_FORMAT}"', Place(text).line("format")
        )
        return None  # another version may mean anything
    extra = unknown_keys(document, TOP_LEVEL_KEYS, Place(text), faults)
    table = _table(_section(document, "table", text, extra, faults), document, text, faults)
    ball = _ball(_section(document, "ball", text, extra, faults), text, faults)
    camera = _section(document, "camera", text, extra, faults)
    if table and ball and ball.diameter > table.width / MIN_BALLS_ACROSS_TABLE:
        problem = f"diameter = {ball.diameter:g} m does not fit a table {table.width:g} m wide: correct one of them"
        faults.add(CLIPS_TOML, problem, Place(text, "ball").line("diameter"))
    return Header(table, ball, camera, _entries(document, root, ball, text, faults), extra)


def _parse(text: str, faults: Faults) -> dict[str, Any] | None:
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        found = re.search(r" \(at line (\d+), (column \d+)\)$", str(error))
        problem = str(error) if found is None else f"{str(error)[: found.start()]} at {found[2]}"
        faults.add(CLIPS_TOML, f"{problem}: correct the TOML", None if found is None else int(found[1]))
    except (ValueError, RecursionError):  # dates that do not exist, endless digits, a thousand brackets
        faults.add(CLIPS_TOML, "holds a value that cannot be read: correct the TOML")
    return None


def _section(
    document: Mapping[str, Any], name: str, text: str, extra: dict[str, Any], faults: Faults
) -> Mapping[str, float]:
    """The numbers of one of the tables; its unknown keys go to `extra`."""
    section, place = document.get(name), Place(text, name)
    if isinstance(section, dict):
        values, left = read_numbers(section, name, place, faults, ("pockets",) if name == "table" else ())
        if left:
            extra[name] = left
        return values
    keys = ", ".join(key for key, bound in NUMBER_BOUNDS[name].items() if bound.required)
    if section is not None:
        faults.add(CLIPS_TOML, f"{name} = {shown(section)} is not a table: write [{name}] with {keys}", place.line())
    elif name not in slips(document, TOP_LEVEL_KEYS):
        faults.add(CLIPS_TOML, f"[{name}] is missing: add it with {keys}")
    return {}


def _table(values: Mapping[str, float], document: Mapping[str, Any], text: str, faults: Faults) -> Table | None:
    if not {"length", "width"} <= values.keys():
        return None
    place = Place(text, "table")
    pockets: bool | PocketShapes = True
    try:
        pockets = read_pockets(document["table"].get("pockets", True))
    except BadInput as error:
        line = Place(text, "table.pockets").line()
        faults.add(CLIPS_TOML, str(error), place.line("pockets") if line is None else line)
    if values["width"] > values["length"]:
        problem = (
            f"width = {values['width']:g} exceeds length = {values['length']:g}: exchange them, x is along the table"
        )
        faults.add(CLIPS_TOML, problem, place.line("width"))
    return Table(values["length"], values["width"], pockets)


def _ball(values: Mapping[str, float], text: str, faults: Faults) -> Ball | None:
    if "diameter" not in values:
        return None
    diameter, mass = values["diameter"], values.get("mass", math.nan)  # without a mass it still judges the clips
    low, high = (density * math.pi / 6 * diameter**3 for density in (MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3))
    if mass < low or mass > high:
        problem = f"mass = {mass:g} kg does not fit a ball of {diameter:g} m: write {low:.2g} to {high:.2g} (kg)"
        faults.add(CLIPS_TOML, problem, Place(text, "ball").line("mass"))
    return Ball(diameter, mass)


def _entries(
    document: Mapping[str, Any], root: Path, ball: Ball | None, text: str, faults: Faults
) -> tuple[Entry, ...]:
    clips = document.get("clip", [])
    if not isinstance(clips, list) or not all(isinstance(clip, dict) for clip in clips):
        problem = f"clip = {shown(clips)} is not a list of tables: write [[clip]] for each clip"
        faults.add(CLIPS_TOML, problem, Place(text).line("clip"))
        return ()
    if not clips and "clip" not in slips(document, TOP_LEVEL_KEYS):
        faults.add(CLIPS_TOML, "names no clips: add a [[clip]] with file and struck for each")
    entries: list[Entry] = []
    seen: dict[Path, int] = {}
    for index, clip in enumerate(clips):
        entry = _entry(clip, root, ball, Place(text, "clip", index), faults)
        if entry is None:
            continue
        if entry.path in seen:
            problem = f"file = {shown(entry.file)} is clip {seen[entry.path] + 1} already: name each file once"
            faults.add(CLIPS_TOML, problem, entry.place.line("file"))
            continue
        seen[entry.path] = index
        entries.append(entry)
    return tuple(entries)


def _entry(clip: Mapping[str, Any], root: Path, ball: Ball | None, place: Place, faults: Faults) -> Entry | None:
    known = (*CLIP_TEXTS, "cue")
    extra = unknown_keys(clip, known, place, faults)
    texts = {"note": ""}
    for key, example in CLIP_TEXTS.items():
        if isinstance(value := clip.get(key), str):
            texts[key] = value
        elif key in clip:
            faults.add(CLIPS_TOML, f"{key} = {shown(value)} is not text: write {key} = {example}", place.line(key))
        elif key != "note" and key not in slips(clip, known):
            faults.add(CLIPS_TOML, f"clip {place.index + 1} has no {key}: add {key} = {example}", place.line())
    if "struck" in texts and (problem := name_fault(texts["struck"])):
        faults.add(CLIPS_TOML, f"struck = {shown(texts['struck'])} {problem}", place.line("struck"))
    cue = _cue(clip["cue"], ball, place, extra, faults) if "cue" in clip else None
    if "file" not in texts:
        return None
    file = texts["file"]
    path = path_fault(file) or find_file(root, file)
    if isinstance(path, str):
        faults.add(CLIPS_TOML, f"file = {shown(file)} {path}", place.line("file"))
        return None
    return Entry(file, path, texts.get("struck", ""), place, texts["note"], cue, extra)


def _cue(
    data: object, ball: Ball | None, place: Place, extra: dict[str, Any], faults: Faults
) -> Mapping[str, float] | None:
    if not isinstance(data, dict):
        problem = f"cue = {shown(data)} is not a table: write cue = {{ speed = 1.9, azimuth = 2.68 }}"
        faults.add(CLIPS_TOML, problem, place.line("cue"))
        return None
    values, left = read_numbers(data, "cue", place, faults)
    if left:
        extra["cue"] = left
    offset = math.hypot(values.get("side", 0.0), values.get("height", 0.0))
    if ball is not None and offset > ball.radius:
        problem = f"cue.side, cue.height: {offset:g} m off centre misses the ball (radius {ball.radius:g} m)"
        faults.add(CLIPS_TOML, f"{problem}: write them in m", place.line("cue"))
    return values if {"speed", "azimuth"} <= values.keys() else None
