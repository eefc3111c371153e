"""A scene, the balls' positions and the goal of the shot, and its TOML file, billiard-scene/1.

In: a scene file, or plain values of its structure. Out: a checked `Scene`; and back.

Table frame as in models/shot.py. A pocket is named by the sides of the table that it stands on, (sx, sy), sx = 0 for a
middle one; its place is where the nose lines meet, or the middle of a long one. Rounded positions let balls overlap
each other or a cushion slightly: up to MAX_OVERLAP_M they are moved apart, since the contact forces of an overlap would
set the balls in motion. Left out: whether the shot can be played, which the search finds out.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w

from models.analytic.pocket import pockets_of
from models.errors import BadInput
from models.files import read_document, write_whole
from models.files.decode import Allowed, decode, of_format, read_value
from models.files.faults import Faults, closest, listed, shown
from models.files.limits import excess
from models.files.place import Place
from models.shot import Array, Ball, Table, largest_overlap
from models.table.presets import named_table
from sysid.clips.header import size_faults
from sysid.clips.names import name_fault

SCENE_FORMAT = "billiard-scene/1"
REST_KEYS = ("rest", "rest_region", "rest_for")
MAX_BALLS = 22  # number of snooker balls
MAX_OVERLAP_M = 5e-4  # largest overlap explained by rounding of positions to about a tenth of a millimetre
TOUCH_GAP_M = 1e-9  # largest gap of touching balls; balls that are moved apart end with up to this gap
MAX_ITERATIONS = 2000  # iterations of moving balls apart
MAX_PLACE_M = 10.0  # largest coordinate; a larger one must be in mm
PLACE_FORM = "in m from the table's centre, x along the length"
PLACE_ENTRY = Allowed(unit="m", shape=(2,), form=f"[x, y] {PLACE_FORM}")
POCKET_FORM = '[sx, sy], the sides it stands on: sx of -1, 0, 1 and sy of -1, 1; or "any"'

Pocket = tuple[int, int]
POCKETS: tuple[Pocket, ...] = ((1, 1), (0, 1), (-1, 1), (-1, -1), (0, -1), (1, -1))


@dataclass(frozen=True)
class Goal:
    """The ball to pot, its pocket, and the goal position of the cue ball."""

    cue: str
    object: str
    pocket: Pocket | None  # None for any
    rest: Array | None = None  # goal position (2,) of the cue ball [m]; None for any
    rest_radius: float = 0.0  # radius around `rest` within which every position is equally good [m]
    rest_for: str = ""  # the cue ball should leave a shot on this ball
    avoid: tuple[str, ...] = ()  # balls that nothing may touch


@dataclass(frozen=True)
class GoalEntries:
    """The keys of a scene file's [goal]."""

    cue: Annotated[str, Allowed(form="cue, the name of a ball")]
    object: Annotated[str, Allowed(form="object, the name of a ball")]
    pocket: Annotated[Any, Allowed(form=f"pocket = {POCKET_FORM}")]
    rest: Any = None
    rest_region: Annotated[Array | None, Allowed(shape=(3,), form=f"[x, y, radius] {PLACE_FORM}")] = None
    rest_for: Annotated[str | None, Allowed(form="the name of a ball")] = None
    avoid: tuple[str, ...] = ()


@dataclass(frozen=True)
class SceneFile:
    """The keys of a scene file."""

    table: Table
    ball: Ball
    balls: Mapping[str, Any]
    goal: GoalEntries
    camera_doubts: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class Scene:
    """Balls at rest on a table, and the goal."""

    table: Table
    ball: Ball
    names: tuple[str, ...]  # the cue ball first, then the object ball
    position: Array  # (n, 2) [m]
    goal: Goal
    camera_doubts: tuple[str, ...] = ()  # reasons to doubt the camera that took it

    def __repr__(self) -> str:
        pocket = "any pocket" if self.goal.pocket is None else f"the pocket {pocket_name(self.goal.pocket)}"
        return f"<Scene of {', '.join(self.names)}: {self.goal.object} into {pocket}>"


def pocket_places(table: Table) -> dict[Pocket, Array]:
    """Positions (2,) [m] of the pockets, by their sides; empty for a table without pockets."""
    half = np.array([table.length, table.width]) / 2
    return {pocket: half * pocket for pocket in POCKETS} if table.pockets else {}


def pocket_name(pocket: Pocket) -> str:
    """A pocket in words, such as "corner +x -y" or "middle +y"."""
    x, y = ("-" if side < 0 else "+" for side in pocket)
    return f"corner {x}x {y}y" if pocket[0] else f"middle {y}y"


def pocket_of(xy: Array, table: Table, ball: Ball) -> Pocket | None:
    """The pocket into which a ball at (2,) [m] has fallen; None for one on the table, even on the brink."""
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
    """Positions (n, 2) [m] with overlaps of balls and cushions removed by small shifts of the balls concerned."""
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


def read_scene(path: Path | str) -> Scene:
    """Read a scene file; BadInput names its faults."""
    faults = Faults()
    data = read_document(path, str(path), faults, "name a scene file")
    return scene_from(faults.settle(data), str(path))


def write_scene(scene: Scene, path: Path | str) -> None:
    """Write a scene file, completely or not at all."""
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
    doubts = {"camera_doubts": list(scene.camera_doubts)} if scene.camera_doubts else {}
    return {"format": SCENE_FORMAT, **doubts, "table": table, "ball": ball, "balls": balls, "goal": entries}


def scene_from(data: Any, where: str) -> Scene:
    """The scene from plain values in the structure of a scene file.

    Args:
        data: as parsed from TOML or JSON.
        where: the source, for messages.

    Raises:
        BadInput: the first fault, in one line; the others are its notes.
    """
    faults = Faults()
    top = Place(where, faults)
    body = of_format(data, SCENE_FORMAT, SceneFile, top)
    file = faults.settle(None if body is None else decode(SceneFile, named_table(body, top), top))
    table, ball = file.table, file.ball
    for section, _, problem in size_faults(table, ball):
        top.below(section).fault(problem)
    if not table.pockets:
        top.below("table").fault("pockets = false leaves no pocket to play for: write true, or remove it")
    try:
        pockets_of(table, ball)
    except BadInput as problem:
        top.below("table").fault(str(problem))
    faults.settle(table)  # places and names depend on the entries before them
    places = faults.settle(_places(file.balls, table, ball, top.below("balls")))
    goal = faults.settle(_goal(file.goal, tuple(places), table, ball, top.below("goal")))
    names = (goal.cue, goal.object, *(n for n in places if n not in (goal.cue, goal.object)))
    position = separate_overlaps(np.array([places[n] for n in names]), table, ball)
    return Scene(table, ball, names, position, goal, file.camera_doubts)


def _places(data: Mapping[str, Any], table: Table, ball: Ball, at: Place) -> dict[str, Array]:
    """Positions (2,) [m] of the balls without faults, by name."""
    places = dict[str, Array]()
    if problem := excess(len(data), MAX_BALLS, "balls", "snooker has no more, remove some"):
        at.fault(problem)
        return places
    for name, value in data.items():
        if fault := name_fault(name):
            at.fault(f"ball {shown(name)} {fault}")
        elif name == "world" or "/" in name:
            at.fault(f"ball {shown(name)} has a reserved name: choose one without slashes, other than world")
        elif (xy := _on_table(value, shown(name), table, ball, at)) is not None:
            places[name] = xy
    depth, i, j = largest_overlap(np.array(list(places.values())).reshape(-1, 2), ball)
    if depth > MAX_OVERLAP_M:
        one, other = (shown(list(places)[k]) for k in (i, j))
        text = f"{one} and {other} overlap: centres {1e3 * (ball.diameter - depth):.1f} mm apart"
        at.fault(f"{text}, diameter {1e3 * ball.diameter:.1f} mm: move one of them")
    return places


def _on_table(value: Any, name: str, table: Table, ball: Ball, at: Place) -> Array | None:
    """A valid position (2,) [m] of a ball; None, with the fault noted, for an invalid one."""
    xy = read_value(name, value, Array, PLACE_ENTRY, at)
    if xy is None:
        return None
    given, limit = f"{name} = {shown(value)}", table.centre_limits(ball)
    if (np.abs(xy) > MAX_PLACE_M).any() and (np.abs(xy) <= 1e3 * limit).all():
        in_m = [float(f"{v / 1e3:.6g}") for v in xy]
        at.fault(f"{given} looks like mm: write {in_m} (m)")
    elif (pocket := pocket_of(xy, table, ball)) is not None:
        at.fault(f"{given} is in the pocket {pocket_name(pocket)}: move it onto the table")
    elif len(over := np.flatnonzero(np.abs(xy) > limit + MAX_OVERLAP_M)):
        bound = f"|{'xy'[over[0]]}| is at most {limit[over[0]]:.4f} m with the ball at the cushion"
        at.fault(f"{given} is outside the playing surface: {bound}; write it {PLACE_FORM}")
    else:
        return np.clip(xy, -limit, limit)
    return None


def _goal(given: GoalEntries, names: tuple[str, ...], table: Table, ball: Ball, at: Place) -> Goal:
    """The goal, for balls with these names; its faults are noted."""
    cue, target = given.cue, given.object
    _check_named("cue", cue, names, {}, at)
    _check_named("object", target, names, {cue: "is the cue ball"}, at)
    if len(keys := [key for key in REST_KEYS if getattr(given, key) is not None]) > 1:
        at.fault(f"{' and '.join(keys)} exclude each other: keep one")
    rest, radius = None, 0.0
    if given.rest is not None:
        rest = _on_table(given.rest, "rest", table, ball, at)
    if given.rest_region is not None:
        *centre, radius = (float(v) for v in given.rest_region)
        rest = _on_table(centre, "the middle of rest_region", table, ball, at)
        if radius > table.length:
            at.fault(f"rest_region: radius {radius:g} m exceeds the table: write it in m")
        if radius <= 0:
            at.fault(f"rest_region: radius {radius:g} is not positive: write it in m, or rest = [x, y]")
    if given.rest_for is not None:
        gone = {cue: "is the cue ball", target: "is the object ball, which is gone by then"}
        _check_named("rest_for", given.rest_for, names, gone, at)
    for name in given.avoid:
        _check_named("avoid", name, names, {cue: "is the cue ball", target: "is the object ball"}, at)
    pocket = _pocket(given.pocket, at)
    return Goal(cue, target, pocket, rest, radius, given.rest_for or "", tuple(dict.fromkeys(given.avoid)))


def _check_named(key: str, name: str, names: tuple[str, ...], barred: Mapping[str, str], at: Place) -> None:
    """Note a fault for a missing ball, or for one in `barred`, which gives the reasons."""
    free = [n for n in names if n not in barred]
    if name not in free:
        meant = None if name in barred else closest(name, free)
        choice = f"choose from {listed(free)}" if free else "add a ball to [balls]"
        remedy = f"did you mean {meant!r}?" if meant else choice
        at.fault(f"{key} = {shown(name)} {barred.get(name, 'is not among the balls')}: {remedy}", key)


def _pocket(value: Any, at: Place) -> Pocket | None:
    """The pocket; None for any, or, with the fault noted, for an invalid one."""
    numbers = isinstance(value, list | tuple) and len(value) == 2 and all(type(v) in (int, float) for v in value)
    found = next((pocket for pocket in POCKETS if numbers and tuple(value) == pocket), None)
    if found is None and value != "any":
        why = ", there is none in the middle of the end cushions" if value in ([1, 0], [-1, 0]) else ""
        why = ", there is none in the middle of the table" if value == [0, 0] else why
        at.fault(f"pocket = {shown(value)} is not a pocket{why}: write {POCKET_FORM}", "pocket")
    return found
