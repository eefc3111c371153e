"""Throw of pool balls, as both engines play it, against Alciatore's technical proof A.14."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models.effect_catalogue import effect_class
from models.model_file import full_model
from models.shot import Shot, Table
from models.simulation.simulate import simulate
from models.table.presets import POOL_BALL
from tests.reference.ball_ball import THROW

SPEEDS = (0.447, 1.341, 3.129)  # 1, 3 and 7 mph
CUTS = (30, 45)
LAW = {"ball_impact.restitution": 1.0, "ball_impact.friction": 0.009951}
MAX_RMS_DEG = 0.25


def cut_shot(cut: float, speed: float, rolls: bool) -> Shot:
    """A ball along x, almost at one that it will cut by an angle [deg]."""
    angle, radius = math.radians(cut), POOL_BALL.radius
    place = np.array([[0.0, 0.0], [2 * radius * math.cos(angle) + 1e-4, 2 * radius * math.sin(angle)]])
    velocity, spin = np.array([[speed, 0.0], [0.0, 0.0]]), np.zeros((2, 3))
    spin[0, 1] = speed / radius if rolls else 0.0
    return Shot(("cue", "object"), place, velocity, spin, np.array([0.0, 0.004 / speed]))


@pytest.mark.parametrize("engine", ["events", "mujoco"])
def test_throw_is_that_of_friction_at_the_slip_with_which_the_impact_begins(engine: str) -> None:
    model = full_model(Table(100.0, 100.0, pockets=False), POOL_BALL).with_values(LAW)
    model = model.add(effect_class("ball_friction_speed")(gain=0.108, decay=1.088))
    cases = [(cut, rolls, speed) for cut in CUTS for rolls in (False, True) for speed in SPEEDS]
    table = {cut: (stun, roll) for cut, stun, roll in THROW}
    expected = [table[cut][rolls][SPEEDS.index(speed)] for cut, rolls, speed in cases]
    shots = [cut_shot(cut, speed, rolls) for cut, rolls, speed in cases]
    found = []
    for (cut, _, _), track in zip(cases, simulate(dataclasses.replace(model, engine=engine), shots), strict=True):
        found.append(cut - math.degrees(math.atan2(track.velocity[-1, 1, 1], track.velocity[-1, 1, 0])))
    rms = math.sqrt(np.mean((np.array(found) - expected) ** 2))
    assert rms < MAX_RMS_DEG, dict(zip(cases, zip(found, expected, strict=True), strict=True))
