"""A plan of a straight shot for the launcher, and what becomes of it."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from models.model_file import full_model
from models.shot import Ball, Table
from planner.launcher.stroke import LauncherModel, stroke_terms
from planner.scene import Goal, Scene, scene_dict
from robot.device.settings import Settings
from robot.emulator.firmware import Firmware

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
MODEL = full_model(TABLE, BALL)
OURS = Settings()
CORNER = np.array([TABLE.length, TABLE.width]) / 2
REST = (1.0, 0.3)


def straight_plan(path: Path, *, speed: float = 1.6, side: float = 0.0, height: float = -0.008, **change: Any) -> Path:
    """A straight pot with draw into the corner +x +y, as the planner writes it; `change` goes over the launcher's."""
    away = np.array([math.cos(math.pi / 4), math.sin(math.pi / 4)])
    red = CORNER - 0.4 * away
    place = np.array([red - 0.4 * away, red, [-1.0, -0.3]])
    scene = Scene(TABLE, BALL, ("white", "red", "blue"), place, Goal("white", "red", (1, 1), np.array(REST), 0.05))
    q = LauncherModel().playable(np.array([[speed, math.pi / 4, side, height]]), BALL)[0]
    plan: dict[str, Any] = {
        "format": "billiard-plan/1", "scene": scene_dict(scene), "stroke": stroke_terms(LauncherModel(), q),
        "launcher": LauncherModel().command(MODEL, q) | change,
    }  # fmt: skip
    path.write_text(json.dumps(plan))
    return path


def struck(device: Firmware) -> list[Any]:
    return [action for action in device.actions if action.what == "struck"]
