"""A plan played once: checks, the stroke, what was seen, and the record of what was done.

In: a plan file, a launcher, a camera. Out: PLAN.played.json beside the plan, and the film in a clip set.

Nothing moves until plan, limits, scene and the places to write to are checked. Then: home or retract where the launcher
needs it, the tip to its place, a confirmation by the operator, one stroke, the cue back, the film into a clip set. One
call strikes at most once. Where the line failed after the stroke's command, the record says "unknown" and holds what
was seen, nothing more moves, and StrokeUnknown is raised to the caller.

The planned string is struck where the launcher's calibration gives it the planned cue speed within half a step, and the
nearest string of the calibration otherwise. The record is of the last play of its plan; clips are kept of all. Leaves
out turning the stand, which is done by hand, and a plan whose balls have other names than the camera's.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from models.console import write_json
from models.errors import BadInput
from models.shot import Array, Ball, Table
from planner.planning import read_plan
from planner.scene import POCKETS, Pocket, Scene, pocket_name, pocket_places, scene_from
from robot.device.launcher import Launcher
from robot.device.outcome import Done, StrokeUnknown
from robot.device.protocol import LauncherError, string_number
from robot.device.settings import Settings
from sysid.clips import Clip, ClipSet, CueCommand, Observation, read_clip_set, write_clip_set
from sysid.clips.trust import with_doubts

PLAYED_FORMAT = "billiard-played/1"
PLACE_TOLERANCE_M = 5e-3  # of a ball's place against the plan's
HALF_STRING_STEP = 0.5 * 2.45 / 199  # half the step of cue speed between the paper's strings [m/s]
RADIUS_TOLERANCE_M = 1e-4  # of the settings' ball radius against the scene's
POCKETED_DISTANCE_M = 0.15  # from a pocket, within which a ball that disappears has been pocketed
CUE_FIELDS = ("speed", "azimuth", "side", "height", "elevation")


@dataclass(frozen=True)
class FilmedFrames:
    """The frames of a video that show a clip, counted from 0."""

    video: Path
    first: int  # that of the clip's first sample
    last: int


class ShotCamera(Protocol):
    """A camera over the table; robot/camera/live.py or robot/emulator/table.py."""

    @property
    def table(self) -> Table: ...
    @property
    def ball(self) -> Ball: ...
    @property
    def fps(self) -> float: ...  # [1/s]
    @property
    def sigma(self) -> float: ...  # of a place, each axis [m]
    @property
    def doubts(self) -> tuple[str, ...]: ...  # why its calibration is not to be trusted
    @property
    def filmed(self) -> FilmedFrames | None: ...  # of the last film; None where there is no video

    def look(self) -> Mapping[str, Array]:
        """Where the resting balls are seen, by name: (2,) [m]."""
        ...

    def arm(self) -> None:
        """Begin to film: a stroke is about to be made."""
        ...

    def film(self) -> Mapping[str, Observation]:
        """The balls' places since the last film ended, t = 0 at the hit; empty where nothing was filmed."""
        ...


@dataclass(frozen=True)
class Order:
    """A plan's stroke in the terms of one launcher, within its limits."""

    scene: Scene
    string: str
    x0_mm: float
    y0_mm: float
    yaw_deg: float
    cue: CueCommand  # as commanded, for the clip
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Played:
    """The result of playing a plan."""

    struck: str  # "yes", "unknown", or "dry"
    done: Done | None  # None where the stroke is unknown
    when: str  # UTC, ISO 8601
    clip: str | None  # the file within the clip set
    cue_end: tuple[float, float] | None  # where the cue ball ended [m]; None where it fell or was not seen
    object_end: tuple[float, float] | None
    cue_fell: bool | None  # None where its end was not seen
    potted: bool | None  # the object ball, into a pocket that counts
    pocket: str | None  # into which it fell
    from_wanted: float | None  # of the cue ball from its wanted place [m]; None where none was wanted, or it fell
    noted: tuple[str, ...]  # unusual events


def played_file(plan: Path | str) -> Path:
    """The record of a plan, beside it."""
    return Path(plan).with_suffix(".played.json")


def read_order(plan: Path | str, settings: Settings) -> Order:
    """Read a plan for a launcher.

    Raises:
        BadInput: no plan, no stroke in it, or one beyond the launcher's limits.
    """
    data = read_plan(plan)
    if data.get("stroke") is None:
        raise BadInput(f"{plan}: holds no stroke ({data.get('why', 'no reason given')}); plan another shot")
    scene = scene_from(data.get("scene"), f"{plan} scene")
    cue = CueCommand(**{name: _number(data, "stroke", name, plan) for name in CUE_FIELDS})
    x0_mm, y0_mm, yaw = (_number(data, "launcher", name, plan) for name in ("x0_mm", "y0_mm", "theta_deg"))
    wanted = _number(data, "launcher", "cue_speed", plan)
    check_radius(settings, scene.ball, f"{plan}: its balls", "plan for these balls")
    try:
        string, notes = _string(data["launcher"].get("string"), wanted, settings)
        settings.stage_um(x0_mm, y0_mm)
        yaw = settings.check_yaw(yaw)
    except BadInput as error:
        raise BadInput(f"{plan}: {error}") from None
    return Order(scene, string, x0_mm, y0_mm, yaw, cue, notes)


def check_radius(settings: Settings, ball: Ball, which: str, remedy: str) -> None:
    """BadInput where the launcher is set for other balls than `which`."""
    radius = 1e3 * ball.radius
    if abs(settings.stage.ball_radius_mm - radius) > 1e3 * RADIUS_TOLERANCE_M:
        raise BadInput(
            f"{which} have a radius of {radius:g} mm, the launcher is set for "
            f"{settings.stage.ball_radius_mm:g} mm; correct [stage] ball_radius_mm, or {remedy}"
        )


def _string(planned: Any, wanted: float, settings: Settings) -> tuple[str, tuple[str, ...]]:
    """The string to strike, within the limits, and notes on it."""
    number = string_number(planned)
    table = settings.calibration
    low, high = table.strings[0], table.strings[-1]
    speed = table.cue_speed(number) if low <= number <= high else math.nan
    if abs(speed - wanted) <= HALF_STRING_STEP + 1e-6:
        settings.check_speed(number)
        return f"{number:03d}p", ()
    other = table.string(wanted)
    settings.check_speed(other)
    if other == number:
        return f"{number:03d}p", ()
    gives = f"gives {speed:.3f} m/s" if math.isfinite(speed) else "is not calibrated"
    return f"{other:03d}p", (f"{number:03d}p {gives} here, {wanted:.3f} m/s is planned: {other:03d}p instead",)


def _number(data: Mapping[str, Any], section: str, name: str, plan: Path | str) -> float:
    part = data.get(section)
    value = part.get(name) if isinstance(part, Mapping) else None
    if not isinstance(value, int | float) or isinstance(value, bool) or not math.isfinite(value):
        raise BadInput(f"{plan}: {name} of its {section} is {value!r}; give a number, or make the plan again")
    return float(value)


def check_scene(
    scene: Scene, seen: Mapping[str, Array], plan: Path | str, tolerance: float = PLACE_TOLERANCE_M
) -> None:
    """BadInput names the ball that lies farthest from where the plan has it, is missing, or is one too many."""
    remedy = "put it right, or plan again from a new picture"
    for name in scene.names:
        if name not in seen:
            raise BadInput(f"{plan}: ball {name} is not seen on the table; {remedy}")
    for name, xy in seen.items():
        if name not in scene.names:
            raise BadInput(f"{plan}: ball {name} lies at {_place(xy)} and is not in the plan; {remedy}")
    off = [float(np.hypot(*(seen[name] - xy))) for name, xy in zip(scene.names, scene.position, strict=True)]
    k = int(np.argmax(off))
    if not off[k] <= tolerance:
        raise BadInput(
            f"{plan}: ball {scene.names[k]} lies {1e3 * off[k]:.1f} mm from where the plan has it, "
            f"at {_place(seen[scene.names[k]])}; {remedy} (within {1e3 * tolerance:g} mm)"
        )


def _place(xy: Array) -> str:
    return f"{xy[0]:.4f}, {xy[1]:.4f}"


def play_plan(
    plan: Path | str,
    launcher: Launcher,
    camera: ShotCamera | None = None,
    confirm: Callable[[str], bool] | None = None,
    *,
    clips: Path | str | None = None,
    tolerance: float = PLACE_TOLERANCE_M,
    say: Callable[[str], None] = print,
) -> Played:
    """Play a plan once.

    Args:
        plan: its file; PLAN.played.json is written beside it, but not by a dry run.
        launcher: connected, or dry; its settings hold the limits.
        camera: over the table; None: the scene is not checked and nothing is filmed.
        confirm: called before the stroke with what will be done; None: no confirmation is needed.
        clips: folder of the clip set to which the film is added; begun where there is none.
        tolerance: of each ball's place [m].
        say: called with what is being done.

    Raises:
        BadInput: for plan, limits, scene or a clip set of another table, before anything moves; or not confirmed.
        NotStruck: the launcher is certain that it made no stroke.
        StrokeUnknown: it may have been made; the played file says so.
        LauncherError: the stroke was not reached.
    """
    order = read_order(plan, launcher.settings)
    if camera is not None:
        _check_camera(order, camera, plan, tolerance)
    log = _clips_so_far(clips, camera)
    if not launcher.dry_run and not os.access(Path(plan).resolve().parent, os.W_OK):
        raise BadInput(f"{played_file(plan)}: cannot be written; choose a folder that can")
    for note in order.notes:
        say(note)
    make_ready(launcher, say)
    placed = launcher.move_tip(order.x0_mm, order.y0_mm)
    what = f"yaw {order.yaw_deg:.2f} degrees, tip at {placed.x0_mm:+.2f}, {placed.y0_mm:+.2f} mm, string {order.string}"
    if confirm is not None and not launcher.dry_run and not confirm(what):
        raise BadInput(f"not confirmed ({what}); nothing was struck, say yes to strike")
    if camera is not None and not launcher.dry_run:
        camera.arm()
    when = datetime.now(UTC).isoformat(timespec="milliseconds")
    try:
        done = launcher.strike(order.string)
    except StrokeUnknown as error:
        played = _record(order, None, when, camera, clips, log, (*order.notes, str(error)))
        _kept(plan, order, played, clips)
        raise
    noted = (*order.notes, *done.noted)
    try:
        launcher.retract()
    except LauncherError as error:  # the stroke has been made, and its result counts
        noted = (*noted, f"the cue is not back: {error}")
    if launcher.dry_run:
        return Played("dry", done, when, None, None, None, None, None, None, None, noted)
    return _kept(plan, order, _record(order, done, when, camera, clips, log, noted), clips)


def _check_camera(order: Order, camera: ShotCamera, plan: Path | str, tolerance: float) -> None:
    """BadInput where the camera sees another table than the plan's, or its balls elsewhere."""
    if (camera.table, camera.ball) != (order.scene.table, order.scene.ball):
        raise BadInput(
            f"{plan}: is for {order.scene.table}, {order.scene.ball}; the camera sees {camera.table}, {camera.ball}"
        )
    check_scene(order.scene, camera.look(), plan, tolerance)


def make_ready(launcher: Launcher, say: Callable[[str], None]) -> None:
    """Home or retract where that is enough; a stopped launcher is not reset here."""
    state = launcher.status().status.state
    if state == "UNHOMED":
        say("homing")
        launcher.home()
    elif state == "EXTENDED":
        launcher.retract()
    elif state != "IDLE":
        raise LauncherError(f"the launcher is {state}; find out why, then: robot reset --port P")


def _clips_so_far(folder: Path | str | None, camera: ShotCamera | None) -> ClipSet | None:
    """The clip set that the film will be added to; BadInput where it is of another table or camera."""
    if folder is None or camera is None:
        return None
    new = ClipSet(camera.table, camera.ball, camera.fps, (), camera.sigma, Path(folder))
    new = with_doubts(new, camera.doubts)
    if not Path(folder).exists() or (Path(folder).is_dir() and not any(Path(folder).iterdir())):
        return new
    old = read_clip_set(folder)
    for name in ("table", "ball", "fps", "sigma"):
        if getattr(old, name) != getattr(new, name):
            raise BadInput(
                f"{folder}: its {name} is {getattr(old, name)}, this camera's {getattr(new, name)}; "
                "name another folder for the clips"
            )
    return with_doubts(old, camera.doubts)


def add_clip(
    clip_set: ClipSet, balls: Mapping[str, Observation], struck: str, cue: CueCommand, note: str,
    filmed: FilmedFrames | None = None,
) -> ClipSet:  # fmt: skip
    """The clip set with one more clip, under the next free number, and where its film is."""
    taken, k = {clip.file for clip in clip_set.clips}, len(clip_set.clips) + 1
    while f"clips/{k:04d}.csv" in taken:
        k += 1
    extra, known = dict[str, Any](), clip_set.extra
    if filmed is not None:
        from sysid.vision import film_entries

        extra, known = film_entries(clip_set, filmed.video, (filmed.first, filmed.last))
    clip = Clip(f"clips/{k:04d}.csv", struck, dict(balls), cue, note, extra)
    return dataclasses.replace(clip_set, clips=(*clip_set.clips, clip), extra=known)


def _record(
    order: Order, done: Done | None, when: str, camera: ShotCamera | None, clips: Path | str | None,
    log: ClipSet | None, noted: tuple[str, ...],
) -> Played:  # fmt: skip
    """What was seen, with the film written to the clip set."""
    struck, film = "yes" if done else "unknown", camera.film() if camera is not None else {}
    cue, target, goal = *order.scene.names[:2], order.scene.goal
    clip = None
    if log is not None and clips is not None and film:
        try:
            log = add_clip(log, film, cue, order.cue, f"played {when}", camera.filmed if camera else None)
            write_clip_set(log, clips)
            clip = log.clips[-1].file
        except BadInput as error:  # the stroke has been made, its record must not be lost with the film
            noted = (*noted, f"the film is lost: {error}")
    if cue not in film or target not in film:
        return Played(struck, done, when, clip, None, None, None, None, None, None, noted)
    end = max(float(ball.time[-1]) for ball in film.values())
    (cue_end, cue_pocket), (object_end, pocket) = (
        _ended(film[name], order.scene, end - 1.5 / camera.fps if camera else end) for name in (cue, target)
    )
    from_wanted = None
    if goal.rest is not None and cue_end is not None:
        from_wanted = max(float(np.hypot(*(np.array(cue_end) - goal.rest))) - goal.rest_radius, 0.0)
    fell = None if cue_end is None and cue_pocket is None else cue_pocket is not None
    counts = None if object_end is None and pocket is None else pocket is not None and goal.pocket in (None, pocket)
    name = None if pocket is None else pocket_name(pocket)
    return Played(struck, done, when, clip, cue_end, object_end, fell, counts, name, from_wanted, noted)


def _ended(seen: Observation, scene: Scene, until: float) -> tuple[tuple[float, float] | None, Pocket | None]:
    """Where a ball ended [m], or the pocket that took it; neither where it was lost from view elsewhere."""
    if seen.time[-1] >= until:
        x, y = np.median(seen.xy[-5:], axis=0)
        return (float(x), float(y)), None
    return None, pocket_near(seen.xy[-1], scene.table)


def pocket_near(xy: Array, table: Table) -> Pocket | None:
    """The pocket that took a ball last seen at (2,) [m]; None where no pocket is near, or the table has none."""
    if not table.pockets:
        return None
    places = pocket_places(table)
    distances = [float(np.hypot(*(xy - places[p]))) for p in POCKETS]
    k = int(np.argmin(distances))
    return POCKETS[k] if distances[k] <= POCKETED_DISTANCE_M else None


def _kept(plan: Path | str, order: Order, played: Played, clips: Path | str | None) -> Played:
    """What was played, written to the played file, whole; noted where it cannot be, since the stroke has been made."""
    result = dataclasses.asdict(played)
    clip = None if played.clip is None else {"folder": str(clips), "file": played.clip}
    head = {"format": PLAYED_FORMAT, "plan": Path(plan).name, "stroke": dataclasses.asdict(order.cue)}
    asked = {"string": order.string, "x0_mm": order.x0_mm, "y0_mm": order.y0_mm, "theta_deg": order.yaw_deg}
    balls = {"cue_ball": order.scene.names[0], "object_ball": order.scene.names[1]}
    try:
        write_json(str(played_file(plan)), head | balls | {"asked": asked} | result | {"clip": clip})
    except BadInput as error:
        return dataclasses.replace(played, noted=(*played.noted, f"the record is lost: {error}"))
    return played
