"""A real camera over the table: a `robot.play.ShotCamera` from a device, an address or a file, and a camera file.

In: pictures and the camera's calibration. Out: positions of resting balls, and the balls' paths of a filmed shot.
`arm` before the stroke starts recording (robot/camera/recorder.py); `film` after it waits until the bed is still, or
the time is up, and tracks the balls (sysid/vision/tracks/track.py): t = 0 is the first picture after the hit.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import count, islice
from pathlib import Path

import cv2
import numpy as np

from models.errors import BadInput
from models.files import scratch_folder, write_whole
from models.shot import Array, Ball, Table
from models.table.presets import usual_mass
from planner.from_picture import CUE_BALL_NAMES, DetectedBalls, balls_in_picture
from robot.camera.recorder import NO_PICTURE, FilmRecorder, checked
from robot.camera.source import Source
from robot.play import FilmedFrames
from sysid.clips import Observation
from sysid.clips.trust import heed_doubts
from sysid.vision import (
    Camera,
    Device,
    Picture,
    Taken,
    TrackedFilm,
    ball_of,
    read_camera,
    track_footage,
    write_camera,
)

LOOK_PICTURES = 8  # number of pictures averaged to find the resting balls
PLACE_ERROR_PX = 0.1  # default sd of a position
MAX_ROLL_S = 60.0  # longest time that balls may roll after `film` is called
MAX_MATCH_RADII = 2.0  # largest distance between a tracked ball and the ball seen before the stroke


@dataclass(frozen=True)
class CameraOptions:
    """Options of a live camera."""

    fps: float | None = None  # frame rate [1/s]; None: as the source reports
    palette_path: Path | str | None = None  # names and colours of the balls; None: those of snooker
    mass: float | None = None  # of a ball [kg]; None: that of a snooker ball of its size
    sigma: float | None = None  # sd of a position, each axis [m]; None: PLACE_ERROR_PX
    max_roll_s: float = MAX_ROLL_S  # longest time that balls may roll after `film` is called
    accept_doubts: bool = False  # open a camera with a doubtful calibration


class LiveCamera:
    """A camera that finds resting balls and films shots; use it as a context manager, or close it."""

    def __init__(
        self,
        source: Source,
        camera: Camera,
        folder: Path | str,
        options: CameraOptions | None = None,
        say: Callable[[str], None] = print,
    ) -> None:
        """Take pictures from a source, such as a `Device`.

        Args:
            source: of pictures.
            camera: its calibration.
            folder: for the recordings film-0001.mkv and so on, with files of their frame times.
            options: rate, balls and limits that differ from the defaults.
            say: called with warnings.
        """
        options = options or CameraOptions()
        rate = float(options.fps if options.fps is not None else source.fps)
        if not 0 < rate < math.inf:
            raise BadInput(f"the camera's rate is {rate:g}/s; give its frame rate")
        self.table: Table = camera.table
        self.ball: Ball = ball_of(camera, options.mass if options.mass is not None else usual_mass(camera.diameter)[0])
        self.fps = rate
        self.sigma = options.sigma if options.sigma is not None else round(PLACE_ERROR_PX * camera.pixel, 5)
        self.warnings: tuple[str, ...] = ()  # of the last look or film
        self.filmed: FilmedFrames | None = None  # frames of the last film
        self.doubts = camera.doubts
        self._source, self.seen_with, self._folder = source, camera, Path(folder)
        self._options, self._say = options, say
        self._seen: dict[str, Array] = {}
        self._film: FilmRecorder | None = None

    @staticmethod
    def open(
        name: int | str, camera_path: Path | str, folder: Path | str, options: CameraOptions | None = None
    ) -> LiveCamera:
        """Open a device by number, an address or a file, with its camera file; other arguments as above.

        BadInput for a camera with a doubtful calibration, since a robot relies on it, unless the options accept that.
        """
        camera = read_camera(camera_path)
        heed_doubts(camera_path, camera.doubts, options is not None and options.accept_doubts)
        return LiveCamera(Device(name, camera.size), camera, folder, options)

    def __enter__(self) -> LiveCamera:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """End a recording and release the camera."""
        self._abandon_film()
        self._source.close()

    def _abandon_film(self) -> None:
        """Discard a recording whose film was not requested."""
        recording, self._film = self._film, None
        if recording is not None:
            recording.stop()

    def pictures(self) -> Iterator[Picture]:
        """Yield the current picture repeatedly, until there are no more; yields none while a shot is recorded."""
        while self._film is None and (got := self._source.newest()) is not None:
            yield checked(got[1], self.seen_with)

    def look(self) -> Mapping[str, Array]:
        """Positions of the resting balls by name, (2,) [m], named as in planner/from_picture.py."""
        if not (seen := list(islice(self.pictures(), LOOK_PICTURES))):
            raise BadInput(NO_PICTURE)
        found = balls_in(seen, self.seen_with, self._options.palette_path, self.ball.mass)
        self.warnings = found.notes
        self._seen = dict(zip(found.names, np.asarray(found.position), strict=True))
        return dict(self._seen)

    def arm(self) -> None:
        """Start recording; to be called just before a stroke."""
        self._abandon_film()
        self.filmed = None
        with contextlib.suppress(OSError):  # the recorder reports a folder that cannot be written
            self._folder.mkdir(parents=True, exist_ok=True)
        films = (self._folder / f"film-{k:04d}.mkv" for k in count(1))
        self._film = FilmRecorder(self._source, self.seen_with, next(f for f in films if not f.exists()), self.fps)

    def film(self) -> Mapping[str, Observation]:
        """Wait until the balls rest, and return their tracks.

        Empty if `arm` was not called, or no shot was found. Faults are warnings, not errors: the stroke has been made.
        """
        if self._film is None:
            return {}
        recording, self._film = self._film, None
        warnings = recording.warnings
        try:
            recording.finish(self._options.max_roll_s)
            return self._tracked(recording, warnings)
        except BadInput as error:
            warnings.append(f"the film could not be evaluated: {error}")
            return {}
        finally:
            self.warnings = tuple(warnings)
            for line in warnings:
                self._say(line)

    def _tracked(self, recording: FilmRecorder, warnings: list[str]) -> dict[str, Observation]:
        """The balls of the first shot that struck the cue ball."""
        footage = recording.footage()
        taken = Taken.of(self.seen_with, palette_path=self._options.palette_path, mass=self.ball.mass)
        film = track_footage(footage, taken, running=False)  # it is the stroke that is wanted
        result = film.result
        warnings += [*footage.assumed[1:], *result.left_out, *result.doubts]
        if film.clips is None:
            return {}
        k = next((k for k, shot in enumerate(result.shots) if shot.struck in CUE_BALL_NAMES), 0)
        if len(result.shots) > 1:
            warnings.append(f"{len(result.shots)} shots were filmed: the one of {result.shots[k].struck} is taken")
        balls = film.clips.clips[k].balls
        names = _names(film, k, self._seen, self.seen_with.radius)
        first = min(int(path.frame[rows[0]]) for path, rows in result.found[k].values())
        self.filmed = FilmedFrames(recording.path, first, result.shots[k].last)
        return {names[name]: ball for name, ball in balls.items()}


def balls_in(
    pictures: Sequence[Picture], camera: Camera, palette_path: Path | str | None = None, mass: float | None = None
) -> DetectedBalls:  # fmt: skip
    """The balls that lie on the table in pictures, found as in a photo."""
    with scratch_folder() as place:
        write_camera(place / "camera.toml", camera)
        (place / "seen").mkdir()
        for k, picture in enumerate(pictures):
            png = cv2.imencode(".png", picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1]
            write_whole(place / "seen" / f"{k:02d}.png", png.tobytes())
        try:
            return balls_in_picture(place / "seen", place / "camera.toml", palette_path=palette_path, mass=mass)
        except BadInput as error:
            raise BadInput(f"the camera's picture: {str(error).replace(f'{place}/', '')}") from error


def _names(film: TrackedFilm, k: int, seen: Mapping[str, Array], radius: float) -> dict[str, str]:
    """Names of the tracked balls as they were seen before the stroke, by the names that tracking gave them."""
    result = film.result
    shot, unmatched, names = result.shots[k], dict(seen), dict[str, str]()
    for name, (path, rows) in result.found[k].items():
        before = np.flatnonzero(path.frame < shot.first)[-LOOK_PICTURES:]
        place = np.median(path.xy[before if before.size else rows[:1]], axis=0)
        distance = {
            n: float(np.hypot(*(xy - place))) for n, xy in unmatched.items() if n.split()[0] == name.split("_")[0]
        }
        nearest = min(distance, key=distance.__getitem__, default="")
        names[name] = nearest if nearest and distance[nearest] < MAX_MATCH_RADII * radius else name
        unmatched.pop(names[name], None)
    return names
