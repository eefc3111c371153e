"""The examination's generator against closed forms and published predictions."""

from __future__ import annotations

import math
from pathlib import Path

import pytest

from sysid.clips import read_clip_set
from tests.examination.__main__ import make
from tests.examination.motion import Ball, Seen, World


def rolled(ball: Ball, radius: float) -> float:
    """Speed once a ball rolls, whatever friction it slides with (Coriolis)."""
    vx, vy, wx, wy = ball[2:6]
    return math.hypot(5 * vx + 2 * radius * wy, 5 * vy - 2 * radius * wx) / 7


@pytest.mark.parametrize(
    ("speed", "cut", "struck", "other"),
    [(1.539, 33.83, 0.914, 0.831), (1.032, 26.36, 0.520, 0.599), (1.731, 46.50, 1.28, 0.780),
     (0.942, 18.05, 0.383, 0.579)],
)  # fmt: skip
def test_collisions_are_those_that_mathavan_predicts(speed: float, cut: float, struck: float, other: float) -> None:
    """Of Mathavan, Jackson and Parkin 2014, as printed."""
    world = World(ball_e=lambda seen: 0.89, ball_mu=lambda seen: 0.05, slide=lambda seen: 0.21)
    along, aside = math.cos(math.radians(cut)) * speed, math.sin(math.radians(cut)) * speed
    one = [0.0, 0.0, along, aside, -aside / world.radius, along / world.radius, 0.0]
    two = [2 * world.radius - 1e-9, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    world._meet(one, two, 0, 1)
    assert rolled(one, world.radius) == pytest.approx(struck, abs=3e-3)
    assert rolled(two, world.radius) == pytest.approx(other, abs=3e-3)


def test_a_ball_slides_rolls_and_stops_where_closed_forms_say() -> None:
    world = World(length=20.0, slide=lambda seen: 0.212, roll=lambda seen: 0.0127)
    ball = [0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 10.0]
    world.play([ball], [0.5, 10.0])
    assert ball[0] == pytest.approx(12 / (49 * 0.212 * 9.81) + 25 / (98 * 0.0127 * 9.81), rel=1e-6)
    assert ball[2:] == [0.0] * 5


def test_a_cushion_returns_what_it_is_told_of_a_ball_without_friction() -> None:
    world = World(cushion_e=lambda seen: 0.8, cushion_mu=lambda seen: 0.0, slide=lambda seen: 0.0)
    ball = [0.0, 0.0, 1.0, 0.3, 0.0, 0.0, 0.0]
    world._strike_cushion(ball, (1.0, 0.0), 1.0, Seen(ball, 0))
    assert ball[2:4] == pytest.approx([-0.8, 0.3])


def test_the_cloth_under_a_ball_in_an_impact_is_that_of_the_ball() -> None:
    """Of two that meet, friction presses the second here: what the cloth has under the first is of no matter."""
    after = []
    for under in ((0.2, 0.2), (0.9, 0.2), (0.2, 0.9)):
        world = World(ball_e=lambda seen: 0.9, ball_mu=lambda seen: 0.1, slide=lambda seen, u=under: u[seen.number])
        one, two = [0.0, 0.0, 1.0, 0.0, 0.0, 30.0, 0.0], [0.0524, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        world._meet(one, two, 0, 1)
        after.append([*one, *two])
    assert after[0] == after[1] and after[0] != after[2]


def test_a_set_is_read_and_says_nothing_of_what_is_hidden(tmp_path: Path) -> None:
    make(tmp_path / "set", "sagging_camera", 0, clips=2)
    clip_set = read_clip_set(tmp_path / "set")
    assert len(clip_set.clips) == 2 and "sagging" not in (tmp_path / "set" / "clips.toml").read_text()
    assert "slides along x" in (tmp_path / "set.truth.json").read_text()
