"""Scenes from a camera: the balls of a photo, of a video's last frame, or of a clip's end.

In: pictures with their camera file, or a clip set; a goal. Out: a scene, and the balls found with notes on what was
assumed, left out or is in doubt.

Balls are detected as in tracking (sysid/vision/balls/detect.py); the last frame decides which there are, and positions
are averaged over the frames that show a ball at rest. Balls of one colour are numbered from left to right in the
picture. Small overlaps of balls with each other or a cushion are removed. Leaves out balls in the middle of a pack,
which have no outline against the cloth: a note says where something was not recognised.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import BadInput
from models.files.faults import closest, listed
from models.shot import Array, Ball, Table
from planner.scene import FORMAT, Scene, largest_overlap, pocket_name, pocket_of, scene_from, separate_overlaps
from sysid.clips import read_clip_set
from sysid.clips.choose import chosen_clip
from sysid.clips.plausibility import MAX_OVERLAP_M, POCKET_REACH, START_FRAMES
from sysid.clips.trust import camera_doubts

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection, Detector
    from sysid.vision.camera.projection import Camera
    from sysid.vision.frames import Picture

CUE_BALL_NAMES = ("white", "cue")  # usual names of the cue ball
LAST_FRAMES = 8  # frames, or samples of a clip, over which a ball at rest is averaged
MAX_REST_SHIFT_RADII = 0.05  # of a ball at rest, from the first half of these frames to the second
SAME_BALL_RADII = 1.0  # distance within which detections of one name in different frames are the same ball
OFF_TABLE_RADII = 0.5  # beyond the line of contact with a cushion, from which on a ball is not on the table
# Something on the cloth that is not cloth:
MIN_COLOUR_DIFFERENCE = 0.25  # from the cloth's colour at the best brightness, over the cloth's brightest channel
BRIGHTNESS_RANGE = (0.35, 1.8)  # of cloth in shade or light, over the median
BALL_MASK_RADII = 1.3  # around a detected ball that are not examined
MIN_AREA_BALLS = 0.4  # of what is reported, in areas of a ball


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
            remedy = f"did you mean {near!r}?" if near else "name one of them"
            text = f"{where}: {key} {name!r} was not found, only {listed(balls)}: {remedy}"
            raise BadInput(text)
    doubts = {"camera_doubts": found.camera_doubts}
    return scene_from({"format": FORMAT, **doubts, **sizes, "balls": balls, "goal": wanted}, where)


def balls_in_picture(
    path: Path | str, camera_path: Path | str, *, palette_path: Path | str | None = None, mass: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> DetectedBalls:  # fmt: skip
    """The balls of a photo, or of the last frame; arguments as for `scene_from_picture`."""
    from models.presets import usual_mass
    from sysid.vision.balls.discs import Expected
    from sysid.vision.balls.learning import learn_detector
    from sysid.vision.balls.palette import palette_for
    from sysid.vision.camera.projection import ball_of, read_camera
    from sysid.vision.frames import open_footage

    camera = read_camera(camera_path)
    palette = palette_for(palette_path, camera.table, camera.diameter)
    footage = open_footage(path, 1.0)  # the times of pictures are not used
    if footage.size != tuple(camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, camera.size))
        raise BadInput(f"{path}: {sizes} pixels in it and in {camera_path}; calibrate with pictures of this size")
    detector = learn_detector(camera, footage, palette, progress)
    camera = detector.camera
    progress("finding the balls in the last frame")
    pictures = deque((frame.picture for frame in footage), maxlen=LAST_FRAMES)
    notes = list(detector.notes)
    detections = detector.named(pictures[-1], detector.find(pictures[-1]))
    notes += _unrecognised(detector, camera, pictures[-1], detections)
    balls = _numbered(detections, palette.known, notes)
    if not balls:
        raise BadInput(
            f"{path}: no ball is seen in the last frame; is {camera_path} its camera, and are its balls lit?"
        )
    pixels = {name: [one.xy] for name, one in balls.items()}  # the last frame first
    expected = [Expected(one.name, one.xy) for one in balls.values()]
    for picture in list(pictures)[-2::-1]:
        before = detector.find(picture, expected)
        for name, one in balls.items():
            pairs = [(np.hypot(*(s.xy - one.xy)) / one.radius, s.xy) for s in before if s.name == one.name]
            pixels[name] += [xy for d, xy in sorted(pairs, key=lambda pair: pair[0])[:1] if d < SAME_BALL_RADII]
    places = {name: camera.centres(np.array(recent[::-1])) for name, recent in pixels.items()}
    if mass is None:
        mass, game = usual_mass(camera.diameter)
        notes.append(f"mass {mass:.4f} kg, that of a {game} ball of this size")
    found = _balls_on_table((camera.table, ball_of(camera, mass)), places, 0.0, notes, str(path))
    return replace(found, camera_doubts=camera.doubts, cue_doubts=_cue_doubts(balls, found))


def _cue_doubts(balls: Mapping[str, Detection], found: DetectedBalls) -> tuple[str, ...]:
    """Which balls may be the cue ball, or another one, by what they look like."""
    from sysid.vision.balls.names import SURE

    doubts = []
    for name, xy in zip(found.names, found.position, strict=True):
        one, cue = balls[name], set(CUE_BALL_NAMES)
        if one.odds < SURE and {one.name, one.other} & cue:
            at = f"{xy[0]:.2f}, {xy[1]:.2f} m"
            doubts.append(f"{name} at {at} may be {one.other} ({100 * (1 - one.odds):.0f} %)")
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


def _numbered(detections: Sequence[Detection], counts: Mapping[str, int], notes: list[str]) -> dict[str, Detection]:
    """Detections, given the most certain first, by unique names: red, red 2, red 3 from left to right."""
    named: dict[str, Detection] = {}
    for colour in sorted({one.name for one in detections}, key=list(counts).index):
        same = [one for one in detections if one.name == colour]
        if len(same) > (count := counts[colour]):
            notes.append(f"{len(same)} balls look {colour}, and the palette has {count}: the most certain are used")
        number = 1
        for one in sorted(same[:count], key=lambda s: float(s.xy[0])):
            name = colour if number == 1 else f"{colour} {number}"
            while name in named or (number > 1 and name in counts):
                number += 1
                name = f"{colour} {number}"
            named[name] = one
            number += 1
    return named


def _unrecognised(detector: Detector, camera: Camera, picture: Picture, detections: Sequence[Detection]) -> list[str]:
    """Notes on what lies on the cloth, does not have its colour at any brightness, and is no detected ball."""
    import cv2

    bed = detector.background.geometry.bed
    cloth = np.median(picture[bed], axis=0)
    brightness = (picture @ cloth / (cloth @ cloth)).clip(*BRIGHTNESS_RANGE)
    difference = np.abs(picture - brightness[..., None] * cloth).max(axis=2)
    mask = (bed & (difference > MIN_COLOUR_DIFFERENCE * cloth.max())).astype(np.uint8)
    for one in detections:
        centre = round(float(one.xy[0])), round(float(one.xy[1]))
        cv2.circle(mask, centre, round(BALL_MASK_RADII * one.radius), 0, -1)
    mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
    _, _, stats, centroids = cv2.connectedComponentsWithStats(mask)
    notes = []
    for centroid, area in zip(centroids[1:], stats[1:, cv2.CC_STAT_AREA], strict=True):
        size = area / (np.pi * detector.background.geometry.radius(centroid) ** 2)
        if size > MIN_AREA_BALLS:
            count = "a ball" if size < 1.5 else f"{size:.0f} balls"
            x, y = camera.on_plane(centroid[None], camera.radius)[0]
            notes.append(f"something of the size of {count} at {x:.2f}, {y:.2f} m was not made out: add it by hand")
    return notes


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
        text = f"{names[i]} and {names[j]} are seen {1e3 * depth:.1f} mm within each other"
        raise BadInput(f"{where}: {text}: check calibration and ball diameter")
    return DetectedBalls(table, ball, names, separate_overlaps(position, table, ball), tuple(notes))
