"""The balls that lie on a table at the end of a film or in a photo, by name.

In: a film, a row of pictures or a photo, its camera, and which balls there may be. Out: a `StillBall` each. The last
picture decides which balls there are; places are those of the last few that show a ball there. Balls of one colour are
numbered from left to right in the picture. Left out are balls in the middle of a pack, which have no outline against
the cloth: a note says where something was not recognised.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from models.errors import BadInput
from models.shot import Array
from sysid.vision.balls.colours.names import MIN_SURE_PROBABILITY
from sysid.vision.balls.colours.palette import palette_for
from sysid.vision.balls.detect import Detection, Detector
from sysid.vision.balls.discs import Expected
from sysid.vision.balls.learning import learn_detector
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import open_footage
from sysid.vision.sources.pictures import Picture

LAST_PICTURES = 8  # in which a ball at rest is looked for
SAME_BALL_RADII = 1.0  # distance within which detections of one name in different frames are the same ball
# Something on the cloth that is not cloth:
MIN_COLOUR_DIFFERENCE = 0.25  # from the cloth's colour at the best brightness, over the cloth's brightest channel
BRIGHTNESS_RANGE = (0.35, 1.8)  # of cloth in shade or light, over the median
BALL_MASK_RADII = 1.3  # around a detected ball that are not examined
MIN_AREA_BALLS = 0.4  # of what is reported, in areas of a ball


@dataclass(frozen=True)
class StillBall:
    """A ball in the last pictures."""

    xy: Array  # (n, 2) its places in those that show it, the last one last [m]
    colour: str  # as the palette calls it
    other: str | None = None  # what else it may be, where that is not sure
    other_odds: float = 0.0  # how likely that is


def find_balls(
    source: Path | str, camera: Camera, *, palette_path: Path | str | None = None, camera_name: Path | str = "",
    progress: Callable[[str], None] = lambda line: None,
) -> tuple[dict[str, StillBall], list[str]]:  # fmt: skip
    """The balls of a photo, or of a film's last pictures, by name; and notes on what was assumed or is in doubt.

    Args:
        source: photo, video, or folder of pictures.
        camera: for pictures of this size.
        palette_path: names and colours of the balls; by default the usual ones of the camera's table.
        camera_name: what messages call the camera.
        progress: receives messages about the progress.

    Raises:
        BadInput: it cannot be read, is of another size, shows the table elsewhere, or no ball.
    """
    name = camera_name or "the camera's file"
    palette = palette_for(palette_path, camera.table, camera.diameter)
    footage = open_footage(source, 1.0)  # the times of pictures are not used
    if footage.size != tuple(camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, camera.size))
        raise BadInput(f"{source}: {sizes} pixels in it and in {name}; calibrate with pictures of this size")
    detector = learn_detector(camera, footage, palette, progress)
    camera = detector.camera
    progress("finding the balls in the last frame")
    pictures = deque((frame.picture for frame in footage), maxlen=LAST_PICTURES)
    notes = list(detector.notes)
    detections = detector.named(pictures[-1], detector.find(pictures[-1]))
    notes += _unrecognised(detector, camera, pictures[-1], detections)
    balls = _numbered(detections, palette.known, notes)
    if not balls:
        raise BadInput(f"{source}: no ball is seen in the last frame; check that {name} belongs to it, and the light")
    pixels = {name: [one.xy] for name, one in balls.items()}  # the last frame first
    expected = [Expected(one.name, one.xy) for one in balls.values()]
    for picture in list(pictures)[-2::-1]:
        before = detector.find(picture, expected)
        for name, one in balls.items():
            pairs = [(np.hypot(*(s.xy - one.xy)) / one.radius, s.xy) for s in before if s.name == one.name]
            pixels[name] += [xy for d, xy in sorted(pairs, key=lambda pair: pair[0])[:1] if d < SAME_BALL_RADII]
    found = {}
    for name, one in balls.items():
        places = camera.centres(np.array(pixels[name][::-1]))
        found[name] = StillBall(
            places, one.name, *((one.other, 1 - one.odds) if one.odds < MIN_SURE_PROBABILITY else ())
        )
    return found, notes


def _numbered(detections: Sequence[Detection], counts: Mapping[str, int], notes: list[str]) -> dict[str, Detection]:
    """Detections, given the most certain first, by unique names: red, red 2, red 3 from left to right."""
    named: dict[str, Detection] = {}
    for colour in sorted({one.name for one in detections}, key=list(counts).index):
        same = [one for one in detections if one.name == colour]
        if len(same) > (count := counts[colour]):
            notes.append(f"{len(same)} balls look {colour}, but the palette has {count}: the most certain are used")
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
    bed = detector.background.geometry.bed
    cloth = np.median(picture[bed], axis=0)
    brightness = (picture @ cloth / max(cloth @ cloth, 1.0)).clip(*BRIGHTNESS_RANGE)  # a picture may be black
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
            count = "one ball" if size < 1.5 else f"{size:.0f} balls"
            x, y = camera.on_plane(centroid[None], camera.radius)[0]
            notes.append(f"an object of the size of {count} at {x:.2f}, {y:.2f} m was not recognised: add it by hand")
    return notes
