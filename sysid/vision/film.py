"""One film, from its pictures to clips: what `sysid track` does for each video, here or on a worker of a cluster.

In: a film and what is known of how it was taken. Out: `TrackedFilm`. A worker reads the film itself, from the same
path; a mark shows whether it is the same film.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.errors import BadInput
from models.messages import MessageParts, option
from models.recording.live import LiveTrack
from models.table.presets import usual_mass
from models.workers.order import report
from sysid.clips import ClipSet
from sysid.vision import track_report
from sysid.vision.balls.colours.palette import Palette, palette_for
from sysid.vision.balls.discs import Shutter
from sysid.vision.balls.learning import learn_detector
from sysid.vision.camera.camera_motion import SteadyView
from sysid.vision.camera.projection import Camera
from sysid.vision.details import Details, details
from sysid.vision.frames import Footage, Frame, open_footage
from sysid.vision.preview import write_previews
from sysid.vision.steady_footage import SteadyFootage
from sysid.vision.tracks.clips import Extra, clip_set, note
from sysid.vision.tracks.track import Tracked, track, while_steady, without_shots

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

    @staticmethod
    def of(
        camera: Camera, camera_name: Path | str = "the camera's file", *, palette_path: Path | str | None = None,
        fps: float | None = None, exposure: float | None = None, readout: float | None = None,
        mass: float | None = None,
    ) -> Taken:  # fmt: skip
        """By a camera, with the usual balls of its table, or those of a palette.

        Args:
            camera: that took them.
            camera_name: what messages call it.
            palette_path: names and colours of the balls.
            fps: frames taken in a second [1/s].
            exposure: of a frame [s].
            readout: from a picture's first row to its last [s]; None: as the camera says.
            mass: of a ball [kg].
        """
        camera = camera if readout is None else replace(camera, readout=readout)
        palette = palette_for(palette_path, camera.table, camera.diameter)
        return Taken(camera, str(camera_name), palette, fps, exposure, mass)


@dataclass(frozen=True)
class TrackedFilm:
    """What became of a film."""

    video: str
    result: Tracked
    seen: tuple[Details, ...]  # of each shot
    clips: ClipSet | None  # None where there is no shot
    remarks: tuple[MessageParts, ...]  # for the user
    fps: float  # at which it is read [1/s]
    camera: Camera  # that stands where it does in the film

    @property
    def doubts(self) -> tuple[str, ...]:
        """Reasons not to trust the tracks."""
        return tuple(self.result.doubts)

    def lines(self) -> list[str]:
        """What is said of it: remarks, noise, a table of the clips."""
        return track_report.lines(self.result, self._remarks(), self.seen)

    def to_json(self) -> dict[str, Any]:
        """All figures, `billiard-track/1`."""
        return track_report.to_json(self.video, self.result, self._remarks(), self.seen)

    def _remarks(self) -> list[str]:
        return [remark.for_command() for remark in self.remarks]

    def write_pictures(self, folder: Path, progress: Callable[[str], None] = lambda line: None) -> list[Path]:
        """Write a picture of each clip into a folder."""
        return write_previews(folder, open_footage(self.video, self.fps), self.result, progress)

    def write_recording(self, path: Path) -> None:
        """Write the recording for Rerun."""
        footage = open_footage(self.video, self.fps)
        track_report.write_recording(path, self.video, self.result, footage, self.camera)


def track_film(
    video: str, taken: Taken, progress: Callable[[str], None] = lambda line: None, feed: Feed | None = None
) -> TrackedFilm:  # fmt: skip
    """Track the balls of a film, and make clips of its shots; a viewer that is to be fed shows it meanwhile.

    Raises:
        BadInput: it cannot be read, or is not of this camera.
    """
    footage = open_footage(video, taken.fps)
    if footage.size != tuple(taken.camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, taken.camera.size))
        raise BadInput(f"{video}: {sizes} pixels in the video and in {taken.camera_name}; calibrate with this video")
    return track_footage(footage, taken, progress, feed)


def track_footage(
    footage: Footage, taken: Taken, progress: Callable[[str], None] = lambda line: None, feed: Feed | None = None,
    *, running: bool = True,
) -> TrackedFilm:  # fmt: skip
    """The same of footage that is open, of the camera's size; without running clips where they are not wanted."""
    palette = taken.palette
    detector = learn_detector(taken.camera, footage, palette, progress)
    camera, view = detector.camera, SteadyView(detector.camera)
    footage = SteadyFootage(footage, view)
    shutter = Shutter(None if taken.exposure is None else min(taken.exposure * footage.fps, 1.0))
    counts = dict(zip(palette.names, palette.counts, strict=True))
    live = None if feed is None else LiveTrack(feed, Path(footage.name).name, camera.table, camera.diameter)
    watch = None if live is None else partial(_show, live, camera)
    result = while_steady(track(footage, camera, detector, counts, progress, shutter, watch), view)
    if live is not None:
        for number, shot in enumerate(result.shots, 1):
            live.said(result.scene.time_of(shot.last), note(number, shot))
    if not running:
        result = without_shots(result, [bool(shot.running) for shot in result.shots])
    result, seen = details(result, footage, camera, progress, not detector.rough)
    usual, game = usual_mass(camera.diameter)
    mass = taken.mass if taken.mass is not None else usual
    remarks = [MessageParts((text,)) for text in (*footage.assumed, *detector.notes, *result.notes)]
    if taken.mass is None:
        assumed = f"mass {mass:.4f} kg assumed, as of a {game} ball of this size: give the true one with "
        remarks.append(MessageParts((assumed, option("mass"))))
    extras = [Extra({n: t.steady for n, t in one.turned.items()}, one.tip) for one in seen]
    clips = clip_set(result, camera, mass, result.picture_rate or footage.fps, extras) if result.shots else None
    return TrackedFilm(footage.name, result, tuple(seen), clips, tuple(remarks), footage.fps, camera)


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
