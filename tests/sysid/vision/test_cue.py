"""Cues that were filmed before they strike, against how they moved."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import Table
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.cue.motion import CueMotion, against_ball, watch_cue
from tests.footage.cameras import overhead
from tests.footage.film import Look, film
from tests.footage.motion import Cue, Motion

Picture = NDArray[np.uint8]
DIAMETER = 0.0525
SIZE = (320, 240)
LOOK = Look(exposure=0.002, parts=3, uneven=0.3)
SKIN = (110, 150, 210)


@dataclass(frozen=True)
class Stroke(Cue):
    """A cue that is drawn back, comes on at a constant acceleration, and is slowed down by the ball."""

    def tip_at(self, time: float) -> Array:
        t, back = time - self.struck, 0.1
        last = 2 * back / self.speed
        if t >= 0:
            way = min(0.8 * self.speed * t, self.follow)
        elif t > -last:
            way = -back + self.speed / last * (t + last) ** 2 / 2
        else:
            way = -back + 0.07 * (0.5 - 0.5 * math.cos(math.pi * min((-last - t) / 0.15, 1.0)))
        return np.asarray(np.array(self.contact) + way * self.direction)


@dataclass(frozen=True)
class Scene:
    """A cue about to strike a white ball, as a camera sees it."""

    camera: Camera
    ball: Array
    cue: Cue
    times: Array

    def motion(self, cue: Cue | None) -> Motion:
        """The ball rests until it is struck."""
        times = np.array([-1.0, 0.0, 0.2])
        away = 0.2 * 1.3 * self.cue.speed * self.cue.direction[:2]
        place = np.array([self.ball, self.ball, self.ball + away])[:, None]
        return Motion(("white",), times, place, np.tile([0, 0, 0, 1.0], (3, 1, 1)), cue)

    def pictures(self, look: Look = LOOK) -> list[Picture]:
        return list(film(self.camera, self.motion(self.cue), self.times, look, seed=4))

    def seen(self, pictures: list[Picture]) -> CueMotion | None:
        return watch_cue(list(zip(self.times.tolist(), pictures, strict=True)), self.camera, self.ball)


def scene(
    degrees: float, speed: float, side: float = 0.0, frames: int = 9, fps: float = 120.0, span: float = 0.7,
    elevation: float = 0.0, kind: type[Cue] = Cue, after: int = 0,
) -> Scene:  # fmt: skip
    camera = overhead(Table(2.0, 1.0), DIAMETER, SIZE, 2.6, span, (0.03, -0.04))
    camera = dataclasses.replace(camera, distortion=np.array([-0.1, 0.02, 0.0005, -0.0005, 0.0]))
    azimuth = math.radians(degrees)
    way = np.array([math.cos(azimuth), math.sin(azimuth)])
    ball = camera.on_plane(np.array([SIZE]) / 2.0, camera.radius)[0] + 0.09 * way
    place = ball - math.sqrt(camera.radius**2 - side**2) * way + side * np.array([way[1], -way[0]])
    cue = kind(0.0, (place[0], place[1], camera.radius), azimuth, speed, elevation=elevation)
    return Scene(camera, ball, cue, (np.arange(-frames, after) + 0.4) / fps)


def turned(seen: CueMotion, cue: Cue) -> float:
    """Error of the azimuth [degrees]."""
    return math.degrees(seen.off(cue.azimuth))


@pytest.mark.parametrize(
    ("degrees", "speed", "side", "frames"), [(20, 0.5, 0.006, 12), (137, 1.5, -0.01, 10), (260, 3.0, 0.003, 8)]
)
def test_speed_direction_and_side(degrees: float, speed: float, side: float, frames: int) -> None:
    played = scene(degrees, speed, side, frames)
    seen = played.seen(played.pictures())
    assert seen is not None
    assert seen.speed == pytest.approx(speed, rel=0.01)
    assert seen.speed_sd < 0.01 * speed
    assert abs(turned(seen, played.cue)) < 0.05
    assert seen.azimuth_sd < math.radians(0.03)
    assert seen.side == pytest.approx(side, abs=5e-4)
    assert seen.acceleration == pytest.approx(0, abs=2 * speed)
    assert abs(seen.contact) * speed < 2.5e-3  # a pixel is 2.2 mm
    assert abs(seen.contact) < 3 * seen.contact_sd
    tips = np.array([played.cue.tip_at(float(t))[:2] for t in seen.time])
    assert len(tips) >= frames - 3
    assert np.linalg.norm(seen.tip - tips, axis=1).max() < 2.5e-3


def test_a_stroke_that_speeds_up_and_goes_on_after_contact() -> None:
    played = scene(35, 1.2, frames=24, kind=Stroke, after=4)
    seen = played.seen(played.pictures())
    assert seen is not None
    assert seen.speed == pytest.approx(1.2, rel=0.01)
    assert seen.acceleration == pytest.approx(1.2**2 / 0.2, rel=0.1)
    assert abs(turned(seen, played.cue)) < 0.05


def test_thirty_frames_a_second_and_rows_read_one_after_another() -> None:
    played = scene(75, 0.8, frames=7, fps=30.0)
    played = dataclasses.replace(played, camera=dataclasses.replace(played.camera, readout=0.02))
    seen = played.seen(played.pictures(dataclasses.replace(LOOK, readout=0.02)))
    assert seen is not None
    assert seen.speed == pytest.approx(0.8, rel=0.01)
    assert seen.contact == pytest.approx(0, abs=4e-3)


def test_what_a_raised_cue_does_is_told() -> None:
    played = scene(110, 1.5, elevation=math.radians(5))
    seen = played.seen(played.pictures())
    assert seen is not None
    assert turned(seen, played.cue) == pytest.approx(5 * seen.lean, abs=0.05)
    assert any(f"raised by 5 degrees would appear turned by {5 * seen.lean:+.2f}" in t for t in seen.notes)
    percent = float(next(t for t in seen.notes if "faster" in t).split(" and ")[1].split()[0])
    tips = played.camera.project(np.array([played.cue.tip_at(t) for t in (-1e-3, 0.0)]))
    way = np.diff(played.camera.on_plane(tips, played.camera.radius), axis=0)
    assert percent == pytest.approx(100 * (float(np.linalg.norm(way)) / 1.5e-3 - 1), abs=0.06)


def test_hands_on_the_cue_do_not_spoil_it() -> None:
    played = scene(70, 1.5, frames=10)
    pictures = played.pictures()
    way = played.cue.direction[:2]
    right = np.array([way[1], -way[0]])
    angle = np.linspace(0, 2 * np.pi, 24)

    def blob(picture: Picture, middle: Array, length: float, width: float, colour: tuple[int, int, int]) -> None:
        ring = middle + np.outer(length * np.cos(angle), way) + np.outer(width * np.sin(angle), right)
        pixels = played.camera.project(np.column_stack([ring, np.full(24, DIAMETER / 2)]))
        cv2.fillPoly(picture, [np.rint(16 * pixels).astype(np.int32)], colour, cv2.LINE_AA, 4)

    for time, picture in zip(played.times, pictures, strict=True):
        tip = played.cue.tip_at(float(time))[:2]
        blob(picture, played.ball - 0.15 * way + 0.022 * right, 0.04, 0.03, SKIN)  # the bridge rests, over the cue
        blob(picture, tip - 0.3 * way - 0.06 * right, 0.03, 0.09, (90, 60, 60))
        blob(picture, tip - 0.3 * way, 0.05, 0.035, SKIN)  # the grip moves along
    seen = played.seen(pictures)
    assert seen is not None
    assert seen.speed == pytest.approx(1.5, rel=0.01)
    assert abs(turned(seen, played.cue)) < 0.1


def test_no_cue_is_none() -> None:
    played = scene(70, 1.5, frames=3, after=4)
    struck_unseen = list(film(played.camera, played.motion(None), played.times, LOOK, seed=4))
    assert played.seen(struck_unseen) is None, "the ball's own way is no cue"
    for picture in struck_unseen:
        cv2.line(picture, (10, 200), (310, 30), (120, 200, 140), 2, cv2.LINE_AA)
    assert played.seen(struck_unseen) is None, "nor are lines on the cloth"
    start, way = played.ball - [0.4, 0.05], np.array([0.9, 0.0])
    place = np.stack([np.tile(played.ball, (2, 1)), np.array([start, start + way])], axis=1)
    passing = Motion(("white", "red"), np.array([-0.3, 0.3]), place, np.tile([0, 0, 0, 1.0], (2, 2, 1)))
    assert played.seen(list(film(played.camera, passing, played.times, LOOK, seed=4))) is None


def test_a_cue_that_hardly_moves_has_no_speed() -> None:
    played = scene(20, 0.1, frames=3)
    seen = played.seen(played.pictures())
    assert seen is not None
    assert math.isnan(seen.speed) and math.isnan(seen.contact)
    assert any("too few for a speed" in note for note in seen.notes)


def test_what_cannot_have_struck_the_ball_is_no_cue() -> None:
    played = scene(20, 0.5, 0.006, 12)
    seen = played.seen(played.pictures())
    assert seen is not None
    radius = DIAMETER / 2
    assert against_ball(seen, 1.4 * 0.5, radius) == seen
    slow = against_ball(seen, 2.2 * 0.5, radius)
    assert math.isnan(slow.speed) and math.isnan(slow.azimuth)
    assert slow.notes == (
        "a tip at 0.50 m/s cannot give the ball 1.10 m/s: what was tracked is not the cue, and is left out",
    )
    aside = against_ball(dataclasses.replace(seen, side=-0.86 * radius), 0.6, radius)
    assert math.isnan(aside.side) and "23 mm beside the ball's centre would slip off" in aside.notes[0]
    unsure = dataclasses.replace(seen, speed=0.1, speed_sd=0.3)
    assert against_ball(unsure, 1.0, radius) == unsure


def test_bad_input_is_named() -> None:
    played = scene(20, 1.0, frames=2)
    pictures = played.pictures()
    with pytest.raises(BadInput, match=r"1 frames .* give two or more, in order of time"):
        watch_cue([(0.0, pictures[0])], played.camera, played.ball)
    with pytest.raises(BadInput, match="in order of time"):
        watch_cue([(0.1, pictures[0]), (0.0, pictures[1])], played.camera, played.ball)
