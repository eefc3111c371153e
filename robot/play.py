"""Play a plan once: checks, stroke, film, and the record of the result.

In: a plan file, a launcher, a camera. Out: PLAN.played.json next to the plan, and the filmed shot in a clip set.

Nothing moves until plan, limits, scene and output files are checked. Then: home or retract the launcher if necessary,
position the tip, ask the operator for confirmation, strike once, retract the cue, add the filmed shot to a clip set.
One call strikes at most once. If the line failed after the stroke's command, the record says "unknown" and holds what
was seen, nothing else moves, and StrokeUnknown is raised to the caller.

The record is that of the last play of a plan; clips of all plays are kept. Left out: turning the stand, which is done
by hand, and a plan whose balls have other names than the camera's.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from models.commands.console import write_json
from models.errors import BadInput
from models.shot import Array, Ball, Table
from planner.scene import POCKETS, Pocket, Scene, pocket_name, pocket_places
from robot.device.launcher import Launcher
from robot.device.outcome import Done, StrokeUnknown
from robot.device.protocol import LauncherError
from robot.order import PLACE_TOLERANCE_M, Order, check_scene, read_order
from sysid.clips import Clip, ClipSet, CueCommand, Observation, read_clip_set, write_clip_set
from sysid.clips.trust import with_doubts

PLAYED_FORMAT = "billiard-played/1"
POCKETED_DISTANCE_M = 0.15  # a ball that disappears within this distance of a pocket was pocketed


@dataclass(frozen=True)
class FilmedFrames:
    """The frames of a video that show a clip, counted from 0."""

    video: Path
    first: int  # frame of the clip's first sample
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
    def sigma(self) -> float: ...  # noise of a position, each axis [m]
    @property
    def doubts(self) -> tuple[str, ...]: ...  # reasons to doubt its calibration
    @property
    def filmed(self) -> FilmedFrames | None: ...  # of the last film; None without a video

    def look(self) -> Mapping[str, Array]:
        """Observed positions of the resting balls by name: (2,) [m]."""
        ...

    def arm(self) -> None:
        """Start filming, just before a stroke."""
        ...

    def film(self) -> Mapping[str, Observation]:
        """The balls' tracks since the last film ended, t = 0 at the hit; empty if nothing was filmed."""
        ...


@dataclass(frozen=True)
class Played:
    """The result of playing a plan."""

    struck: str  # "yes", "unknown", or "dry"
    done: Done | None  # None if the stroke is unknown
    when: str  # UTC, ISO 8601
    clip: str | None  # the file within the clip set
    cue_end: tuple[float, float] | None  # resting place of the cue ball [m]; None if it fell or was not seen
    object_end: tuple[float, float] | None
    cue_fell: bool | None  # None if its end was not seen
    potted: bool | None  # whether the object ball fell into a pocket that counts
    pocket: str | None  # the pocket into which it fell
    from_wanted: float | None  # distance of the cue ball from its wanted place [m]; None without one, or if it fell
    noted: tuple[str, ...]  # unusual events


def played_file(plan: Path | str) -> Path:
    """The file of a plan's record, next to the plan."""
    return Path(plan).with_suffix(".played.json")


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
        plan: its file; PLAN.played.json is written next to it, except in a dry run.
        launcher: connected, or for a dry run; its settings hold the limits.
        camera: over the table; None to play without a check of the scene and without a film.
        confirm: called before the stroke with a description of it; None if no confirmation is needed.
        clips: folder of the clip set to which the filmed shot is added; created if necessary.
        tolerance: of each ball's position [m].
        say: called with a description of the current step.

    Raises:
        BadInput: for plan, limits, scene or a clip set of another table, before anything moves; or not confirmed.
        NotStruck: the launcher certainly made no stroke.
        StrokeUnknown: the stroke may have been made; the played file states this.
        LauncherError: a fault before the stroke.
    """
    order = read_order(plan, launcher.settings)
    if camera is not None:
        _check_camera(order, camera, plan, tolerance)
    log = _clips_so_far(clips, camera)
    if not launcher.dry_run and not os.access(Path(plan).resolve().parent, os.W_OK):
        raise BadInput(f"{played_file(plan)}: cannot be written; choose a writable folder")
    for note in order.notes:
        say(note)
    make_ready(launcher, say)
    placed = launcher.move_tip(order.x0_mm, order.y0_mm)
    what = f"yaw {order.yaw_deg:.2f} degrees, tip at {placed.x0_mm:+.2f}, {placed.y0_mm:+.2f} mm, string {order.string}"
    if confirm is not None and not launcher.dry_run and not confirm(what):
        raise BadInput(f"not confirmed ({what}), so nothing was struck; answer yes to strike")
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
    except LauncherError as error:  # the stroke was made, and its result counts
        noted = (*noted, f"the cue is not back: {error}")
    if launcher.dry_run:
        return Played("dry", done, when, None, None, None, None, None, None, None, noted)
    return _kept(plan, order, _record(order, done, when, camera, clips, log, noted), clips)


def _check_camera(order: Order, camera: ShotCamera, plan: Path | str, tolerance: float) -> None:
    """Raise BadInput if the camera sees another table than the plan's, or balls in other positions."""
    if (camera.table, camera.ball) != (order.scene.table, order.scene.ball):
        raise BadInput(
            f"{plan}: is for {order.scene.table}, {order.scene.ball}; the camera sees {camera.table}, {camera.ball}"
        )
    check_scene(order.scene, camera.look(), plan, tolerance)


def make_ready(launcher: Launcher, say: Callable[[str], None]) -> None:
    """Home or retract the launcher if that suffices; a stopped launcher is not reset here."""
    state = launcher.status().status.state
    if state == "UNHOMED":
        say("homing")
        launcher.home()
    elif state == "EXTENDED":
        launcher.retract()
    elif state != "IDLE":
        raise LauncherError(f"the launcher is {state}; find the cause, then run: robot reset --port P")


def _clips_so_far(folder: Path | str | None, camera: ShotCamera | None) -> ClipSet | None:
    """The clip set for the filmed shot; BadInput if it is of another table or camera."""
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
                f"{folder}: its {name} is {getattr(old, name)}, but this camera's is {getattr(new, name)}; "
                "name another folder for the clips"
            )
    return with_doubts(old, camera.doubts)


def add_clip(
    clip_set: ClipSet, balls: Mapping[str, Observation], struck: str, cue: CueCommand, note: str,
    filmed: FilmedFrames | None = None,
) -> ClipSet:  # fmt: skip
    """The clip set with one more clip, under the next free number, with a reference to its film."""
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
    """The observed result, after adding the filmed shot to the clip set."""
    struck, film = "yes" if done else "unknown", camera.film() if camera is not None else {}
    cue, target, goal = *order.scene.names[:2], order.scene.goal
    clip = None
    if log is not None and clips is not None and film:
        try:
            log = add_clip(log, film, cue, order.cue, f"played {when}", camera.filmed if camera else None)
            write_clip_set(log, clips)
            clip = log.clips[-1].file
        except BadInput as error:  # the stroke was made, and its record must not be lost with the film
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
    """Resting place of a ball [m], or the pocket into which it fell; neither if it was lost from view elsewhere."""
    if seen.time[-1] >= until:
        x, y = np.median(seen.xy[-5:], axis=0)
        return (float(x), float(y)), None
    return None, pocket_near(seen.xy[-1], scene.table)


def pocket_near(xy: Array, table: Table) -> Pocket | None:
    """The pocket of a ball last seen at (2,) [m]; None if no pocket is near, or the table has none."""
    if not table.pockets:
        return None
    places = pocket_places(table)
    distances = [float(np.hypot(*(xy - places[p]))) for p in POCKETS]
    k = int(np.argmin(distances))
    return POCKETS[k] if distances[k] <= POCKETED_DISTANCE_M else None


def _kept(plan: Path | str, order: Order, played: Played, clips: Path | str | None) -> Played:
    """Write the result to the played file; a failure is only noted, since the stroke was made."""
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
