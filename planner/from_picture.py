"""Scenes from what a camera saw: the balls of a photo, of a video's last frame, or of a clip's end.

Balls are found as tracking finds them (sysid/vision/balls/detect.py) and where several frames show them at rest their
places are averaged; the last frame decides which there are. Balls of one colour are numbered from left to right in the
picture. What a camera sees a little inside another ball or a cushion is moved apart. Leaves out balls in the middle of
a pack, which have no outline against the cloth: what lies there and was not made out is told.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import BadInput
from models.shot import Array, Ball, Table
from planner.scene import FORMAT, Scene, overlap, pocket_name, pocket_of, scene_from, settled
from sysid.clips import Clip, read_clip_set
from sysid.clips.faults import closest, listed, one_line
from sysid.clips.plausibility import OVERLAP, POCKET_REACH, START_FRAMES

if TYPE_CHECKING:
    from sysid.vision.balls.detect import Detection, Detector
    from sysid.vision.camera.projection import Camera
    from sysid.vision.frames import Picture

CUES = ("white", "cue")  # what the cue ball is usually called
LAST = 8  # frames, or samples of a clip, that show a ball at rest
STILL = 0.05  # radii that its place may change from their first half to the second
NEAR = 1.0  # radii within which sightings of one name in neighbouring frames are the same ball
BEYOND = 0.5  # radii beyond the touch of a cushion from which on a ball is not on the table
# What is not cloth: by how much of its brightness it is off, at any light within these parts of the usual one, how far
# from the middle of a ball [radii], and how much of a ball's area.
OFF, LIT, AROUND, PART = 0.25, (0.35, 1.8), 1.3, 0.4


@dataclass(frozen=True)
class Found:
    """Balls at the end of what was filmed."""

    table: Table
    ball: Ball
    names: tuple[str, ...]
    position: Array  # (n, 2) [m]
    told: tuple[str, ...]  # what was assumed, left out or is in doubt, in plain words


def scene_from_picture(
    path: Path | str, camera_path: Path | str, goal: Mapping[str, Any], *, palette_path: Path | str | None = None,
    mass: float | None = None, progress: Callable[[str], None] = lambda line: None,
) -> tuple[Scene, Found]:  # fmt: skip
    """The scene of a photo, or of the last frame of a video or of a row of pictures, and what was found there.

    Args:
        path: what to look at.
        camera_path: camera file, of pictures of that size.
        goal: as [goal] of a scene file; what is None is left out, and `cue` may be.
        palette_path: names and colours of the balls; those of snooker without.
        mass: of a ball [kg]; that of a snooker ball of its size without.
        progress: is told what is going on.
    """
    found = balls_in_picture(path, camera_path, palette_path=palette_path, mass=mass, progress=progress)
    return scene_of(found, goal, str(path)), found


def scene_from_clips(
    folder: Path | str, goal: Mapping[str, Any], clip: str | int | None = None
) -> tuple[Scene, Found]:  # fmt: skip
    """The scene that a clip of a clip set ends with, and what was found there.

    Args:
        folder: the clip set.
        goal: as [goal] of a scene file; what is None is left out, and `cue` may be.
        clip: its file, or its number from 1; the last one without.
    """
    found = balls_in_clip(folder, clip)
    return scene_of(found, goal, str(folder)), found


def scene_of(found: Found, goal: Mapping[str, Any], where: str) -> Scene:
    """The scene of balls that were found, with a goal; `where` is what messages name as the place they come from."""
    wanted = {key: value for key, value in goal.items() if value is not None}
    if "cue" not in wanted:
        cue = next((name for name in CUES if name in found.names), None)
        if cue is None:
            raise BadInput(one_line(f"{where}: no white ball among {listed(found.names)}: name the cue ball"))
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
            text = f"{where}: {key} {name!r} is not to be seen, only {listed(balls)}: {remedy}"
            raise BadInput(one_line(text))
    return scene_from({"format": FORMAT, **sizes, "balls": balls, "goal": wanted}, where)


def balls_in_picture(
    path: Path | str, camera_path: Path | str, *, palette_path: Path | str | None = None, mass: float | None = None,
    progress: Callable[[str], None] = lambda line: None,
) -> Found:  # fmt: skip
    """The balls of a photo, or of the last frame of a video or of a row of pictures; arguments as above."""
    from sysid.cli.track import USUAL
    from sysid.vision.balls.detect import Detector
    from sysid.vision.balls.palette import default_palette, read_palette
    from sysid.vision.camera.projection import ball_of, read_camera
    from sysid.vision.frames import open_footage

    camera = read_camera(camera_path)
    palette = read_palette(palette_path) if palette_path else default_palette()
    footage = open_footage(path, 1.0)  # when pictures were taken matters to nothing here
    if footage.size != tuple(camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, camera.size))
        raise BadInput(f"{path}: {sizes} pixels in it and in {camera_path}; calibrate with pictures of this size")
    detector = Detector.learn(camera, footage, palette, progress)
    progress("looking at the last frame")
    pictures = deque((frame.picture for frame in footage), maxlen=LAST)
    told = list(detector.notes)
    all_seen = detector.find(pictures[-1])
    told += _not_known(detector, camera, pictures[-1], all_seen)
    seen = _numbered(all_seen, dict(zip(palette.names, palette.counts, strict=True)), told)
    if not seen:
        raise BadInput(
            f"{path}: no ball is seen in the last frame; is {camera_path} its camera, and are its balls lit?"
        )
    pixels = {name: [one.xy] for name, one in seen.items()}  # the last one first
    expected = [(one.name, one.xy) for one in seen.values()]
    for picture in list(pictures)[-2::-1]:
        before = detector.find(picture, expected)
        for name, one in seen.items():
            far = [(np.hypot(*(s.xy - one.xy)) / one.radius, s.xy) for s in before if s.name == one.name]
            pixels[name] += [xy for off, xy in sorted(far, key=lambda pair: pair[0])[:1] if off < NEAR]
    places = {name: camera.centres(np.array(recent[::-1])) for name, recent in pixels.items()}
    if mass is None:
        mass = USUAL * camera.diameter**3
        told.append(f"mass {mass:.4f} kg, that of a snooker ball of this size")
    return _laid(camera.table, ball_of(camera, mass), places, 0.0, told, str(path))


def balls_in_clip(folder: Path | str, clip: str | int | None = None) -> Found:
    """The balls that are on the table at the end of a clip; arguments as above."""
    clip_set = read_clip_set(folder)
    chosen = _chosen(clip_set.clips, clip, folder)
    end = max(float(seen.time[-1]) for seen in chosen.balls.values() if len(seen.time))
    told: list[str] = []
    places = {}
    for name, seen in chosen.balls.items():
        if not len(seen.time):
            continue
        early = end - float(seen.time[-1])
        if early > START_FRAMES / clip_set.fps:
            if clip_set.table.to_pocket(seen.xy[-1]) <= POCKET_REACH * clip_set.ball.diameter:
                told.append(f"{name} was last seen at a pocket, {early:.2f} s before the end: potted")
                continue
            told.append(f"{name} was last seen {early:.2f} s before the end: taken to lie there")
        places[name] = seen.xy[-LAST:]
    where = f"{folder}: {chosen.file}"
    return _laid(clip_set.table, clip_set.ball, places, clip_set.sigma or 0.0, told, where)


def _chosen(clips: Sequence[Clip], clip: str | int | None, folder: Path | str) -> Clip:
    """The clip of this file, or of this number from 1; the last one without."""
    if clip is None:
        return clips[-1]
    files = [c.file for c in clips]
    if isinstance(clip, int) or clip.isdecimal():
        if not 1 <= int(clip) <= len(clips):
            raise BadInput(one_line(f"{folder}: there is no clip {clip}: choose from 1 to {len(clips)}"))
        return clips[int(clip) - 1]
    same = [k for k, file in enumerate(files) if clip in (file, Path(file).name)]
    if len(same) != 1:
        meant = closest(clip, files)
        remedy = f"did you mean {meant!r}?" if meant and not same else f"choose from {listed(files)}, or a number"
        raise BadInput(one_line(f"{folder}: {len(same) or 'no'} clips are called {clip!r}: {remedy}"))
    return clips[same[0]]


def _numbered(seen: Sequence[Detection], counts: Mapping[str, int], told: list[str]) -> dict[str, Detection]:
    """Sightings, the surest first, by names of their own: red, red 2, red 3 from left to right."""
    named: dict[str, Detection] = {}
    for name in sorted({one.name for one in seen}, key=list(counts).index):
        same = [one for one in seen if one.name == name]
        if len(same) > (most := counts[name]):
            told.append(
                f"{len(same)} balls look {name}, of which there {'is' if most == 1 else 'are'} {most}: the surest"
            )
        number = 1
        for one in sorted(same[:most], key=lambda s: float(s.xy[0])):
            own = name if number == 1 else f"{name} {number}"
            while own in named or (number > 1 and own in counts):
                number += 1
                own = f"{name} {number}"
            named[own] = one
            number += 1
    return named


def _not_known(detector: Detector, camera: Camera, picture: Picture, seen: Sequence[Detection]) -> list[str]:
    """What lies on the cloth, has not its colour however lit, and was not found to be a ball, in plain words."""
    import cv2

    bed = detector.background.geometry.bed
    cloth = np.median(picture[bed], axis=0)
    share = (picture @ cloth / (cloth @ cloth)).clip(*LIT)
    odd = (bed & (np.abs(picture - share[..., None] * cloth).max(axis=2) > OFF * cloth.max())).astype(np.uint8)
    for one in seen:
        cv2.circle(odd, (round(float(one.xy[0])), round(float(one.xy[1]))), round(AROUND * one.radius), 0, -1)
    odd = np.asarray(cv2.morphologyEx(odd, cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)), np.uint8)
    _, _, stats, middles = cv2.connectedComponentsWithStats(odd)
    told = []
    for middle, area in zip(middles[1:], stats[1:, cv2.CC_STAT_AREA], strict=True):
        size = area / (np.pi * detector.background.geometry.radius(middle) ** 2)
        if size > PART:
            much = "a ball" if size < 1.5 else f"{size:.0f} balls"
            x, y = camera.on_plane(middle[None], camera.radius)[0]
            told.append(f"something of the size of {much} at {x:.2f}, {y:.2f} m was not made out: add it by hand")
    return told


def _at_rest(recent: Array, least: float) -> tuple[Array, float]:
    """Where a ball rests, of places (k, 2) [m], and 0; where it was last, and how far it moved [m], if that is more."""
    moved = _moved(recent)
    if moved < least:
        return np.asarray(np.median(recent, axis=0)), 0.0
    late = recent[len(recent) // 2 :]  # it may have come to rest within these
    if len(late) > 1 and _moved(late) < least / 2:
        return np.asarray(np.median(late, axis=0)), 0.0
    return recent[-1], moved


def _moved(recent: Array) -> float:
    """From the middle of the first half of places (k, 2) [m] to that of the second [m]."""
    half = len(recent) // 2
    return float(np.hypot(*(recent[half:].mean(axis=0) - recent[:half].mean(axis=0)))) if half else 0.0


def _laid(
    table: Table, ball: Ball, places: Mapping[str, Array], sigma: float, told: list[str], where: str
) -> Found:  # fmt: skip
    """Balls where they were last, of places (k, 2) [m] each, as a scene can have them."""
    kept: dict[str, Array] = {}
    for name, recent in places.items():
        at, moved = _at_rest(recent, max(STILL * ball.radius, 2 * sigma))
        if moved > 0:
            told.append(f"{name} still moves at the end, by {1e3 * moved:.1f} mm: taken where it was last seen")
        if (pocket := pocket_of(at, table, ball)) is not None:
            told.append(f"{name} lies in the pocket {pocket_name(pocket)}: left out")
        elif (np.abs(at) > table.reach(ball) + BEYOND * ball.radius).any():
            told.append(f"{name} lies off the table, at {at[0]:.3f}, {at[1]:.3f} m: left out")
        else:
            kept[name] = at.round(6)
    if not kept:
        raise BadInput(one_line(f"{where}: no ball is left on the table at the end"))
    names, position = tuple(kept), np.array(list(kept.values()))
    deep, i, j = overlap(position, ball)
    if deep > max(OVERLAP, 6 * sigma):
        text = f"{names[i]} and {names[j]} are seen {1e3 * deep:.1f} mm within each other"
        raise BadInput(one_line(f"{where}: {text}: check calibration and ball diameter"))
    return Found(table, ball, names, settled(position, table, ball), tuple(told))
