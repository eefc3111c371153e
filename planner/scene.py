"""A scene, the balls' positions and the goal of the shot, and its TOML file, billiard-scene/1.

In: a scene file, or plain values of its structure. Out: a checked `Scene`; and back.

Table frame as in models/shot.py. A pocket is named by the sides of the table that it stands on, (sx, sy), sx = 0 for a
middle one; its place is where the nose lines meet, or the middle of a long one. Rounded positions let balls overlap
each other or a cushion slightly: up to MAX_OVERLAP_M they are moved apart, since the contact forces of an overlap would
set the balls in motion. Leaves out whether the shot can be played: the search finds out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import tomli_w

from models.errors import BadInput
from models.files import read_toml, write_whole
from models.pocket_shape import read_pockets
from models.shot import Array, Ball, Table
from sysid.clips.faults import CLIPS_TOML, Faults, closest, listed, name_fault, one_line, shown
from sysid.clips.header import MAX_BALL_DENSITY_KG_M3, MIN_BALL_DENSITY_KG_M3, MIN_BALLS_ACROSS_TABLE
from sysid.clips.keys import NUMBER_BOUNDS, Place, read_numbers

FORMAT = "billiard-scene/1"
SECTIONS = ("table", "ball", "balls", "goal")
REST_KEYS = ("rest", "rest_region", "rest_for")
GOAL_KEYS = ("cue", "object", "pocket", *REST_KEYS, "avoid")
MAX_BALLS = 22  # balls of snooker
MAX_OVERLAP_M = 5e-4  # that rounding of positions to about a tenth of a millimetre explains
TOUCH_GAP_M = 1e-9  # between balls that touch; balls that are moved apart end with up to this gap
MAX_ITERATIONS = 2000  # of moving apart
MAX_PLACE_M = 10.0  # of a coordinate; a larger one must be in mm
PLACE_FORM = "in m from the table's centre, x along the length"

Pocket = tuple[int, int]
POCKETS: tuple[Pocket, ...] = ((1, 1), (0, 1), (-1, 1), (-1, -1), (0, -1), (1, -1))


@dataclass(frozen=True)
class Goal:
    """The ball to pot, its pocket, and the goal position of the cue ball."""

    cue: str
    object: str
    pocket: Pocket | None  # None for any
    rest: Array | None = None  # goal position (2,) of the cue ball [m]; None for any
    rest_radius: float = 0.0  # about `rest`, within which every position is as good [m]
    rest_for: str = ""  # the cue ball should leave a shot on this ball
    avoid: tuple[str, ...] = ()  # balls that nothing may touch


@dataclass(frozen=True)
class Scene:
    """Balls at rest on a table, and the goal."""

    table: Table
    ball: Ball
    names: tuple[str, ...]  # the cue ball first, then the object ball
    position: Array  # (n, 2) [m]
    goal: Goal


def pocket_places(table: Table) -> dict[Pocket, Array]:
    """Places (2,) [m] of the pockets, by their sides; empty for a table without pockets."""
    half = np.array([table.length, table.width]) / 2
    return {pocket: half * pocket for pocket in POCKETS} if table.pockets else {}


def pocket_name(pocket: Pocket) -> str:
    """A pocket in words, such as "corner +x -y" or "middle +y"."""
    x, y = ("-" if side < 0 else "+" for side in pocket)
    return f"corner {x}x {y}y" if pocket[0] else f"middle {y}y"


def pocket_of(xy: Array, table: Table, ball: Ball) -> Pocket | None:
    """The pocket that a ball at (2,) [m] has fallen into; None for one on the table, on the brink too."""
    corner = table.shapes.corner
    beyond = corner.edge_depth(corner=True) / math.sqrt(2)
    for pocket, place in pocket_places(table).items():
        if pocket[0] and np.hypot(*(xy - place - beyond * np.array(pocket))) < corner.edge_radius:
            return pocket
        past = abs(xy[1]) > table.centre_limits(ball)[1] + MAX_OVERLAP_M and abs(xy[0]) < table.mouths()[1]
        if not pocket[0] and past and np.hypot(*(xy - place)) < table.shapes.middle.mouth / 2:
            return pocket
    return None


def separate_overlaps(position: Array, table: Table, ball: Ball) -> Array:
    """Positions (n, 2) [m] with overlaps of balls and cushions removed by small shifts; other balls do not move."""
    limit, out = table.centre_limits(ball), np.array(position, float)
    one, other = np.triu_indices(len(out), 1)
    for _ in range(MAX_ITERATIONS):
        out = np.clip(out, -limit, limit)
        offset = out[other] - out[one]
        distance = np.hypot(offset[:, 0], offset[:, 1])
        missing = np.where(distance < ball.diameter, ball.diameter + TOUCH_GAP_M / 2 - distance, 0.0)
        if not missing.any():
            break
        shift = (missing / np.maximum(distance, TOUCH_GAP_M) / 2)[:, None] * offset
        np.add.at(out, one, -shift)
        np.add.at(out, other, shift)
    return out


def largest_overlap(position: Array, ball: Ball) -> tuple[float, int, int]:
    """Largest overlap [m] of two of the balls at (n, 2) [m], negative for a gap, and the numbers of the two."""
    if len(position) < 2:
        return -math.inf, 0, 0
    one, other = np.triu_indices(len(position), 1)
    distance = np.hypot(*(position[other] - position[one]).T)
    k = int(distance.argmin())
    return ball.diameter - float(distance[k]), int(one[k]), int(other[k])


def read_scene(path: Path | str) -> Scene:
    """Read a scene file; BadInput names what is wrong in it, in one line."""
    form = f'a scene begins with format = "{FORMAT}"'
    try:
        data = read_toml(path, "name a scene file", f"correct that line; {form}")
    except BadInput as error:
        raise BadInput(one_line(str(error))) from None
    except (ValueError, RecursionError):  # dates that do not exist, endless digits, a thousand brackets
        _refuse(path, "holds a value that cannot be read: correct the TOML")
    return scene_from(data, str(path))


def write_scene(scene: Scene, path: Path | str) -> None:
    """Write a scene file, whole or not at all."""
    write_whole(path, tomli_w.dumps(scene_dict(scene)).encode())


def scene_dict(scene: Scene) -> dict[str, Any]:
    """A scene as plain values, in the structure of its file."""
    goal = scene.goal
    entries: dict[str, Any] = {"cue": goal.cue, "object": goal.object}
    entries["pocket"] = "any" if goal.pocket is None else list(goal.pocket)
    if goal.rest is not None:
        place = [float(v) for v in goal.rest]
        entries |= {"rest_region": [*place, float(goal.rest_radius)]} if goal.rest_radius else {"rest": place}
    if goal.rest_for:
        entries["rest_for"] = goal.rest_for
    if goal.avoid:
        entries["avoid"] = list(goal.avoid)
    balls = {name: [float(v) for v in xy] for name, xy in zip(scene.names, scene.position, strict=True)}
    table, ball = dataclasses.asdict(scene.table), dataclasses.asdict(scene.ball)
    return {"format": FORMAT, "table": table, "ball": ball, "balls": balls, "goal": entries}


def scene_from(data: Any, where: str) -> Scene:
    """The scene of plain values in the structure of a scene file.

    Args:
        data: as parsed from TOML or JSON.
        where: the source that messages name.

    Raises:
        BadInput: the first thing that is wrong, in one line.
    """
    if not isinstance(data, Mapping):
        _refuse(where, f"{shown(data)} is no scene: give a table with {', '.join(SECTIONS)}")
    if (version := data.get("format")) != FORMAT:
        if version is None:
            _only(data, ("format", *SECTIONS), where)
        fault = "format is missing" if version is None else f"format = {shown(version)} is unknown"
        _refuse(where, f'{fault}: this program reads format = "{FORMAT}"')
    _only(data, ("format", *SECTIONS), where)
    for name in SECTIONS:
        if not isinstance(data.get(name, {}), Mapping):
            _refuse(where, f"{name} = {shown(data[name])} is not a table: write [{name}]")
        if name not in data:
            _refuse(where, f"[{name}] is missing: add it")
    table, ball = _sizes(data, where)
    places = _places(data["balls"], table, ball, f"{where} [balls]")
    goal = _goal(data["goal"], tuple(places), table, ball, f"{where} [goal]")
    names = (goal.cue, goal.object, *(n for n in places if n not in (goal.cue, goal.object)))
    return Scene(table, ball, names, separate_overlaps(np.array([places[n] for n in names]), table, ball), goal)


def _refuse(where: object, text: str) -> NoReturn:
    raise BadInput(one_line(f"{where}: {text}"))


def _only(data: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse unknown keys: a misspelt goal would be ignored."""
    known = tuple(known)
    for key in data:
        if key not in known:
            meant = closest(str(key), known)
            remedy = f"did you mean {meant!r}?" if meant else f"remove it, or choose from {', '.join(known)}"
            _refuse(where, f"unknown key {shown(key)}: {remedy}")


def _sizes(data: Mapping[str, Any], where: str) -> tuple[Table, Ball]:
    """Table and ball, checked as those of a clip set."""
    sizes: dict[str, dict[str, float]] = {}
    for name, more in (("table", ("pockets",)), ("ball", ())):
        _only(data[name], (*NUMBER_BOUNDS[name], *more), f"{where} [{name}]")
        faults = Faults()
        sizes[name], _ = read_numbers(data[name], name, Place(""), faults, more)
        if faults:
            _refuse(f"{where} [{name}]", faults.lines()[0].removeprefix(f"{CLIPS_TOML}: "))
    length, width = sizes["table"]["length"], sizes["table"]["width"]
    diameter, mass = sizes["ball"]["diameter"], sizes["ball"]["mass"]
    try:
        pockets = read_pockets(data["table"].get("pockets", True))
    except BadInput as error:
        _refuse(f"{where} [table]", str(error))
    if not pockets:
        _refuse(f"{where} [table]", "pockets = false leaves no pocket to play for: write true, or remove it")
    if width > length:
        _refuse(f"{where} [table]", f"width = {width:g} exceeds length = {length:g}: exchange them, x is the long axis")
    if diameter > width / MIN_BALLS_ACROSS_TABLE:
        _refuse(f"{where} [ball]", f"diameter = {diameter:g} m does not fit a table {width:g} m wide: correct one")
    low, high = (density * math.pi / 6 * diameter**3 for density in (MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3))
    if not low <= mass <= high:
        _refuse(f"{where} [ball]", f"mass = {mass:g} kg does not fit its diameter: write {low:.2g} to {high:.2g} (kg)")
    return Table(length, width, pockets), Ball(diameter, mass)


def _places(data: Mapping[str, Any], table: Table, ball: Ball, where: str) -> dict[str, Array]:
    """Positions (2,) [m] of the balls, by name."""
    places = {}
    for name, value in data.items():
        if fault := name_fault(name):
            _refuse(where, f"ball {shown(name)} {fault}")
        if name == "world" or "/" in name:
            _refuse(where, f"ball {shown(name)} has a reserved name: choose one without slashes that is not world")
        places[name] = _on_table(value, shown(name), table, ball, where)
    if len(places) > MAX_BALLS:
        _refuse(where, f"{len(places)} balls are more than the {MAX_BALLS} of snooker: remove some")
    depth, i, j = largest_overlap(np.array(list(places.values())).reshape(-1, 2), ball)
    if depth > MAX_OVERLAP_M:
        one, other = (shown(list(places)[k]) for k in (i, j))
        text = f"{one} and {other} overlap: centres {1e3 * (ball.diameter - depth):.1f} mm apart"
        _refuse(where, f"{text}, diameter {1e3 * ball.diameter:.1f} mm: move one of them")
    return places


def _on_table(value: Any, name: str, table: Table, ball: Ball, where: str) -> Array:
    """A position (2,) [m] where a ball can lie."""
    xy = _numbers(value, 2, name, f"[x, y] {PLACE_FORM}", where)
    given, limit = f"{name} = {shown(value)}", table.centre_limits(ball)
    if (np.abs(xy) > MAX_PLACE_M).any() and (np.abs(xy) <= 1e3 * limit).all():
        in_m = [float(f"{v / 1e3:.6g}") for v in xy]
        _refuse(where, f"{given} looks like mm: write {in_m} (m)")
    if (pocket := pocket_of(xy, table, ball)) is not None:
        _refuse(where, f"{given} lies in the pocket {pocket_name(pocket)}: move it onto the table")
    for axis in np.flatnonzero(np.abs(xy) > limit + MAX_OVERLAP_M):
        bound = f"|{'xy'[axis]}| is at most {limit[axis]:.4f} m with the ball at the cushion"
        _refuse(where, f"{given} lies outside the playing surface: {bound}; write it {PLACE_FORM}")
    return np.clip(xy, -limit, limit)


def _numbers(value: Any, count: int, name: str, form: str, where: str) -> Array:
    """`count` finite numbers: (count,)."""
    is_list = isinstance(value, list | tuple) and len(value) == count
    if not is_list or any(isinstance(v, bool) or not isinstance(v, int | float) for v in value):
        _refuse(where, f"{name} = {shown(value)} is not {count} numbers: write {form}")
    numbers = [float(v) if abs(v) < 1e300 else math.inf for v in value]
    if not np.isfinite(numbers).all():
        _refuse(where, f"{name} = {shown(value)} is not finite: write {form}")
    return np.array(numbers)


def _goal(data: Mapping[str, Any], names: tuple[str, ...], table: Table, ball: Ball, where: str) -> Goal:
    """The goal, of balls of these names."""
    _only(data, GOAL_KEYS, where)
    cue = _named(data, "cue", names, where)
    target = _named(data, "object", tuple(n for n in names if n != cue), where, {cue: "is the cue ball"})
    if "pocket" not in data:
        _refuse(where, 'pocket is missing: add pocket = [sx, sy], the sides it stands on, or pocket = "any"')
    if len(given := [key for key in REST_KEYS if key in data]) > 1:
        _refuse(where, f"{' and '.join(given)} exclude each other: keep one")
    rest, radius, next_ball = None, 0.0, ""
    if "rest" in data:
        rest = _on_table(data["rest"], "rest", table, ball, where)
    if "rest_region" in data:
        form = f"[x, y, radius] {PLACE_FORM}"
        *centre, radius = (float(v) for v in _numbers(data["rest_region"], 3, "rest_region", form, where))
        rest = _on_table(centre, "the middle of rest_region", table, ball, where)
        if radius > table.length:
            _refuse(where, f"rest_region: radius {radius:g} m exceeds the table: write it in m")
        if radius <= 0:
            _refuse(where, f"rest_region: radius {radius:g} is not positive: write it in m, or rest = [x, y]")
    if "rest_for" in data:
        gone = {cue: "is the cue ball", target: "is the object ball, which is gone by then"}
        next_ball = _named(data, "rest_for", tuple(n for n in names if n not in gone), where, gone)
    avoid = data.get("avoid", [])
    if not isinstance(avoid, list | tuple):
        _refuse(where, f"avoid = {shown(avoid)} is not a list: write the names of balls in brackets")
    played = {cue: "is the cue ball", target: "is the object ball"}
    others = tuple(n for n in names if n not in played)
    avoided = [_named({"avoid": name}, "avoid", others, where, played) for name in avoid]
    pocket = _pocket(data["pocket"], where)
    return Goal(cue, target, pocket, rest, radius, next_ball, tuple(dict.fromkeys(avoided)))


def _named(
    data: Mapping[str, Any], key: str, names: tuple[str, ...], where: str, barred: Mapping[str, str] | None = None
) -> str:
    """The ball that a key names, one of `names`; `barred` gives the reasons why others are not allowed."""
    choice = f"choose from {listed(names)}" if names else "add a ball to [balls]"
    if key not in data:
        _refuse(where, f"{key} is missing: {choice}")
    value = data[key]
    if not isinstance(value, str):
        _refuse(where, f"{key} = {shown(value)} is not the name of a ball: {choice}")
    if value in names:
        return value
    if barred and value in barred:
        _refuse(where, f"{key} = {shown(value)} {barred[value]}: {choice}")
    meant = closest(value, names)
    remedy = f"did you mean {meant!r}?" if meant else choice
    _refuse(where, f"{key} = {shown(value)} is not among the balls: {remedy}")


def _pocket(value: Any, where: str) -> Pocket | None:
    """The pocket; None for any."""
    if value == "any":
        return None
    form = 'write [sx, sy] with sx of -1, 0, 1 and sy of -1, 1, or "any"'
    if not isinstance(value, list | tuple) or len(value) != 2 or any(type(v) not in (int, float) for v in value):
        _refuse(where, f"pocket = {shown(value)} is no pocket: {form}")
    for pocket in POCKETS:
        if tuple(value) == pocket:
            return pocket
    why = "there is none in the middle of the end cushions" if list(value) in ([1, 0], [-1, 0]) else ""
    why = "there is none in the middle of the table" if list(value) == [0, 0] else why
    _refuse(where, f"pocket = {shown(value)} is no pocket{', ' * bool(why)}{why}: {form}")
