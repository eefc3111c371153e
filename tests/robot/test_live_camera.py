"""A camera that looks and films rendered pictures: balls by name, a shot from the hit on, what goes wrong."""

from __future__ import annotations

import time
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from models.errors import BadInput
from models.model_file import full_model
from models.shot import Ball, Shot, Table, Track
from models.simulation.simulate import simulate
from robot.camera.live import CameraOptions, LiveCamera
from robot.camera.recorder import FilmRecorder, frame_numbers
from robot.play import ShotCamera
from sysid.vision import Device, write_camera
from tests.footage.cameras import overhead
from tests.footage.film import Look, film
from tests.footage.motion import Motion, motion_of

Picture = NDArray[np.uint8]
TABLE, BALL = Table(1.1, 0.6, pockets=False), Ball(0.0525, 0.1406)
CAMERA = overhead(TABLE, BALL.diameter, (400, 250), 1.9, 1.35, (0.01, -0.015))
FPS, LEAD, TAIL = 40.0, 0.4, 1.8
NAMES = ("white", "red", "red_2")
PLACES = np.array([[-0.35, -0.1], [0.1, 0.02], [0.3, -0.2]])
SPEED = 0.7
PIXEL = 1.35 / 400  # [m]


@cache
def played() -> Track:
    """The white strikes a red; from the hit on, a sample a millisecond."""
    velocity = np.zeros((3, 2))
    velocity[0] = SPEED * (PLACES[1] - PLACES[0]) / np.linalg.norm(PLACES[1] - PLACES[0])
    shot = Shot(NAMES, PLACES, velocity, np.zeros((3, 3)), np.arange(0, 12, 2e-3))
    [track] = simulate(full_model(TABLE, BALL), [shot], threads=1)
    moving = np.flatnonzero(np.abs(np.diff(track.position, axis=0)).max(axis=(1, 2)) > 1e-7)
    last = min(int(moving[-1]) + 2, len(track.times))
    cut = (v[:last] for v in (track.times, track.position, track.velocity, track.spin, track.theta))
    return Track(track.names, *cut)


@cache
def filmed() -> tuple[Picture, ...]:
    """At rest, then the shot, then at rest."""
    motion: Motion = motion_of(played())
    times = np.arange(int((LEAD + played().times[-1] + TAIL) * FPS)) / FPS - LEAD
    return tuple(film(CAMERA, motion, times, Look(noise=3.0), seed=1))


class Reel:
    """Pictures that come one after another, as fast as they are taken; the last one stays."""

    fps = FPS

    def __init__(self, pictures: tuple[Picture, ...], drop: frozenset[int] = frozenset(), late: float = 0.0) -> None:
        self.pictures, self.drop, self.at, self.taken = pictures, drop, 0, 0
        self.rng, self.late = np.random.default_rng(0), late
        self.closed = False

    def read(self) -> tuple[float, Picture] | None:
        while self.at in self.drop:
            self.at += 1
        stamp, k = self.at / FPS, min(self.at, len(self.pictures) - 1)
        self.at += 1
        self.taken += 1
        return stamp + self.late * float(self.rng.uniform()), self.pictures[k]

    def newest(self) -> tuple[float, Picture] | None:
        return 0.0, self.pictures[0]

    def close(self) -> None:
        self.closed = True


def live(tmp_path: Path, reel: Reel, said: list[str]) -> LiveCamera:
    return LiveCamera(reel, CAMERA, tmp_path / "films", CameraOptions(mass=BALL.mass), said.append)


def test_it_is_a_camera_for_play(tmp_path: Path) -> None:
    assert live(tmp_path, Reel(grey(0)), []).seen_with is CAMERA
    camera: ShotCamera = live(tmp_path, Reel(grey(0)), [])
    assert (camera.table, camera.ball, camera.fps) == (TABLE, BALL, FPS)
    assert camera.sigma == pytest.approx(0.1 * PIXEL, rel=0.1)
    assert camera.film() == {}, "nobody has armed it"


def true_places(name: str, times: NDArray[np.float64]) -> NDArray[np.float64]:
    k = NAMES.index(name.replace(" ", "_"))
    return np.column_stack([np.interp(times, played().times, played().position[:, k, axis]) for axis in (0, 1)])


@pytest.mark.slow
def test_a_shot_is_filmed_from_the_hit_until_the_balls_rest(tmp_path: Path) -> None:
    said: list[str] = []
    reel = Reel(filmed(), frozenset({30, 31, 44}), late=0.3 / FPS)
    with live(tmp_path, reel, said) as camera:
        seen = camera.look()
        camera.arm()
        assert list(camera.pictures()) == [], "the recording has them"
        balls = camera.film()
    assert reel.closed
    assert set(seen) == {"white", "red", "red 2"}
    for name, xy in seen.items():
        assert np.linalg.norm(xy - PLACES[NAMES.index(name.replace(" ", "_"))]) < 0.3 * PIXEL
    assert list(balls) == ["white", "red", "red 2"], "the struck ball first, named as it was looked at"
    assert reel.taken < len(filmed()) + 400, "it ended by itself"
    first = min(ball.time[0] for ball in balls.values())
    assert first == 0
    began = np.linspace(0, 1 / FPS, 21)  # the first picture after the hit is at most a frame after it
    for name, ball in balls.items():
        off = [np.linalg.norm(ball.xy - true_places(name, ball.time + t), axis=1) for t in began]
        assert min(float(np.sqrt(np.mean(o**2))) for o in off) < 0.5 * PIXEL, "gaps in time are kept"
        assert ball.time[-1] > played().times[-1]
    assert any("3 frames missing" in line for line in said)
    seen_at = {round(t, 6) for ball in balls.values() for t in ball.time}
    shown = camera.filmed
    assert shown is not None and shown.video.name == "film-0001.mkv"
    assert shown.last - shown.first + 1 == pytest.approx(len(seen_at), abs=2), "a picture for every sample"
    assert (tmp_path / "films" / "film-0001.mkv").stat().st_size > 1e5
    assert len((tmp_path / "films" / "film-0001.times.csv").read_text().splitlines()) > len(filmed()) - 60


def test_frames_get_their_numbers_though_stamps_are_late() -> None:
    rng = np.random.default_rng(3)
    true = np.delete(np.arange(2000), rng.choice(np.arange(1, 1999), 25, replace=False))
    for late in (0.0, 0.2, 0.45):
        stamps = (true + late * rng.uniform(0, 1, len(true))) * 1.0001 / FPS
        numbers, period = frame_numbers(stamps, 1 / FPS)
        assert (numbers == true).all()
        assert period == pytest.approx(1.0001 / FPS, rel=1e-5)


def test_a_picture_that_waited_pushes_none_after_it() -> None:
    true = np.arange(400)
    stamps = true / FPS
    stamps[100:103] = 103.0 / FPS - np.array([2e-3, 1e-3, 5e-4])  # three came at once, with the next one
    assert (frame_numbers(stamps, 1 / FPS)[0] == true).all()


def test_a_rate_that_was_told_wrong_is_measured() -> None:
    assert frame_numbers(np.arange(50) / 25.0, 1 / 60.0)[1] == pytest.approx(1 / 25.0)
    assert frame_numbers(np.array([3.0]), 1 / 60.0)[0].tolist() == [0]


def grey(*levels: int) -> tuple[Picture, ...]:
    return tuple(np.full((CAMERA.size[1], CAMERA.size[0], 3), k, np.uint8) for k in levels)


def test_what_is_recorded_is_lossless_and_keeps_its_gaps(tmp_path: Path) -> None:
    levels = list(range(60, 200, 2))
    reel = Reel(grey(*levels), frozenset({20, 21, 50}), late=0.4 / FPS)
    recording = FilmRecorder(reel, CAMERA, tmp_path / "gaps.mkv", FPS)
    recording.finish(20.0)
    footage = recording.footage()
    frames = list(footage)[:60]
    true = [k for k in range(len(levels)) if k not in reel.drop][:60]
    assert [int(frame.picture[7, 7, 1]) for frame in frames] == [levels[k] for k in true]
    assert [frame.time for frame in frames] == pytest.approx(np.array(true) / FPS, rel=2e-3)
    assert "3 frames missing: left as gaps in time" in footage.assumed
    rows = (tmp_path / "gaps.times.csv").read_text().splitlines()
    assert rows[0] == "frame,time_s"
    assert len(rows) == reel.taken + 1


def test_a_recording_ends_when_the_bed_is_still_and_at_a_limit(tmp_path: Path) -> None:
    still = FilmRecorder(Reel(grey(90)), CAMERA, tmp_path / "still.mkv", FPS)
    still.finish(20.0)
    assert still.warnings == []
    restless = FilmRecorder(Restless(), CAMERA, tmp_path / "restless.mkv", FPS)
    restless.finish(0.3)
    assert "still moving" in restless.warnings[0]


class Restless(Reel):
    """Something moves all the time."""

    def __init__(self) -> None:
        super().__init__(grey(*range(0, 256, 3)))

    def read(self) -> tuple[float, Picture] | None:
        time.sleep(2e-3)
        self.at = 0 if self.at >= len(self.pictures) - 1 else self.at
        super().read()
        return self.taken / FPS, self.pictures[self.at]


def test_pictures_of_another_size_are_refused(tmp_path: Path) -> None:
    small = Reel((np.zeros((20, 30, 3), np.uint8),))
    said: list[str] = []
    with live(tmp_path, small, said) as camera:
        with pytest.raises(BadInput, match="30 x 20 pixels, its file 400 x 250"):
            camera.look()
        camera.arm()
        assert camera.film() == {}, "a stroke is made by then: its record is not to be lost"
    assert "30 x 20 pixels" in said[0]
    assert camera.warnings == tuple(said)


def test_an_end_without_pictures_and_a_rate_that_is_not_known(tmp_path: Path) -> None:
    class Dead(Reel):
        fps = 0.0

        def read(self) -> None:
            return None

        newest = read

    with pytest.raises(BadInput, match="rate is 0/s; give"):
        LiveCamera(Dead(()), CAMERA, tmp_path)
    said: list[str] = []
    with LiveCamera(Dead(()), CAMERA, tmp_path, CameraOptions(fps=FPS), said.append) as camera:
        with pytest.raises(BadInput, match="no picture came"):
            camera.look()
        camera.arm()
        assert camera.film() == {}
    assert "no picture came" in said[0]


def test_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "films").write_text("a file")
    with (
        live(tmp_path, Reel(grey(0)), []) as camera,
        pytest.raises(BadInput, match=r"film-0001\.mkv: cannot be written; name a writable folder"),
    ):
        camera.arm()


def test_devices(tmp_path: Path) -> None:
    for name in (97, "97", str(tmp_path / "absent.mkv"), "rtsp://127.0.0.1:9/none"):
        with pytest.raises(BadInput, match=r"cannot be opened; check that it is plugged in"):
            Device(name)
    writer = cv2.VideoWriter(str(tmp_path / "v.mkv"), cv2.VideoWriter_fourcc(*"FFV1"), FPS, CAMERA.size)
    for picture in grey(10, 20, 30):
        writer.write(picture)
    writer.release()
    write_camera(tmp_path / "camera.toml", CAMERA)
    with LiveCamera.open(str(tmp_path / "v.mkv"), tmp_path / "camera.toml", tmp_path) as camera:
        assert camera.fps == pytest.approx(FPS)
        assert [int(picture[0, 0, 0]) for picture in camera.pictures()] == [10, 20, 30]
    device = Device(str(tmp_path / "v.mkv"))
    stamps = [got[0] for got in iter(device.read, None) if got]
    assert stamps == pytest.approx(np.arange(3) / FPS, abs=2e-3)
