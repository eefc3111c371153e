"""Strokes on a model: the event engine and MuJoCo tell the same of them, with every effect."""

from __future__ import annotations

import dataclasses
import math

import mujoco
import numpy as np
import pytest

from models.effect import Effect, param
from models.effect_catalogue import effect_class
from models.shot import GRAVITY
from planner.launcher.stroke import AZIMUTH, SIDE
from planner.scene import pocket_places
from tests.support.planned_shots import BALL, DIAGONAL, MODEL, SLIDE, TABLE, ready, scene, straight, stroke, strokes


@dataclasses.dataclass(frozen=True)
class Leaning(Effect):
    """A tilt that only MuJoCo knows."""

    slope: float = param(0.002, off=0.0, unit="rad", bounds=(0.0, 0.1), source="made up")

    def edit(self, spec: mujoco.MjSpec) -> None:
        spec.option.gravity[0] = GRAVITY * self.slope


def test_the_engine_and_mujoco_tell_the_same() -> None:
    asked = scene([1.0, -0.2], [1.5, -0.6], [1.3, 0.3], [1.6, -0.4], [0.1, 0.5], pocket=(1, -1), avoid=("b1",))
    line = pocket_places(TABLE)[1, -1] - asked.position[1]
    way = asked.position[1] - BALL.diameter * line / np.hypot(*line) - asked.position[0]
    q = strokes(60, 5)
    q[:50, AZIMUTH] = math.atan2(way[1], way[0]) + np.linspace(-0.03, 0.03, 50)
    q[:50, SIDE] *= 0.2
    player = ready(asked)
    a, b = player.screen(q), player.play(q)
    for f in ("potted", "pocket", "fouls", "hits"):
        assert (getattr(a, f) == getattr(b, f)).mean() > 0.95, f
    away = np.abs(a.place - b.place)
    assert np.isfinite(away).all(axis=(1, 2)).sum() > 20 and np.nanmedian(away.reshape(len(q), -1).max(axis=1)) < 5e-3
    assert 5 < a.potted.sum() < 40 and a.fouls.any(axis=0).all() and a.hits.any(axis=0).all()


@pytest.mark.parametrize("name", ["table_tilt", "air_drag", "off_centre_ball", "cue_hop", "squirt", "cue_ball_mass"])
def test_effects_of_the_model_are_played_by_both(name: str) -> None:
    asked = straight(0.8, 0.5, [-0.3, 0.2], pocket=(1, 1))
    q = strokes(30, 6)
    q[:, AZIMUTH], q[:, SIDE] = DIAGONAL + np.linspace(-0.01, 0.01, 30), 0.2 * q[:, SIDE]
    slide = MODEL.parameters()[SLIDE] * np.linspace(0.9, 1.1, 30)
    usual, own = ready(asked), ready(asked, MODEL.add(effect_class(name)()))
    a, b = own.screen(q, {SLIDE: slide}), own.play(q, {SLIDE: slide})
    assert (a.potted == b.potted).mean() > 0.9 and (a.fouls == b.fouls).mean() > 0.9
    away, moved = (np.abs(o.cue - a.cue)[np.isfinite(o.cue) & np.isfinite(a.cue)] for o in (b, usual.screen(q)))
    assert np.median(away) < 2e-3 and moved.max() > 5e-3 and 3 < a.potted.sum() < 30


def test_what_edits_the_mjcf_is_played_in_mujoco_alone() -> None:
    asked, q = straight(0.8, 0.5), stroke(1.2, DIAGONAL + 0.002)
    player = ready(asked, MODEL.add(Leaning()))
    assert np.array_equal(player.screen(q).cue, player.play(q).cue)
    assert not np.array_equal(player.screen(q).cue, ready(asked).screen(q).cue)
