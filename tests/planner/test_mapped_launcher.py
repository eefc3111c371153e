"""A launcher with its cueing map: what is planned is what comes of what is told."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from models.analytic.cloth import rolling_velocity
from models.analytic.cue_impulse import CONSTANT_NAMES, Geometry, launch
from models.errors import BadInput
from models.model_file import full_model
from models.mujoco.struck import TipStroke, play_struck
from models.shot import Array, Ball, Table
from planner.evaluation.play import Player
from planner.evaluation.risk import draw_errors
from planner.example_environment import example_scene
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from planner.launcher.mapped import execution_of, usual_launcher, with_map
from planner.launcher.stroke import LauncherModel
from tests.support.planned_shots import TRUE

BALL = Ball(0.0525, 0.1406)
GEOMETRY = Geometry(BALL)
MODEL = full_model(Table(3.569, 1.778), BALL)
MAP = CueingMap(TRUE, GEOMETRY, np.full((8, 8), np.nan), Execution())


def test_a_mapped_launcher_plays_what_it_can_be_told() -> None:
    """Strings and stage steps of the terms give velocity and spin of the stroke, by the balance of impulses itself."""
    launcher = with_map(LauncherModel(), MAP, BALL)
    rng = np.random.default_rng(3)
    q = np.column_stack([rng.uniform(0.6, 2.4, 40), rng.uniform(-3, 3, 40), *(0.009 * rng.uniform(-1, 1, (2, 40)))])
    assert 0.38 < launcher.offset < 0.46, "the slate holds some of the draw back"
    q = launcher.playable(launcher_within(launcher, q), BALL)
    assert launcher.playable(q, BALL) == pytest.approx(q, abs=1e-9), "what can be told stays as it is"
    for row in q:
        told = launcher.command(MODEL, row)
        cue_speed = launcher.cue_speed(int(told["string"][:3]))
        assert told["cue_speed"] == pytest.approx(cue_speed, rel=1e-7)
        assert round(told["x0_mm"] * 10) == pytest.approx(told["x0_mm"] * 10, abs=1e-6), "whole steps of the stage"
        place = (np.array([v]) for v in (cue_speed, 1e-3 * told["x0_mm"], 1e-3 * told["y0_mm"]))
        velocity, spin = (v[0] for v in launch(TRUE, GEOMETRY, *place))
        c, t = math.cos(told["theta"]), math.sin(told["theta"])
        about = np.array([[c, -t, 0], [t, c, 0], [0, 0, 1]])
        planned = [v[0] for v in launcher.launch(row[None], BALL)]
        assert (about @ velocity)[:2] == pytest.approx(planned[0], abs=1e-6)
        off = about @ spin - planned[1]
        assert abs(off[2]) < 1e-6 * np.linalg.norm(spin)
        assert BALL.radius * np.linalg.norm(off) < 0.002 * row[0], "about the aim it is interpolated"


def launcher_within(launcher: LauncherModel, q: Array) -> Array:
    """Strokes (n, 4) drawn back to its limit."""
    off = np.hypot(q[:, 2], q[:, 3]) / (launcher.offset * BALL.radius)
    return np.column_stack([q[:, :2], q[:, 2:] / np.maximum(1.0, off)[:, None]])


def test_a_map_of_other_balls_is_refused() -> None:
    with pytest.raises(BadInput, match=r"the cueing map is for balls of 52\.5 mm, 140\.6 g, the scene's have 57\.2 mm"):
        with_map(LauncherModel(), MAP, Ball(0.0572, 0.17))


def test_what_the_map_leaves_open_is_one_more_error() -> None:
    assert execution_of(MAP) == MAP.execution, "nothing is known of it"
    covariance = np.zeros((8, 8))
    k = CONSTANT_NAMES.index("aim_zero")
    covariance[k, k] = 3e-3**2  # turns every stroke alike
    wide = execution_of(dataclasses.replace(MAP, covariance=covariance))
    assert wide.azimuth_sd == pytest.approx(math.hypot(MAP.execution.azimuth_sd, 3e-3), rel=1e-3)
    assert dataclasses.replace(wide, azimuth_sd=MAP.execution.azimuth_sd) == MAP.execution
    k = CONSTANT_NAMES.index("tip_restitution")
    covariance[k, k] = 0.0171**2  # 1 % of 1 + e
    wide = execution_of(dataclasses.replace(MAP, covariance=covariance))
    assert wide.speed_sd == pytest.approx(math.hypot(MAP.execution.speed_sd, 0.01), rel=0.1)


def test_the_tip_plays_what_a_plan_assumes() -> None:
    """Draw and follow with side: errors of the ball once, and the direction in which it rolls in the end."""
    scene = example_scene()
    player = Player(MODEL, scene, usual_launcher(MODEL))
    q = np.array([[1.5, 0.3, side, height] for side in (-0.006, 0.006) for height in (-0.006, 0.007)])
    samples = draw_errors(MODEL, Execution(), 4, 5)
    _, made = samples.strike(player, q)
    assert np.abs(made.azimuth).max() < 1.2e-3, "the tolerance of the tip's squirt, and none of the errors"
    assert made.spin.max() < 0.04
    velocity, spin = player.launcher.launch(q, BALL)
    struck = play_struck(
        MODEL, {"white": scene.position[0]}, [TipStroke(*map(float, tip)) for tip in player.mapped().tip_strokes(q)],
        [np.array([0.0, 0.01])] * len(q), device=player.mapped().device,
    )[1]  # fmt: skip
    for v, w, stroke in zip(velocity, spin, struck, strict=True):
        one, other = (rolling_velocity(a[:2], b, BALL.radius) for a, b in ((v, w), (stroke.velocity, stroke.spin)))
        assert math.atan2(one[1], one[0]) == pytest.approx(math.atan2(other[1], other[0]), abs=1e-3)
