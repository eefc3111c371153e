"""Scenes on a snooker table, ready to be played or planned."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from models.analytic.cue_impulse import Constants
from models.model_file import Estimate, Model, full_model
from models.shot import Array, Ball, Table
from planner.evaluation.play import Player
from planner.launcher.stroke import SPEED, LauncherModel
from planner.scene import Goal, Scene

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
R = BALL.radius
HALF = np.array([TABLE.length, TABLE.width]) / 2
MODEL = full_model(TABLE, BALL)
DIAGONAL = math.pi / 4
AWAY = np.array([math.cos(DIAGONAL), math.sin(DIAGONAL)])  # towards the corner +x +y
ROLL, SLIDE = "decoupled_cloth.roll", "decoupled_cloth.slide"


def scene(white: Any, red: Any, *others: Any, pocket: Any = None, rest: Any = None, **goal: Any) -> Scene:
    """White, red and balls named b0, b1, ..."""
    names = ("white", "red", *(f"b{k}" for k in range(len(others))))
    place = None if rest is None else np.array(rest, float)
    return Scene(TABLE, BALL, names, np.array([white, red, *others], float), Goal(*names[:2], pocket, place, **goal))


def straight(near: float = 0.5, far: float = 0.4, *others: Any, **goal: Any) -> Scene:
    """The red `near` [m] from the corner +x +y, the white `far` behind it on the same line."""
    red = HALF - near * AWAY
    return scene(red - far * AWAY, red, *others, **goal)


def ready(asked: Scene, model: Model = MODEL) -> Player:
    return Player(model, asked, LauncherModel())


def stroke(speed: float, azimuth: float = DIAGONAL, side: float = 0.0, height: float = 0.0) -> Array:
    """One stroke (1, 4), the tip's offsets in radii."""
    return np.array([[speed, azimuth, side * R, height * R]])


def strokes(n: int, seed: int) -> Array:
    """Strokes anywhere, that the launcher can play."""
    rng, launcher = np.random.default_rng(seed), LauncherModel()
    off, turned = launcher.offset * R * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    q = np.stack([np.ones(n), rng.uniform(-np.pi, np.pi, n), off * np.cos(turned), off * np.sin(turned)], axis=1)
    q[:, SPEED] = rng.uniform(launcher.slowest, launcher.fastest, n) * launcher.gain(q, BALL)
    return q


def fitted(correlation: float = 0.8, sd: float = 1.0) -> Model:
    """A model whose slide and roll were fitted together."""
    estimates = {SLIDE: Estimate(0.004 * sd), ROLL: Estimate(0.0004 * sd), "ball_impact.friction": Estimate(math.nan)}
    told = {"names": [ROLL, SLIDE], "correlation": [[1.0, correlation], [correlation, 1.0]]}
    return dataclasses.replace(MODEL, estimates=estimates, fitted=told)


TRUE = Constants(0.71, 0.56, 0.0062, 0.24, 9e-4, 4e-4, -3e-4, 2e-3)
