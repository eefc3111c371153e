"""Shots chosen for learning: those that separate the models that are still likely.

In: `next_shots` of a refit's result.json (sysid/selection/next_shot.py). Out: a scene, and the stroke in it. They are
played first after the refit; if a shot needs the cue ball alone, the object ball is placed out of the way.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from models.files import entries_of
from models.model_file import Model
from models.shot import Array
from planner.evaluation.play import Player
from planner.launcher.stroke import LauncherModel
from planner.scene import Goal, Scene, separate_overlaps
from robot.learning.history import FOLDER_REMEDY, fit_folder, read_json

RESULT_FORMAT = "billiard-discovery/1"
PLACES_ALONG, PLACES_ACROSS = 7, 4  # grid of places for an object ball that is not to be hit


@dataclass(frozen=True)
class ChosenShot:
    """A scene and the stroke in it."""

    scene: Scene
    stroke: Array  # (4,), see planner/launcher/stroke.py
    why: str


def chosen_shot(
    folder: Path, learnt: int, turn: int, most: int, model: Model, launcher: LauncherModel, names: Sequence[str]
) -> ChosenShot | None:
    """The next shot proposed by the refit after `learnt` shots; None if there is none left.

    Args:
        folder: of the series.
        learnt: number of shots fitted; 0 for no refit.
        turn: 0 for the most informative one.
        most: largest number of chosen shots after a refit.
        model: fitted to those shots.
        launcher: that plays the shot.
        names: of the cue ball and of the object ball.

    Raises:
        BadInput: for an unreadable result.
    """
    if not learnt or turn >= most:
        return None
    path = fit_folder(folder, learnt) / "result.json"
    asked = read_json(path, RESULT_FORMAT).get("next_shots") or []
    with entries_of(path, FOLDER_REMEDY):
        return _shot(asked[turn], model, launcher, names) if turn < len(asked) else None


def _shot(asked: dict[str, Any], model: Model, launcher: LauncherModel, names: Sequence[str]) -> ChosenShot | None:
    """A shot from an entry of result.json; None if the object ball would be in the way everywhere."""
    cue, ball = asked["cue"], np.array(asked["ball"], float)
    stroke = np.array([float(cue[key]) for key in ("speed", "azimuth", "side", "height")])
    goal, why = Goal(names[0], names[1], None), str(asked["why"])

    def scene(other: Array) -> Scene:
        places = separate_overlaps(np.array([ball, other]), model.table, model.ball)
        return Scene(model.table, model.ball, (names[0], names[1]), places, goal)

    if asked["other"] is not None:
        return ChosenShot(scene(np.array(asked["other"], float)), stroke, why)
    room = model.table.centre_limits(model.ball)
    grid = itertools.product(
        np.linspace(-0.9, 0.9, PLACES_ALONG) * room[0], np.linspace(-0.9, 0.9, PLACES_ACROSS) * room[1]
    )
    best, widest = None, 2 * model.ball.radius
    for place in grid:
        other = scene(np.array(place))
        track = Player(model, other, launcher).tracks(stroke[None])[0]
        way = track.position[np.isfinite(track.position[:, 0, 0]), 0]
        gap = float(np.hypot(*(way - other.position[1]).T).min())
        if gap > widest:
            best, widest = other, gap
    return None if best is None else ChosenShot(best, stroke, why)
