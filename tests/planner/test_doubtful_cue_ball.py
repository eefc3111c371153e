"""A cue ball that may be another ball stops a scene until it is named."""

from __future__ import annotations

import numpy as np
import pytest

from models.errors import BadInput
from models.table.presets import POOL_BALL, TABLE_SETS
from planner.from_picture import DetectedBalls, _cue_doubts, scene_of
from sysid.vision import StillBall

GOAL = {"object": "green", "pocket": "any"}
PLACES = {"white": (0.3, 0.1), "green": (-0.4, 0.2), "red_stripe": (0.1, -0.2)}


def ball(colour: str, other: str | None = None, odds: float = 0.0) -> StillBall:
    return StillBall(np.zeros((1, 2)), colour, other, odds)


def found(doubts: tuple[str, ...] = ()) -> DetectedBalls:
    table = TABLE_SETS["pool 9 ft"].table
    return DetectedBalls(table, POOL_BALL, tuple(PLACES), np.array(list(PLACES.values())), (), cue_doubts=doubts)


def test_a_ball_is_doubtful_where_it_or_its_rival_is_the_cue_ball() -> None:
    balls = {
        "white": ball("white", "red_stripe", 0.3), "green": ball("green", "green_stripe", 0.4),
        "red_stripe": ball("red_stripe", "white", 0.35),
    }  # fmt: skip
    assert _cue_doubts(balls, found()) == (
        "white at 0.30, 0.10 m may be red_stripe (30 %)", "red_stripe at 0.10, -0.20 m may be white (35 %)",
    )  # fmt: skip
    sure = {name: ball(name) for name in balls}
    assert _cue_doubts(sure, found()) == ()


def test_a_doubtful_cue_ball_must_be_named() -> None:
    unsure = found(("white at 0.30, 0.10 m may be red_stripe (30 %)",))
    with pytest.raises(BadInput, match=r"photo.png: white at .* \(30 %\): look, and name the cue ball with --cue"):
        scene_of(unsure, GOAL, "photo.png")
    assert scene_of(unsure, GOAL | {"cue": "white"}, "photo.png").names[0] == "white"
    assert scene_of(found(), GOAL, "photo.png").names[0] == "white"
