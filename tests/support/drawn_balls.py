"""Pictures of balls at known places, what a detector learns from them, and how far off it is."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.shot import NOSE_COSINE, Table
from sysid.vision.balls.colours.palette import default_palette
from sysid.vision.balls.detect import Detection, Detector
from sysid.vision.balls.discs import Expected
from sysid.vision.balls.learning import learn_detector
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Footage, open_footage
from sysid.vision.sources.pictures import Picture
from tests.footage.cameras import overhead
from tests.footage.film import Look, Spot, film
from tests.footage.motion import Cue, Motion

Array = NDArray[np.float64]
THREE = ("white", "red", "yellow")
MARKS = {"white": [Spot((0, 0, 1), 0.35), Spot((1, 0, 0), 0.35), Spot((0, 1, 0.2), 0.3)]}
LOOK = Look(spots=MARKS)


@cache
def camera_of(radius: int) -> Camera:
    """A camera that sees balls with this radius [pixels]."""
    size, table = ((480, 360), Table(1.0, 0.65, False)) if radius == 10 else ((560, 420), Table(0.62, 0.42, False))
    return overhead(table, 0.0525, size, 1.6, 0.0525 * size[0] / (2 * radius), (0.04, -0.06))


def scattered(camera: Camera, count: int, rng: np.random.Generator, gap: float = 3.5, edge: float = 2.4) -> Array:
    """Places (count, 2) [m] at random, so many ball radii from another and from the noses at least."""
    half = np.array([camera.table.length, camera.table.width]) / 2 - edge * camera.radius
    places: list[Array] = []
    while len(places) < count:
        place = rng.uniform(-half, half)
        if all(np.hypot(*(place - other)) > gap * camera.radius for other in places):
            places.append(place)
    return np.array(places)


def shown(
    camera: Camera, names: Sequence[str], places: Array, look: Look = LOOK, cue: Cue | None = None, seed: int = 0
) -> list[Picture]:
    """Pictures of balls at places (k, n, 2) [m], turned at random."""
    k, n = places.shape[:2]
    turned = Rotation.random(max(k * n, 1), random_state=seed).as_quat()[: k * n].reshape(k, n, 4)
    times = np.arange(max(k, 2), dtype=float)
    motion = Motion(
        tuple(names),
        times,
        places[np.minimum(times.astype(int), k - 1)],
        turned[np.minimum(times.astype(int), k - 1)],
        cue,
    )
    return list(film(camera, motion, times[:k], look, seed))


def footage_of(folder: Path, pictures: Sequence[Picture], fps: float = 100.0) -> Footage:
    folder.mkdir(exist_ok=True)
    for k, picture in enumerate(pictures):
        cv2.imwrite(str(folder / f"{k:04d}.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    return open_footage(folder, fps)


def learnt(folder: Path, camera: Camera, pictures: Sequence[Picture]) -> Detector:
    return learn_detector(camera, footage_of(folder, pictures), default_palette())


def errors(
    detector: Detector,
    camera: Camera,
    pictures: Sequence[Picture],
    names: Sequence[str],
    places: Array,
    off: float = 1.0,
) -> tuple[Array, list[Detection]]:
    """Errors (k, n, 2) [pixels] of balls expected `off` from where they are, and what was seen."""
    rng = np.random.default_rng(1)
    out, seen = np.full((*places.shape[:2], 2), np.nan), []
    for i, (picture, row) in enumerate(zip(pictures, places, strict=True)):
        truth = camera.outline(row)
        guesses = truth + rng.uniform(-off, off, truth.shape)
        found = {
            s.name: s for s in detector.find(picture, [Expected(*one) for one in zip(names, guesses, strict=True)])
        }
        for j, name in enumerate(names):
            if name in found:
                out[i, j] = found[name].xy - truth[j]
                seen.append(found[name])
    return out, seen


def rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def crowded(camera: Camera, count: int, rng: np.random.Generator) -> Array:
    """Two balls within two radii of touching, and one at a cushion: (count, 3, 2) [m]."""
    reach = np.array([camera.table.length, camera.table.width]) / 2 - camera.radius * NOSE_COSINE
    rows = []
    while len(rows) < count:
        one = scattered(camera, 1, rng, edge=4.5)[0]
        way, apart = rng.uniform(0, 2 * np.pi), camera.radius * rng.choice([2.0, 2.1, 2.6, 3.5])
        two = one + apart * np.array([np.cos(way), np.sin(way)])
        three = rng.uniform(-reach, reach)
        axis = int(rng.integers(2))
        three[axis] = rng.choice([-1, 1]) * (reach[axis] - camera.radius * rng.choice([0.0, 0.3, 0.8]))
        if min(np.hypot(*(three - one)), np.hypot(*(three - two))) > 2.5 * camera.radius:
            rows.append(np.array([one, two, three])[rng.permutation(3)])
    return np.array(rows)
