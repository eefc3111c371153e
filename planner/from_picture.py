"""Scenes from a camera: the balls of a photo, of a video's last frame, or of a clip's end.

In: pictures with their camera file, or a clip set; a goal. Out: a scene, and the balls found with notes on what was
assumed, left out or is in doubt.

Balls are found by `sysid.vision.find_balls`; positions are averaged over the frames that show a ball at rest. Small
overlaps of balls with each other or a cushion are removed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import BadInput
from models.files.faults import closest, listed
from models.shot import Array, Ball, Table, largest_overlap
from planner.scene import SCENE_FORMAT, Scene, pocket_name, pocket_of, scene_from, separate_overlaps
from sysid.clips import read_clip_set
from sysid.clips.choose import chosen_clip
from sysid.clips.plausibility import MAX_OVERLAP_M, POCKET_REACH, START_FRAMES
from sysid.clips.trust import camera_doubts

if TYPE_CHECKING:
    from sysid.vision import StillBall

CUE_BALL_NAMES = ("white", "cue")  # usual names of the cue ball
LAST_FRAMES = 8  # frames, or samples of a clip, over which a ball at rest is averaged
MAX_REST_SHIFT_RADII = 0.05  # of a ball at rest, from the first half of these frames to the second
OFF_TABLE_RADII = 0.5  # beyond the line of contact with a cushion, from which on a ball is not on the table


@dataclass(frozen=True)
class DetectedBalls:
    """Balls at the end of a recording."""

    table: Table
    ball: Ball
    names: tuple[str, ...]
    position: Array  # (n, 2) [m]
    notes: tuple[str, ...]  # what was assumed, left out or is in doubt, in plain words
    camera_doubts: tuple[str, ...] = ()  # why the camera that saw them is not to be trusted
    cue_doubts: tuple[str, ...] = ()  # which balls may be the cue ball, where that is not sure


def scene_from_picture(
    path: Path | str, camera_path: Path | str, goal: Mapping[str, Any], *, palette_path: Path | str | None = None,
    mass: float | None = None, progress: Callable[[str], None] = lambda line: None,
) -> tuple[Scene, DetectedBalls]:  # fmt: skip
    """The scene of a photo, or of the last frame of a video or of a row of pictures, and the balls found.

    Args:
        path: photo, video, or folder of pictures.
        camera_path: camera file for pictures of this size.
        goal: as [goal] of a scene file; keys with value None are ignored, and `cue` may be missing.
        palette_path: names and colours of the balls; those of snooker if None.
        mass: of a ball [kg]; that of a snooker ball of its size if None.
        progress: receives messages about the progress.
    """
    found = balls_in_picture(path, camera_path, palette_path=palette_path, mass=mass, progress=progress)
    return scene_of(found, goal, str(path)), found


def scene_from_clips(
    folder: Path | str, goal: Mapping[str, Any], clip: str | int | None = None
) -> tuple[Scene, DetectedBalls]:  # fmt: skip
    """The scene that a clip of a clip set ends with, and the balls found.

    Args:
        folder: the clip set.
        goal: as [goal] of a scene file; keys with value None are ignored, and `cue` may be missing.
        clip: its file, or its number from 1; the last one if None.
    """
    found = balls_in_clip(folder, clip)
    return scene_of(found, goal, str(folder)), found


def scene_of(found: DetectedBalls, goal: Mapping[str, Any], where: str) -> Scene:
    """The scene of detected balls with a goal; `where` is what messages name as the source."""
    wanted = {key: value for key, value in goal.items() if value is not None}
    if "cue" not in wanted:
        cue = next((name for name in CUE_BALL_NAMES if name in found.names), None)
        if cue is None:
            raise BadInput(f"{where}: no white ball among {listed(found.names)}: name the cue ball")
        if found.cue_doubts:
            raise BadInput(f"{where}: {'; '.join(found.cue_doubts)}: look, and name the cue ball with --cue")
        wanted["cue"] = cue
    sizes = {
        "table": {"length": found.table.length, "width": found.table.width, "pockets": found.table.pockets},
        "ball": {"diameter": found.ball.diameter, "mass": found.ball.mass},
    }
    balls = dict(zip(found.names, found.position.tolist(), strict=True))
    for key in ("cue", "object", "rest_for"):
        name = wanted.get(key)
        if isinstance(name, str) and name not in balls:
            near = closest(name, balls)
            remedy = f"did you mean {near!r}?" if near else f"name one of those found: {listed(balls)}"
            text = f"{where}: {key} {name!r} was not found; {remedy}"
            raise BadInput(text)
    doubts = {"camera_doubts": found.camera_doubts}
    return scene_from({"format": SCENE_FORMAT, **doubts, **sizes, "balls": balls, "goal": wanted}, where)


def balls_in_picture(
    path: Path | str, camera_path: Path | str, *, palette_path: Path | str | None = None, mass: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> DetectedBalls:  # fmt: skip
    """The balls of a photo, or of the last frame; arguments as for `scene_from_picture`."""
    from models.table.presets import usual_mass
    from sysid.vision import ball_of, find_balls, read_camera

    camera = read_camera(camera_path)
    balls, notes = find_balls(path, camera, palette_path=palette_path, camera_name=camera_path, progress=progress)
    if mass is None:
        mass, game = usual_mass(camera.diameter)
        notes.append(f"mass {mass:.4f} kg assumed, as of a {game} ball of this size")
    places = {name: ball.xy for name, ball in balls.items()}
    found = _balls_on_table((camera.table, ball_of(camera, mass)), places, 0.0, notes, str(path))
    return replace(found, camera_doubts=camera.doubts, cue_doubts=_cue_doubts(balls, found))


def _cue_doubts(balls: Mapping[str, StillBall], found: DetectedBalls) -> tuple[str, ...]:
    """Which balls may be the cue ball, or another one, by what they look like."""
    doubts = []
    for name, xy in zip(found.names, found.position, strict=True):
        one = balls[name]
        if one.other and {one.colour, one.other} & set(CUE_BALL_NAMES):
            at = f"{xy[0]:.2f}, {xy[1]:.2f} m"
            doubts.append(f"{name} at {at} may be {one.other} ({100 * one.other_odds:.0f} %)")
    return tuple(doubts)


def balls_in_clip(folder: Path | str, clip: str | int | None = None) -> DetectedBalls:
    """The balls that are on the table at the end of a clip; arguments as for `scene_from_clips`."""
    clip_set = read_clip_set(folder)
    chosen = chosen_clip(clip_set, clip, folder)
    end = max(float(seen.time[-1]) for seen in chosen.balls.values() if len(seen.time))
    notes: list[str] = []
    places = {}
    for name, seen in chosen.balls.items():
        if not len(seen.time):
            continue
        early = end - float(seen.time[-1])
        if early > START_FRAMES / clip_set.fps:
            if clip_set.table.to_pocket(seen.xy[-1]) <= POCKET_REACH * clip_set.ball.diameter:
                notes.append(f"{name} was last seen at a pocket, {early:.2f} s before the end: potted")
                continue
            notes.append(f"{name} was last seen {early:.2f} s before the end: assumed to lie there")
        places[name] = seen.xy[-LAST_FRAMES:]
    sizes = clip_set.table, clip_set.ball
    found = _balls_on_table(sizes, places, clip_set.sigma or 0.0, notes, f"{folder}: {chosen.file}")
    return replace(found, camera_doubts=camera_doubts(clip_set))


def _rest_position(recent: Array, max_shift: float) -> tuple[Array, float]:
    """Position (2,) [m] of a ball at rest from its last ones (k, 2), and 0; else its last one, and its shift [m]."""
    shift = _shift(recent)
    if shift < max_shift:
        return np.asarray(np.median(recent, axis=0)), 0.0
    late = recent[len(recent) // 2 :]  # it may have come to rest within these
    if len(late) > 1 and _shift(late) < max_shift / 2:
        return np.asarray(np.median(late, axis=0)), 0.0
    return recent[-1], shift


def _shift(recent: Array) -> float:
    """Distance between the means of the first and the second half of positions (k, 2): [m]."""
    half = len(recent) // 2
    return float(np.hypot(*(recent[half:].mean(axis=0) - recent[:half].mean(axis=0)))) if half else 0.0


def _balls_on_table(
    sizes: tuple[Table, Ball], recent: Mapping[str, Array], sigma: float, notes: list[str], where: str
) -> DetectedBalls:
    """The balls that a scene can have.

    Args:
        sizes: table and ball.
        recent: last positions of each ball (k, 2) [m].
        sigma: standard deviation of a position [m].
        notes: extended by what is left out or in doubt.
        where: what messages name as the source.
    """
    (table, ball), on_table = sizes, dict[str, Array]()
    for name, positions in recent.items():
        xy, shift = _rest_position(positions, max(MAX_REST_SHIFT_RADII * ball.radius, 2 * sigma))
        if shift > 0:
            notes.append(f"{name} still moves at the end, by {1e3 * shift:.1f} mm: its last position is used")
        if (pocket := pocket_of(xy, table, ball)) is not None:
            notes.append(f"{name} lies in the pocket {pocket_name(pocket)}: left out")
        elif (np.abs(xy) > table.centre_limits(ball) + OFF_TABLE_RADII * ball.radius).any():
            notes.append(f"{name} lies off the table, at {xy[0]:.3f}, {xy[1]:.3f} m: left out")
        else:
            on_table[name] = xy.round(6)
    if not on_table:
        raise BadInput(f"{where}: no ball is left on the table at the end")
    names, position = tuple(on_table), np.array(list(on_table.values()))
    depth, i, j = largest_overlap(position, ball)
    if depth > max(MAX_OVERLAP_M, 6 * sigma):
        text = f"{names[i]} and {names[j]} overlap by {1e3 * depth:.1f} mm"
        raise BadInput(f"{where}: {text}: check calibration and ball diameter")
    return DetectedBalls(table, ball, names, separate_overlaps(position, table, ball), tuple(notes))
