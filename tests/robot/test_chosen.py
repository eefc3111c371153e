"""Shots that are chosen to learn from: their scenes and plans, and that what is played to pot is told without them."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from models.analytic.cue_impulse import Constants, Geometry
from models.errors import BadInput
from models.model_file import full_model
from models.shot import Shot
from models.simulation.simulate import simulate
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from planner.launcher.mapped import execution_of, with_map
from planner.launcher.stroke import LauncherModel, launch
from planner.planning import plan_of
from planner.scene import Scene
from planner.search.search import Effort
from robot.learning.blocks import pot_count
from robot.learning.chosen import ChosenShot, chosen_shot
from robot.learning.history import fit_folder, predicted_stop
from tests.support.series_samples import shot, story

MODEL = full_model(SNOOKER_TABLE, SNOOKER_BALL)
MAP = CueingMap(Constants(), Geometry(SNOOKER_BALL), np.full((8, 8), math.nan), Execution())
NAMES = ("white", "red")
CUE = {"speed": 1.5, "azimuth": 0.4, "side": 0.004, "height": -0.003, "elevation": 0.0}
EFFORT = Effort(fresh=8, checked=2)
LAUNCHER = with_map(LauncherModel(), MAP, SNOOKER_BALL)


def asked(**change: Any) -> dict[str, Any]:
    """A shot as result.json tells it."""
    return {"why": "to separate table_tilt from cloth_nap", "cue": CUE, "ball": [0.2, -0.3], "other": None} | change


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A series whose refit after ten shots asks for three."""
    told = [asked(), asked(other=[0.6, -0.1]), asked(cue=CUE | {"side": 0.025})]
    out = fit_folder(tmp_path, 10)
    out.mkdir(parents=True)
    (out / "result.json").write_text(json.dumps({"format": "billiard-discovery/1", "next_shots": told}))
    return tmp_path


def chosen(folder: Path, turn: int) -> ChosenShot:
    """The shot in its turn."""
    one = chosen_shot(folder, 10, turn, 5, MODEL, LAUNCHER, NAMES)
    assert one is not None
    return one


def plan(one: ChosenShot, scene: Scene) -> dict[str, Any]:
    """Its plan in a scene as the camera sees it."""
    return plan_of(scene, MODEL, one.stroke, one.why, execution_of(MAP), LAUNCHER, seed=1, effort=EFFORT)


def test_the_shots_that_a_refit_asks_for_come_in_its_order(folder: Path) -> None:
    alone, pair, edge = (chosen(folder, turn) for turn in range(3))
    assert [one.why for one in (alone, pair, edge)] == ["to separate table_tilt from cloth_nap"] * 3
    assert alone.stroke.tolist() == [1.5, 0.4, 0.004, -0.003] and edge.stroke[2] == 0.025
    assert pair.scene.position.tolist() == [[0.2, -0.3], [0.6, -0.1]] and pair.scene.names == NAMES
    assert chosen_shot(folder, 10, 3, 5, MODEL, LAUNCHER, NAMES) is None, "it asks for no more"
    assert chosen_shot(folder, 10, 2, 2, MODEL, LAUNCHER, NAMES) is None, "no more are wanted"
    assert chosen_shot(folder, 0, 0, 2, MODEL, LAUNCHER, NAMES) is None, "no refit has asked for any"
    assert chosen_shot(folder, 20, 0, 0, MODEL, LAUNCHER, NAMES) is None, "none is wanted, and no file is read"


def test_a_shot_of_the_cue_ball_alone_meets_no_other(folder: Path) -> None:
    scene = chosen(folder, 0).scene
    velocity, spin = launch(np.array([[1.5, 0.4, 0.004, -0.003]]), np.zeros(1), SNOOKER_BALL)
    still = np.zeros((1, 2)), np.zeros((1, 3))
    played = Shot(
        NAMES, scene.position, np.concatenate([velocity, still[0]]), np.concatenate([spin, still[1]]),
        np.arange(0, 12, 0.05),
    )  # fmt: skip
    assert all(e.kind != "ball" for e in simulate(MODEL, [played])[0].events)


def test_its_plan_plays_the_stroke_and_says_why(folder: Path) -> None:
    pair, edge = chosen(folder, 1), chosen(folder, 2)
    moved = dataclasses.replace(pair.scene, position=pair.scene.position + np.array([[0.003, 0.0], [0.0, -0.002]]))
    made = plan(pair, moved)
    assert made["method"] == "given" and made["why"] == pair.why
    assert made["stroke"]["speed"] == pytest.approx(1.5, abs=0.02), "the nearest string"
    assert made["stroke"]["azimuth"] == pytest.approx(0.4, abs=1e-6)
    assert made["scene"]["balls"]["white"] == pytest.approx([0.203, -0.3]), "where the camera sees it"
    assert made["launcher"]["string"].endswith("p") and made["pocket"] is None
    assert np.isfinite(predicted_stop(made)[0]).all()
    assert made == plan(pair, moved)
    nearest = plan(edge, edge.scene)["stroke"]["side"]
    assert 0.3 * SNOOKER_BALL.radius < nearest < 0.5 * SNOOKER_BALL.radius, "farther out the tip slips"


def test_a_result_that_cannot_be_read_is_named(folder: Path) -> None:
    path = fit_folder(folder, 10) / "result.json"
    path.write_text(json.dumps({"format": "billiard-discovery/1", "next_shots": [asked(cue={"speed": "edge"})]}))
    with pytest.raises(BadInput, match=r"result\.json"):
        chosen_shot(folder, 10, 0, 1, MODEL, LAUNCHER, NAMES)


def test_what_is_played_to_pot_is_told_without_them() -> None:
    told = story((0.1, 0.02))
    one = shot(5, 3.0, plan={"method": "given"}, potted=False, pot_probability=0.0)
    seen = dataclasses.replace(told, shots=(*told.shots[:4], one, *told.shots[5:]))
    assert seen.median_miss(5, 8) == told.median_miss(6, 8) and math.isnan(seen.median_miss(5, 5))
    assert pot_count(seen, (5, 8)) == pot_count(told, (6, 8))
