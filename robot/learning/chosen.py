"""Shots that are chosen to learn from: those that part the models which the clips so far leave likely.

In: `next_shots` of a refit's result.json (sysid/selection/next_shot.py). Out: scenes, and plans of the strokes in them.
They come first after the refit; the object ball of a shot of the cue ball alone lies where it is not in the way.
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
from planner.launcher.cueing_map import CueingMap
from planner.launcher.mapped import execution_of, with_map
from planner.launcher.stroke import LauncherModel
from planner.planning import plan_of
from planner.scene import Goal, Scene, separate_overlaps
from planner.search.search import Effort
from robot.learning.history import FOLDER_REMEDY, fit_folder, read_json

RESULT_FORMAT = "billiard-discovery/1"
PLACES_ALONG, PLACES_ACROSS = 7, 4  # at which an object ball that is not to be met may lie


@dataclass(frozen=True)
class ChosenShot:
    """A scene and the stroke in it."""

    scene: Scene
    stroke: Array  # (4,), see planner/launcher/stroke.py
    why: str

    def plan(self, scene: Scene, model: Model, cueing_map: CueingMap, seed: int, effort: Effort) -> dict[str, Any]:
        """Its plan in the scene as the camera sees it, of the nearest stroke that the launcher can play."""
        launcher = with_map(LauncherModel(), cueing_map, model.ball)
        return plan_of(
            scene, model, self.stroke, self.why, execution_of(cueing_map), launcher, seed=seed, effort=effort
        )


def chosen_shots(
    folder: Path, learnt: int, model: Model, cueing_map: CueingMap, names: Sequence[str], most: int
) -> list[ChosenShot]:
    """The shots that the refit after `learnt` shots asks for, the best first, `most` at most.

    Args:
        folder: of the series.
        learnt: number of shots fitted; 0 for no refit.
        model: that was learnt from them.
        cueing_map: the same.
        names: of the cue ball and of the object ball.
        most: shots.

    Raises:
        BadInput: for a result that cannot be read.
    """
    if not learnt or not most:
        return []
    path = fit_folder(folder, learnt) / "result.json"
    told = read_json(path, RESULT_FORMAT).get("next_shots") or []
    with entries_of(path, FOLDER_REMEDY):
        shots = [_shot(one, model, cueing_map, names) for one in told]
    return [one for one in shots if one is not None][:most]


def _shot(told: dict[str, Any], model: Model, cueing_map: CueingMap, names: Sequence[str]) -> ChosenShot | None:
    """A shot as result.json tells it; None where the object ball is in the way wherever it lies."""
    cue, ball = told["cue"], np.array(told["ball"], float)
    stroke = np.array([float(cue[key]) for key in ("speed", "azimuth", "side", "height")])
    goal, why = Goal(names[0], names[1], None), str(told["why"])

    def scene(other: Array) -> Scene:
        places = separate_overlaps(np.array([ball, other]), model.table, model.ball)
        return Scene(model.table, model.ball, (names[0], names[1]), places, goal)

    if told["other"] is not None:
        return ChosenShot(scene(np.array(told["other"], float)), stroke, why)
    launcher = with_map(LauncherModel(), cueing_map, model.ball)
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
