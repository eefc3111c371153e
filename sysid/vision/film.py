"""One film, from its pictures to clips: what `sysid track` does for each video, here or on a worker of a cluster.

In: a film and what is known of how it was taken. Out: `TrackedFilm`. A worker reads the film itself, from the same
path; a mark shows whether it is the same film.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.errors import BadInput
from models.presets import usual_mass
from models.recording.live import LiveTrack
from models.workers.order import report
from sysid.clips import ClipSet
from sysid.vision.balls.discs import Shutter
from sysid.vision.balls.learning import learn_detector
from sysid.vision.balls.palette import Palette
from sysid.vision.camera.projection import Camera
from sysid.vision.details import Details, details
from sysid.vision.frames import Frame, open_footage
from sysid.vision.tracks.clips import Extra, clip_set, note
from sysid.vision.tracks.track import Tracked, track

if TYPE_CHECKING:
    from models.recording.viewer import Feed
    from sysid.vision.balls.detect import Detection

MARKED_BYTES = 1 << 20  # of a file's beginning and of its end, by which it is known


@dataclass(frozen=True)
class Taken:
    """How films were taken."""

    camera: Camera
    camera_name: str  # of its file, for messages
    palette: Palette
    fps: float | None  # frames taken in a second; None: as the film says
    exposure: float | None  # of a frame [s]; None: estimated from the sweep of moving balls
    mass: float | None  # of a ball [kg]; None: a usual one's of this size


@dataclass(frozen=True)
class TrackedFilm:
    """What became of a film."""

    result: Tracked
    seen: tuple[Details, ...]  # of each shot
    clips: ClipSet | None  # None where there is no shot
    remarks: tuple[str, ...]  # for the user
    fps: float  # at which it is read [1/s]


def track_film(
    video: str, taken: Taken, progress: Callable[[str], None], feed: Feed | None = None
) -> TrackedFilm:  # fmt: skip
    """Track the balls of a film, and make clips of its shots; a viewer that is to be fed shows it meanwhile.

    Raises:
        BadInput: it cannot be read, or is not of this camera.
    """
    camera, palette = taken.camera, taken.palette
    footage = open_footage(video, taken.fps)
    if footage.size != tuple(camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, camera.size))
        raise BadInput(f"{video}: {sizes} pixels in video and {taken.camera_name}; calibrate with this video's frames")
    detector = learn_detector(camera, footage, palette, progress)
    camera = detector.camera
    shutter = Shutter(None if taken.exposure is None else min(taken.exposure * footage.fps, 1.0))
    counts = dict(zip(palette.names, palette.counts, strict=True))
    live = None if feed is None else LiveTrack(feed, Path(video).name, camera.table, camera.diameter)
    watch = None if live is None else partial(_show, live, camera)
    result = track(footage, camera, detector, counts, progress, shutter, watch)
    if live is not None:
        for number, shot in enumerate(result.shots, 1):
            live.said(result.scene.time_of(shot.last), note(number, shot))
    result, seen = details(result, footage, camera, progress, not detector.rough)
    usual, game = usual_mass(camera.diameter)
    mass = taken.mass if taken.mass is not None else usual
    remarks = [*footage.assumed, *detector.notes, *result.notes]
    if taken.mass is None:
        remarks.append(f"mass {mass:.4f} kg, that of a {game} ball of this size: give yours with --mass")
    extras = [Extra({n: t.steady for n, t in one.turned.items()}, one.tip) for one in seen]
    clips = clip_set(result, camera, mass, result.picture_rate or footage.fps, extras) if result.shots else None
    return TrackedFilm(result, seen, clips, tuple(remarks), footage.fps)


def tried_film(
    video: str, taken: Taken, progress: Callable[[str], None], feed: Feed | None = None
) -> TrackedFilm | BadInput:  # fmt: skip
    """The same, or what is wrong with the film."""
    try:
        return track_film(video, taken, progress, feed)
    except BadInput as error:
        return error


def _show(live: LiveTrack, camera: Camera, frame: Frame, seen: Sequence[Detection]) -> None:
    """Show a frame with the balls that were found in it."""
    if live.due():
        pixels, radii = np.array([one.xy for one in seen]).reshape(-1, 2), np.array([one.radius for one in seen])
        names = [one.name for one in seen]
        live.frame(frame.index, frame.time, frame.picture, names, pixels, radii, camera.centres(pixels))


def track_same_film(video: str, name: str, taken: Taken, mark: str) -> TrackedFilm | BadInput:
    """The same on a worker, which reports what it does; BadInput where its film is another one, see `film_mark`.

    What is wrong with the film itself is returned, as other films go on.
    """
    import cv2

    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    try:
        same = film_mark(video) == mark
    except (BadInput, OSError):
        raise BadInput(
            f"{video}: cannot be read by the worker on {platform.node()}; give it a path that all machines share"
        ) from None
    if not same:
        raise BadInput(
            f"{video}: is another film on the worker on {platform.node()}; copy it there, or share the folder"
        )
    return tried_film(video, taken, lambda line: report(f"{name}: {line}"))


def film_mark(video: str) -> str:
    """What distinguishes a film from others: names and sizes of its files, and how each begins and ends."""
    digest = hashlib.sha256()
    for path in open_footage(video, 1.0).files:
        size = path.stat().st_size
        digest.update(f"{path.name}\0{size}\0".encode())
        with Path(path).open("rb") as file:
            digest.update(file.read(MARKED_BYTES))
            file.seek(max(size - MARKED_BYTES, 0))
            digest.update(file.read(MARKED_BYTES))
    return digest.hexdigest()[:16]
