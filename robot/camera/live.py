"""A real camera over the table: `robot.play.Camera` from a device, an address or a file, and a calibrated camera file.

`arm` before the stroke starts to record, in the background and without loss; `film` after it waits until the bed is
still, or the time is up, and tracks what was recorded (sysid/vision/tracks/track.py): t = 0 is the first picture after
the hit. A picture belongs to the frame that its stamp says: with stamps s, late by an unknown time each, and a period
T,

    n_k = min(round((s_k - s_0) / T), n_(k+1) - 1),

from the last to the first, so that one that is late pushes none after it. Frames that are missing are left as gaps in
time, and told. Leaves out cameras faster than the disk and the encoder: they lose frames, which is told too.
"""

from __future__ import annotations

import contextlib
import math
import queue
import tempfile
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import count, islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.files import write_whole
from models.shot import Array, Ball, Table
from planner.from_picture import CUES, Found, balls_in_picture
from robot.camera.source import Device, Source
from sysid.cli.track import USUAL
from sysid.clips import Observation
from sysid.vision.balls.detect import Detector
from sysid.vision.balls.palette import default_palette, read_palette
from sysid.vision.camera.projection import Camera, ball_of, read_camera, write_camera
from sysid.vision.details import details
from sysid.vision.frames import Footage, FrameTimes, Picture, Video, quiet
from sysid.vision.tracks.clips import Extra, clip_set
from sysid.vision.tracks.track import Tracked, track

LOOKS = 8  # pictures that a look at resting balls is the mean of
PLACE = 0.1  # error of a place, unless told [pixels]
LIMIT = 60.0  # after `film` is called, until which balls may roll [s]
LONGEST = 300.0  # of a recording [s]
HELD = 64  # pictures that may wait to be written
STUCK = 5.0  # without a picture, after which a camera hangs [s]
REST, BACK = 1.0, 0.4  # for which the bed must be still, and between pictures that are compared [s]
COARSE, CHANGED = 4, 12.0  # pixels that are averaged to see motion, and by how much they change [grey levels]
OFF_RATE = 0.05  # part by which a camera's rate may differ from the one it was told to have
NOTHING = "no picture came from the camera; see that it films, and records no shot already"
SAME = 2.0  # radii within which a ball that is tracked is one that was looked at


class LiveCamera:
    """A camera that looks, and films shots; to be used as a context, or closed."""

    def __init__(
        self, source: Source, camera: Camera, folder: Path | str, *, fps: float | None = None,
        palette_path: Path | str | None = None, mass: float | None = None, sigma: float | None = None,
        limit: float = LIMIT, say: Callable[[str], None] = print,
    ) -> None:  # fmt: skip
        """Take pictures from a source, such as a `Device`.

        Args:
            source: of pictures.
            camera: that it was calibrated as.
            folder: for the recordings, film-0001.mkv and on, their times beside them.
            fps: of the pictures; the source's own without [1/s].
            palette_path: names and colours of the balls; those of snooker without.
            mass: of a ball; that of a snooker ball of its size without [kg].
            sigma: of a place, each axis; a tenth of a pixel without [m].
            limit: after `film` is called, until which balls may roll [s].
            say: told what went wrong.
        """
        rate = float(fps if fps is not None else source.fps)
        if not 0 < rate < math.inf:
            raise BadInput(f"the camera's rate is {rate:g}/s; give the number of pictures that it takes in a second")
        self.table: Table = camera.table
        self.ball: Ball = ball_of(camera, mass if mass is not None else USUAL * camera.diameter**3)
        pixel = camera.radius / float(camera.radius_px(np.zeros((1, 2)))[0])  # [m]
        self.fps, self.sigma = rate, sigma if sigma is not None else round(PLACE * pixel, 5)
        self.told: tuple[str, ...] = ()  # of the last look or film
        self._source, self.seen_with, self._folder = source, camera, Path(folder)
        self._palette_path, self._limit, self._say = palette_path, limit, say
        self._seen: dict[str, Array] = {}
        self._film: Recording | None = None

    @staticmethod
    def open(name: int | str, camera_path: Path | str, folder: Path | str, **rest: Any) -> LiveCamera:
        """A device's number, an address or a file, with its camera file; the rest as above."""
        camera = read_camera(camera_path)
        return LiveCamera(Device(name, camera.size), camera, folder, **rest)

    def __enter__(self) -> LiveCamera:
        """Itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """End a recording, and let the camera go."""
        self._give_up()
        self._source.close()

    def _give_up(self) -> None:
        """End a recording that nobody has asked for."""
        recording, self._film = self._film, None
        if recording is not None:
            recording.stop()

    def pictures(self) -> Iterator[Picture]:
        """The present picture, again and again, until there are no more; nothing while a shot is recorded."""
        while self._film is None and (got := self._source.newest()) is not None:
            yield _checked(got[1], self.seen_with)

    def look(self) -> Mapping[str, Array]:
        """Where the resting balls are seen, by name: (2,) [m]; named as planner/from_picture.py does."""
        if not (seen := list(islice(self.pictures(), LOOKS))):
            raise BadInput(NOTHING)
        found = balls_in(seen, self.seen_with, self._palette_path, self.ball.mass)
        self.told = found.told
        self._seen = dict(zip(found.names, np.asarray(found.position), strict=True))
        return dict(self._seen)

    def arm(self) -> None:
        """Begin to record; to be called just before a stroke."""
        self._give_up()
        with contextlib.suppress(OSError):  # that it cannot be written is told where it is
            self._folder.mkdir(parents=True, exist_ok=True)
        films = (self._folder / f"film-{k:04d}.mkv" for k in count(1))
        self._film = Recording(self._source, self.seen_with, next(f for f in films if not f.exists()), self.fps)

    def film(self) -> Mapping[str, Observation]:
        """Wait until the balls rest, and say where they were.

        Empty where `arm` was not called, or no shot is seen. Faults are told, not raised: the stroke is made by then.
        """
        if self._film is None:
            return {}
        recording, self._film = self._film, None
        told = recording.told
        try:
            recording.finish(self._limit)
            return self._tracked(recording.footage(), told)
        except BadInput as error:
            told.append(f"nothing is made of the film: {error}")
            return {}
        finally:
            self.told = tuple(told)
            for line in told:
                self._say(line)

    def _tracked(self, footage: Footage, told: list[str]) -> dict[str, Observation]:
        """The balls of the first shot that struck the cue ball."""
        palette = read_palette(self._palette_path) if self._palette_path else default_palette()
        detector = Detector.learn(self.seen_with, footage, palette)
        result = track(footage, self.seen_with, detector, dict(zip(palette.names, palette.counts, strict=True)))
        result, seen = details(result, footage, self.seen_with)
        told += [*footage.assumed[1:], *result.left_out, *result.doubts]
        if not result.shots:
            return {}
        k = next((k for k, shot in enumerate(result.shots) if shot.struck in CUES), 0)
        if len(result.shots) > 1:
            told.append(f"{len(result.shots)} shots were filmed: the one of {result.shots[k].struck} is taken")
        extras = [Extra({name: turned.steady for name, turned in one.turned.items()}) for one in seen]
        balls = clip_set(result, self.seen_with, self.ball.mass, self.fps, extras).clips[k].balls
        names = _names(result, k, self._seen, self.seen_with.radius)
        return {names[name]: ball for name, ball in balls.items()}


class Recording:
    """Pictures on their way to a file: one thread reads, one writes, so that a slow moment of the disk loses none."""

    def __init__(self, source: Source, camera: Camera, path: Path, fps: float) -> None:
        """Begin."""
        self.path, self.told = path, list[str]()
        self._source, self._camera, self._fps = source, camera, fps
        self._stamps: list[float] = []
        self._waiting: queue.Queue[Picture | None] = queue.Queue(HELD)
        self._ended, self._asked, self._error = threading.Event(), threading.Event(), ""
        with quiet():
            self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), fps, camera.size)
        if not self._writer.isOpened():
            raise BadInput(f"{path}: cannot be written; name a folder that can, for the recordings")
        self._threads = [threading.Thread(target=run, daemon=True) for run in (self._read, self._write)]
        for thread in self._threads:
            thread.start()

    def finish(self, limit: float) -> None:
        """Wait until the bed is still, for a time at most [s]; BadInput where nothing was recorded."""
        self._asked.set()
        self._threads[0].join(limit)
        if self._threads[0].is_alive():
            self.told.append(f"something still moved on the table after {limit:g} s: the film ends there")
        self.stop()
        if self._error or not self._stamps:
            raise BadInput(self._error or NOTHING)

    def stop(self) -> None:
        """End now."""
        self._ended.set()
        self._threads[0].join(STUCK)
        if self._threads[0].is_alive():
            self._error = f"the camera has given no picture for {STUCK:g} s; unplug it and start again"
            self._waiting.put(None)
        self._threads[1].join()
        self._writer.release()
        rows = "".join(f"{k},{stamp - self._stamps[0]:.6f}\n" for k, stamp in enumerate(self._stamps))
        write_whole(self.path.with_suffix(".times.csv"), f"frame,time_s\n{rows}".encode())

    def footage(self) -> Footage:
        """What was recorded, with its gaps."""
        numbers, period = frame_numbers(np.array(self._stamps), 1 / self._fps)
        if abs(self._fps * period - 1) > OFF_RATE:
            self.told.append(f"the camera gave {1 / period:.4g} pictures/s in place of {self._fps:.4g}")
        video = _Stamped(self.path, numbers, period)
        if video.count is not None and video.count < len(numbers):
            self.told.append(f"only {video.count} of {len(numbers)} pictures were written: see that the disk has room")
        return Footage(video, None)

    def _read(self) -> None:
        still = _Still(self._camera)
        try:
            while not self._ended.is_set() and (got := self._source.read()) is not None:
                stamp, picture = got
                self._stamps.append(stamp)
                self._waiting.put(_checked(picture, self._camera))
                rests = still.since(stamp, picture) >= REST
                if (rests and self._asked.is_set()) or stamp - self._stamps[0] > LONGEST:
                    break
        except (BadInput, OSError, cv2.error) as error:
            self._error = str(error)
        finally:
            self._waiting.put(None)

    def _write(self) -> None:
        while (picture := self._waiting.get()) is not None:  # to the end, or the other thread would wait for room
            try:
                self._writer.write(picture)
            except cv2.error as error:
                self._error = f"{self.path}: cannot be written ({error}); see that the disk has room"


class _Stamped(Video):
    """A video whose frames were taken at other times than an even rate."""

    def __init__(self, path: Path, numbers: NDArray[np.int64], period: float) -> None:
        """`numbers` (n,): which frame of the camera's each is; `period` of these [s]."""
        super().__init__(path)
        self._numbers, self._period = numbers, period

    def read(
        self, jumps: Sequence[int] | None = None, wanted: set[int] | None = None, most: int | None = None
    ) -> Iterator[tuple[float, Picture | None]]:
        """Stamps [s] and pictures."""
        for stamp, picture in super().read(jumps, wanted, most):
            k = min(round(stamp * self.rate), len(self._numbers) - 1)
            yield float(self._numbers[k]) * self._period, picture

    def frame_times(self, fps: float | None) -> FrameTimes:
        """The camera's own."""
        return FrameTimes(self._period, True, 1.0, (f"frame times from the camera's stamps, {1 / self._period:.6g}/s",))


class _Still:
    """Since when nothing moves on the bed."""

    def __init__(self, camera: Camera) -> None:
        x, y = camera.table.length / 2, camera.table.width / 2
        corners = np.array([[x, y, 0], [-x, y, 0], [-x, -y, 0], [x, -y, 0]], float)
        self._size = (max(camera.size[0] // COARSE, 1), max(camera.size[1] // COARSE, 1))
        bed = np.zeros((camera.size[1], camera.size[0]), np.uint8)
        cv2.fillPoly(bed, [np.rint(camera.project(corners)).astype(np.int32)], 1)
        self._bed = cv2.resize(bed, self._size, interpolation=cv2.INTER_NEAREST).astype(bool)
        self._recent: deque[tuple[float, NDArray[np.float32]]] = deque()
        self._moved = math.nan

    def since(self, stamp: float, picture: Picture) -> float:
        """How long the bed has been still, with a picture taken at a time [s]."""
        small = cv2.resize(picture, self._size, interpolation=cv2.INTER_AREA).mean(axis=2, dtype=np.float32)
        self._moved = stamp if math.isnan(self._moved) else self._moved
        self._recent.append((stamp, small))
        while stamp - self._recent[0][0] > BACK:
            before = self._recent.popleft()[1]
            if (np.abs(small - before)[self._bed] > CHANGED).any():
                self._moved = stamp
        return stamp - self._moved


def frame_numbers(stamps: Array, period: float) -> tuple[NDArray[np.int64], float]:
    """Which frame pictures with stamps (n,) [s] are, the first 0: (n,); and the period that fits them [s]."""
    if len(stamps) < 2:
        return np.zeros(len(stamps), np.int64), period
    usual = float(np.median(np.diff(stamps)))
    period = usual if abs(usual / period - 1) > OFF_RATE else period
    for _ in range(3):
        numbers = np.rint((stamps - stamps[0]) / period).astype(np.int64)
        for k in range(len(numbers) - 2, -1, -1):
            numbers[k] = min(numbers[k], numbers[k + 1] - 1)
        period = float(np.polyfit(numbers, stamps, 1)[0])
    return numbers - numbers[0], period


def balls_in(
    pictures: Sequence[Picture], camera: Camera, palette_path: Path | str | None = None, mass: float | None = None
) -> Found:  # fmt: skip
    """The balls that lie on the table in pictures, as a photo's are found."""
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder)
        write_camera(place / "camera.toml", camera)
        (place / "seen").mkdir()
        for k, picture in enumerate(pictures):
            cv2.imwrite(str(place / "seen" / f"{k:02d}.png"), picture, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        try:
            return balls_in_picture(place / "seen", place / "camera.toml", palette_path=palette_path, mass=mass)
        except BadInput as error:
            raise BadInput(f"the camera's picture: {str(error).replace(f'{place}/', '')}") from error


def _checked(picture: Picture, camera: Camera) -> Picture:
    """The picture, if it is of the camera's size."""
    (h, w), (width, height) = picture.shape[:2], camera.size
    if (w, h) != (width, height):
        raise BadInput(f"the camera gives {w} x {h} pixels, its file {width} x {height}; set it to that, or calibrate")
    return picture


def _names(result: Tracked, k: int, seen: Mapping[str, Array], radius: float) -> dict[str, str]:
    """What the balls of a shot were called when they were looked at, by the names that tracking gave them."""
    shot, left, names = result.shots[k], dict(seen), dict[str, str]()
    for name, (path, rows) in result.found[k].items():
        before = np.flatnonzero(path.frame < shot.first)[-LOOKS:]
        place = np.median(path.xy[before if before.size else rows[:1]], axis=0)
        far = {n: float(np.hypot(*(xy - place))) for n, xy in left.items() if n.split()[0] == name.split("_")[0]}
        near = min(far, key=far.__getitem__, default="")
        names[name] = near if near and far[near] < SAME * radius else name
        left.pop(names[name], None)
    return names
