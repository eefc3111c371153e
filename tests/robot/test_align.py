"""The cue's direction in one picture: geometry, rendered cues of all kinds, what the operator is told, bad input."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models.errors import BadInput
from models.mjcf.stroke import CUE_TILT
from robot.camera.align import align, turn_for
from sysid.vision.camera.projection import Array
from sysid.vision.cue.axis import CueAxis
from sysid.vision.cue.line import CueLine, _raised, cue_direction
from tests.robot.align_pictures import RAISED, Light, Picture, Stick, bare, camera_over, cases, empty, picture

CAMERA = camera_over()
BALL = (0.3, -0.2)


@pytest.fixture(scope="module")
def ground() -> Light:
    return empty(CAMERA)


def drawn(ground: Light, *sticks: Stick, noise: float = 2.0, line: float | None = None) -> Picture:
    table = bare(CAMERA, ground, {"white": BALL}, line)
    rng = np.random.default_rng(0)
    for stick in sticks[1:]:
        table = picture(CAMERA, stick, table, 0.0, rng).astype(np.float32)
    return picture(CAMERA, sticks[0] if sticks else None, table, noise, rng)


def off(line: CueLine, azimuth: float) -> float:
    """Error [degrees]."""
    return math.degrees(math.remainder(line.azimuth - azimuth, 2 * math.pi))


@pytest.mark.parametrize("elevation", [0.0, RAISED, math.radians(20)])
def test_a_raised_axis_is_got_back_from_what_is_seen_of_it(elevation: float) -> None:
    rng = np.random.default_rng(1)
    for azimuth in rng.uniform(-math.pi, math.pi, 20):
        x, y = rng.uniform(-1, 1, 2) * [1.2, 0.6]
        stick = Stick((float(x), float(y)), float(azimuth), float(rng.uniform(-0.012, 0.012)), elevation=elevation)
        tip, way = stick.axis
        (one, two) = CAMERA.on_plane(CAMERA.project(np.array([tip, tip + 0.6 * way])), CAMERA.radius)
        seen = np.arctan2(*(one - two)[::-1])
        beside = (one - np.array(stick.ball)) @ [math.sin(seen), -math.cos(seen)]
        got, left = _raised(CueAxis(np.array(stick.ball), float(seen), float(beside)), CAMERA, elevation)
        assert math.remainder(got - azimuth, 2 * math.pi) == pytest.approx(0, abs=1e-7)
        assert left == pytest.approx(stick.left, abs=1e-7)


def test_turns_mirror_each_other() -> None:
    for wanted, azimuth in ((0.3, 0.2), (3.1, -3.1), (-3.0, 3.1)):
        one = turn_for(CueLine(azimuth, 0.0, 0.0, 1.0), wanted)
        other = turn_for(CueLine(-azimuth, 0.0, 0.0, 1.0), -wanted)
        assert one.degrees == pytest.approx(other.degrees)
        assert {one.side, other.side} == {"left", "right"}
    assert turn_for(CueLine(0.2, 0.0, 0.0, 1.0), 0.3).side == "left", "anticlockwise is the way angles grow"


def test_what_the_operator_is_told() -> None:
    line = CueLine(math.radians(30), 0.0, 0.0, 1.0)
    assert str(turn_for(line, math.radians(31.3))) == "turn 1.30 degrees to the left (anticlockwise)"
    assert str(turn_for(line, math.radians(28.75))) == "turn 1.25 degrees to the right (clockwise)"
    assert str(turn_for(line, math.radians(30.06))) == "aligned (0.06 degrees off)"
    assert turn_for(line, math.radians(30.06), tolerance=math.radians(0.05)).side == "left"


@pytest.mark.slow
def test_cues_of_all_colours_everywhere() -> None:
    """Wooden, dark, pale; three noises; alone and in a launcher; a chalk line through the ball; soft shadows."""
    errors, pulls, beside = [], [], []
    for case in cases(24):
        line = cue_direction(case.picture, CAMERA, np.array(case.stick.ball), CUE_TILT)
        errors.append(off(line, case.stick.azimuth))
        pulls.append(errors[-1] / math.degrees(line.azimuth_sd))
        beside.append(line.offset - case.stick.left)
        assert abs(errors[-1]) < 0.1, case.name
        assert line.length > 0.25
    assert float(np.sqrt(np.mean(np.square(errors)))) < 0.03
    assert 0.2 < float(np.sqrt(np.mean(np.square(pulls)))) < 2.0
    assert np.abs(beside).max() < 2e-3


def test_the_elevation_matters_as_it_is_noted(ground: Light) -> None:
    stick = Stick(BALL, math.radians(75), left=0.005)
    seen = drawn(ground, stick)
    line = cue_direction(seen, CAMERA, np.array(BALL), CUE_TILT)
    higher = cue_direction(seen, CAMERA, np.array(BALL), RAISED + math.radians(1))
    lean = math.degrees(higher.azimuth - line.azimuth)
    assert f"{lean:+.2f} degrees" in line.noted[-1]
    assert abs(lean) > 0.05
    level = dataclasses.replace(stick, elevation=0.0)
    flat = cue_direction(drawn(ground, level), CAMERA, np.array(BALL), 0.0)
    assert abs(off(flat, level.azimuth)) < 0.05
    assert flat.offset == pytest.approx(0.005, abs=2e-3)


def test_a_second_cue_is_told_of(ground: Light) -> None:
    sticks = [Stick(BALL, math.radians(a)) for a in (20, 140)]
    line = cue_direction(drawn(ground, *sticks), CAMERA, np.array(BALL), CUE_TILT)
    assert min(abs(off(line, stick.azimuth)) for stick in sticks) < 0.1
    assert "another bar" in line.noted[0]


def test_the_stand_is_turned_until_it_is_aligned(ground: Light) -> None:
    ways = [40.0, 41.0, 41.5, 41.98]
    shown = [drawn(ground, Stick(BALL, math.radians(a))) for a in ways]
    blind = drawn(ground)
    said: list[str] = []
    frames = [*shown[:2], blind, blind, *shown[2:3], *[shown[3]] * 20]
    rest = iter(frames)
    line = align(rest, CAMERA, math.radians(42), np.array(BALL), say=said.append)
    assert len(list(rest)) == 15, "five pictures that are aligned end it"
    assert off(line, math.radians(41.98)) == pytest.approx(0, abs=0.05)
    assert [text.split()[0] for text in said] == ["turn", "turn", "no", "turn", "aligned"], said
    assert all("left (anticlockwise)" in text for text in said if text.startswith("turn"))
    said.clear()
    line = align(shown[:1] * 3, CAMERA, math.radians(42), np.array(BALL), say=said.append)
    assert turn_for(line, math.radians(42)).side == "left"
    assert len(said) == 1, "what has not changed is not told again"


@pytest.mark.slow
def test_the_cue_ball_is_found(ground: Light) -> None:
    shown = drawn(ground, Stick(BALL, math.radians(200)))
    line = align([shown], CAMERA, math.radians(200), say=lambda text: None)
    assert abs(off(line, math.radians(200))) < 0.1
    assert line.offset == pytest.approx(0, abs=2e-3)


@pytest.mark.parametrize("chalk", [None, BALL[0]], ids=["bare", "on a chalk line"])
def test_no_cue(ground: Light, chalk: float | None) -> None:
    with pytest.raises(BadInput, match=r"no cue was found behind the ball at 0\.300, -0\.200 m; put it") as caught:
        cue_direction(drawn(ground, line=chalk), CAMERA, np.array(BALL), CUE_TILT)
    assert "\n" not in str(caught.value)
    with pytest.raises(BadInput, match="no cue"):
        align([drawn(ground)], CAMERA, 0.0, np.array(BALL), say=lambda text: None)


@pytest.mark.parametrize(
    ("ball", "elevation", "shape", "told"),
    [
        (np.array([np.nan, 0.0]), RAISED, (960, 1280, 3), "two numbers"),
        (np.zeros(3), RAISED, (960, 1280, 3), "two numbers"),
        (np.zeros(2), 6.5, (960, 1280, 3), "give radians"),
        (np.zeros(2), RAISED, (480, 640, 3), "640 x 480 pixels, the camera's file 1280 x 960"),
    ],
)
def test_what_cannot_be_used(ball: Array, elevation: float, shape: tuple[int, int, int], told: str) -> None:
    with pytest.raises(BadInput, match=told):
        cue_direction(np.zeros(shape, np.uint8), CAMERA, ball, elevation)


def test_no_picture() -> None:
    with pytest.raises(BadInput, match="no picture came"):
        align([], CAMERA, 0.0, np.zeros(2))
