"""What is to be played: where the balls lie and what the shot is for; and its TOML file, billiard-scene/1.

Table frame as in models/shot.py. A pocket is named by the sides of the table it stands on, (sx, sy), sx = 0 for a
middle one, and its place is where the nose lines meet, or the middle of a long one. Places that are rounded put balls a
little into each other or into a cushion: up to SLIGHT they are moved apart, since a simulation that begins with an
overlap begins with a push. Leaves out whether the shot can be played: that is the search's to find.
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
from models.shot import MIDDLE_ACCEPTANCE, Array, Ball, Table
from sysid.clips.faults import CLIPS_TOML, Faults, closest, listed, name_fault, one_line, shown
from sysid.clips.header import MAX_BALL_DENSITY_KG_M3, MIN_BALL_DENSITY_KG_M3, MIN_BALLS_ACROSS_TABLE
from sysid.clips.keys import NUMBER_BOUNDS, Place, read_numbers

FORMAT = "billiard-scene/1"
SECTIONS = ("table", "ball", "balls", "goal")
RESTS = ("rest", "rest_region", "rest_for")
GOAL = ("cue", "object", "pocket", *RESTS, "avoid")
MOST = 22  # balls of snooker
SLIGHT = 5e-4  # overlap that rounding to a tenth of a millimetre or so explains [m]
TOUCH = 1e-9  # gap that counts as touching, in which balls moved apart are left [m]
ROUNDS = 2000  # of moving apart
FARTHEST = 10.0  # of a place from the table's centre that can be meant in metres [m]
WHERE = "in m from the table's centre, x along the length"

Pocket = tuple[int, int]
POCKETS: tuple[Pocket, ...] = ((1, 1), (0, 1), (-1, 1), (-1, -1), (0, -1), (1, -1))


@dataclass(frozen=True)
class Goal:
    """What the shot is for: which ball goes where, and where the cue ball comes to rest."""

    cue: str
    object: str
    pocket: Pocket | None  # None for any
    rest: Array | None = None  # (2,) of the cue ball [m]; None for anywhere
    rest_radius: float = 0.0  # about `rest`, within which every place is as good [m]
    rest_for: str = ""  # anywhere that leaves a shot on this ball
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
    """Where the pockets are, by their sides: (2,) [m]; none on a table without."""
    half = np.array([table.length, table.width]) / 2
    return {pocket: half * pocket for pocket in POCKETS} if table.pockets else {}


def pocket_name(pocket: Pocket) -> str:
    """A pocket in words, such as "corner +x -y" or "middle +y"."""
    x, y = ("-" if side < 0 else "+" for side in pocket)
    return f"corner {x}x {y}y" if pocket[0] else f"middle {y}y"


def pocket_of(xy: Array, table: Table, ball: Ball) -> Pocket | None:
    """The pocket that a ball at (2,) [m] has dropped into; None for one on the table, if on the brink."""
    for pocket, place in pocket_places(table).items():
        past = abs(xy[1]) > table.reach(ball)[1] + SLIGHT and abs(xy[0]) < MIDDLE_ACCEPTANCE
        if np.hypot(*(xy - place)) < table.mouths()[2] and (pocket[0] or past):
            return pocket
    return None


def settled(position: Array, table: Table, ball: Ball) -> Array:
    """Places (n, 2) [m] moved as little as makes no ball overlap another or a cushion; others stay as they are."""
    reach, out = table.reach(ball), np.array(position, float)
    one, other = np.triu_indices(len(out), 1)
    for _ in range(ROUNDS):
        out = np.clip(out, -reach, reach)
        way = out[other] - out[one]
        far = np.hypot(way[:, 0], way[:, 1])
        short = np.where(far < ball.diameter, ball.diameter + TOUCH / 2 - far, 0.0)
        if not short.any():
            break
        push = (short / np.maximum(far, TOUCH) / 2)[:, None] * way
        np.add.at(out, one, -push)
        np.add.at(out, other, push)
    return out


def overlap(position: Array, ball: Ball) -> tuple[float, int, int]:
    """By how much the two of balls at (n, 2) [m] that are nearest to each other overlap [m], and which they are."""
    if len(position) < 2:
        return -math.inf, 0, 0
    one, other = np.triu_indices(len(position), 1)
    far = np.hypot(*(position[other] - position[one]).T)
    k = int(far.argmin())
    return ball.diameter - float(far[k]), int(one[k]), int(other[k])


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
    wanted: dict[str, Any] = {"cue": goal.cue, "object": goal.object}
    wanted["pocket"] = "any" if goal.pocket is None else list(goal.pocket)
    if goal.rest is not None:
        place = [float(v) for v in goal.rest]
        wanted |= {"rest_region": [*place, float(goal.rest_radius)]} if goal.rest_radius else {"rest": place}
    if goal.rest_for:
        wanted["rest_for"] = goal.rest_for
    if goal.avoid:
        wanted["avoid"] = list(goal.avoid)
    balls = {name: [float(v) for v in xy] for name, xy in zip(scene.names, scene.position, strict=True)}
    table, ball = dataclasses.asdict(scene.table), dataclasses.asdict(scene.ball)
    return {"format": FORMAT, "table": table, "ball": ball, "balls": balls, "goal": wanted}


def scene_from(data: Any, where: str) -> Scene:
    """The scene that plain values hold, in the structure of a scene file.

    Args:
        data: as parsed from TOML or JSON.
        where: what messages name as the place they come from.

    Raises:
        BadInput: the first thing that is wrong, in one line.
    """
    if not isinstance(data, Mapping):
        _refuse(where, f"{shown(data)} is no scene: give a table with {', '.join(SECTIONS)}")
    if (version := data.get("format")) != FORMAT:
        if version is None:
            _only(data, ("format", *SECTIONS), where)
        said = "format is missing" if version is None else f"format = {shown(version)} is unknown"
        _refuse(where, f'{said}: this program reads format = "{FORMAT}"')
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
    return Scene(table, ball, names, settled(np.array([places[n] for n in names]), table, ball), goal)


def _refuse(where: object, text: str) -> NoReturn:
    raise BadInput(one_line(f"{where}: {text}"))


def _only(data: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    """Refuse keys that the format does not name: a goal that is misspelt would be no goal."""
    known = tuple(known)
    for key in data:
        if key not in known:
            meant = closest(str(key), known)
            remedy = f"did you mean {meant!r}?" if meant else f"remove it, or choose from {', '.join(known)}"
            _refuse(where, f"unknown key {shown(key)}: {remedy}")


def _sizes(data: Mapping[str, Any], where: str) -> tuple[Table, Ball]:
    """Table and ball, on the terms of a clip set."""
    found: dict[str, dict[str, float]] = {}
    for name, more in (("table", ("pockets",)), ("ball", ())):
        _only(data[name], (*NUMBER_BOUNDS[name], *more), f"{where} [{name}]")
        faults = Faults()
        found[name], _ = read_numbers(data[name], name, Place(""), faults, more)
        if faults:
            _refuse(f"{where} [{name}]", faults.lines()[0].removeprefix(f"{CLIPS_TOML}: "))
    length, width = found["table"]["length"], found["table"]["width"]
    diameter, mass = found["ball"]["diameter"], found["ball"]["mass"]
    if not isinstance(pockets := data["table"].get("pockets", True), bool):
        _refuse(f"{where} [table]", f"pockets = {shown(pockets)} is not true or false: write one of them")
    if not pockets:
        _refuse(f"{where} [table]", "pockets = false leaves nothing to play for: write true, or remove it")
    if width > length:
        _refuse(f"{where} [table]", f"width = {width:g} exceeds length = {length:g}: exchange them, x is the long way")
    if diameter > width / MIN_BALLS_ACROSS_TABLE:
        _refuse(f"{where} [ball]", f"diameter = {diameter:g} m does not fit a table {width:g} m wide: correct one")
    low, high = (density * math.pi / 6 * diameter**3 for density in (MIN_BALL_DENSITY_KG_M3, MAX_BALL_DENSITY_KG_M3))
    if not low <= mass <= high:
        _refuse(f"{where} [ball]", f"mass = {mass:g} kg does not fit its diameter: write {low:.2g} to {high:.2g} (kg)")
    return Table(length, width, pockets), Ball(diameter, mass)


def _places(data: Mapping[str, Any], table: Table, ball: Ball, where: str) -> dict[str, Array]:
    """Where the balls lie: (2,) [m] by name."""
    places = {}
    for name, value in data.items():
        if fault := name_fault(name):
            _refuse(where, f"ball {shown(name)} {fault}")
        if name == "world" or "/" in name:
            _refuse(where, f"ball {shown(name)} cannot be called so: choose a name without slashes that is not world")
        places[name] = _on_table(value, shown(name), table, ball, where)
    if len(places) > MOST:
        _refuse(where, f"{len(places)} balls are more than the {MOST} of snooker: remove some")
    deep, i, j = overlap(np.array(list(places.values())).reshape(-1, 2), ball)
    if deep > SLIGHT:
        one, other = (shown(list(places)[k]) for k in (i, j))
        text = f"{one} and {other} overlap: centres {1e3 * (ball.diameter - deep):.1f} mm apart"
        _refuse(where, f"{text}, diameter {1e3 * ball.diameter:.1f} mm: move one of them")
    return places


def _on_table(value: Any, what: str, table: Table, ball: Ball, where: str) -> Array:
    """A place (2,) [m] where a ball can lie."""
    xy = _numbers(value, 2, f"{what} = {shown(value)}", f"[x, y] {WHERE}", where)
    reach = table.reach(ball)
    if (np.abs(xy) > FARTHEST).any() and (np.abs(xy) <= 1e3 * reach).all():
        right = [float(f"{v / 1e3:.6g}") for v in xy]
        _refuse(where, f"{what} = {shown(value)} looks like mm: write {right} (m)")
    if (pocket := pocket_of(xy, table, ball)) is not None:
        _refuse(where, f"{what} = {shown(value)} lies in the pocket {pocket_name(pocket)}: move it onto the table")
    for axis in np.flatnonzero(np.abs(xy) > reach + SLIGHT):
        far = f"|{'xy'[axis]}| is at most {reach[axis]:.4f} m with the ball at the cushion"
        _refuse(where, f"{what} = {shown(value)} lies outside the playing surface: {far}; write it {WHERE}")
    return np.clip(xy, -reach, reach)


def _numbers(value: Any, count: int, said: str, form: str, where: str) -> Array:
    """So many finite numbers: (count,)."""
    right = isinstance(value, list | tuple) and len(value) == count
    if not right or any(isinstance(v, bool) or not isinstance(v, int | float) for v in value):
        _refuse(where, f"{said} is not {count} numbers: write {form}")
    numbers = [float(v) if abs(v) < 1e300 else math.inf for v in value]
    if not np.isfinite(numbers).all():
        _refuse(where, f"{said} is not finite: write {form}")
    return np.array(numbers)


def _goal(data: Mapping[str, Any], names: tuple[str, ...], table: Table, ball: Ball, where: str) -> Goal:
    """What is wanted, of balls of these names."""
    _only(data, GOAL, where)
    cue = _named(data, "cue", names, where)
    target = _named(data, "object", tuple(n for n in names if n != cue), where, {cue: "is the cue ball"})
    if "pocket" not in data:
        _refuse(where, 'pocket is missing: add pocket = [sx, sy], the sides it stands on, or pocket = "any"')
    if len(given := [key for key in RESTS if key in data]) > 1:
        _refuse(where, f"{' and '.join(given)} exclude each other: keep one")
    rest, radius, wanted = None, 0.0, ""
    if "rest" in data:
        rest = _on_table(data["rest"], "rest", table, ball, where)
    if "rest_region" in data:
        form = f"[x, y, radius] {WHERE}"
        region = _numbers(value := data["rest_region"], 3, f"rest_region = {shown(value)}", form, where)
        rest, radius = (
            _on_table([float(v) for v in region[:2]], "the middle of rest_region", table, ball, where),
            region[2],
        )
        if radius > table.length:
            _refuse(where, f"rest_region: radius {radius:g} m exceeds the table: write it in m")
        if radius <= 0:
            _refuse(where, f"rest_region: radius {radius:g} is not positive: write it in m, or rest = [x, y]")
    if "rest_for" in data:
        gone = {cue: "is the cue ball", target: "is the object ball, which is gone by then"}
        wanted = _named(data, "rest_for", tuple(n for n in names if n not in gone), where, gone)
    avoid = data.get("avoid", [])
    if not isinstance(avoid, list | tuple):
        _refuse(where, f"avoid = {shown(avoid)} is not a list: write the names of balls in brackets")
    played = {cue: "is the cue ball", target: "is the object ball"}
    others = tuple(n for n in names if n not in played)
    spared = [_named({"avoid": name}, "avoid", others, where, played) for name in avoid]
    pocket = _pocket(data["pocket"], where)
    return Goal(cue, target, pocket, rest, float(radius), wanted, tuple(dict.fromkeys(spared)))


def _named(
    data: Mapping[str, Any], key: str, names: tuple[str, ...], where: str, barred: Mapping[str, str] | None = None
) -> str:
    """The ball that a key names, one of `names`; `barred` says of others why they are not."""
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
