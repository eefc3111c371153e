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
from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
from models.model_file import full_model
from models.shot import Shot
from models.simulation.simulate import simulate
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from planner.launcher.stroke import launch
from planner.search.search import Effort
from robot.learning.blocks import pot_count
from robot.learning.chosen import chosen_shots
from robot.learning.history import fit_folder, predicted_stop
from tests.robot.test_learn import shot, story

MODEL = full_model(SNOOKER_TABLE, SNOOKER_BALL)
MAP = CueingMap(Constants(), Geometry(SNOOKER_BALL), np.full((8, 8), math.nan), Execution())
NAMES = ("white", "red")
CUE = {"speed": 1.5, "azimuth": 0.4, "side": 0.004, "height": -0.003, "elevation": 0.0}
EFFORT = Effort(fresh=32, checked=4)


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


def test_the_shots_that_a_refit_asks_for_come_in_its_order(folder: Path) -> None:
    alone, pair, edge = chosen_shots(folder, 10, MODEL, MAP, NAMES, 5)
    assert [one.why for one in (alone, pair, edge)] == ["to separate table_tilt from cloth_nap"] * 3
    assert alone.stroke.tolist() == [1.5, 0.4, 0.004, -0.003] and edge.stroke[2] == 0.025
    assert pair.scene.position.tolist() == [[0.2, -0.3], [0.6, -0.1]] and pair.scene.names == NAMES
    assert len(chosen_shots(folder, 10, MODEL, MAP, NAMES, 2)) == 2
    assert chosen_shots(folder, 0, MODEL, MAP, NAMES, 2) == [], "no refit has asked for any"
    assert chosen_shots(folder, 20, MODEL, MAP, NAMES, 0) == [], "none is wanted, and no file is read"


def test_a_shot_of_the_cue_ball_alone_meets_no_other(folder: Path) -> None:
    scene = chosen_shots(folder, 10, MODEL, MAP, NAMES, 1)[0].scene
    velocity, spin = launch(np.array([[1.5, 0.4, 0.004, -0.003]]), 0.0, SNOOKER_BALL)
    still = np.zeros((1, 2)), np.zeros((1, 3))
    played = Shot(
        NAMES, scene.position, np.concatenate([velocity, still[0]]), np.concatenate([spin, still[1]]),
        np.arange(0, 12, 0.05),
    )  # fmt: skip
    assert all(e.kind != "ball" for e in simulate(MODEL, [played])[0].events)


def test_its_plan_plays_the_stroke_and_says_why(folder: Path) -> None:
    _, pair, edge = chosen_shots(folder, 10, MODEL, MAP, NAMES, 3)
    moved = dataclasses.replace(pair.scene, position=pair.scene.position + np.array([[0.003, 0.0], [0.0, -0.002]]))
    plan = pair.plan(moved, MODEL, MAP, 1, EFFORT)
    assert plan["method"] == "given" and plan["why"] == pair.why
    assert plan["stroke"]["speed"] == pytest.approx(1.5, abs=0.02), "the nearest string"
    assert plan["stroke"]["azimuth"] == pytest.approx(0.4, abs=1e-6)
    assert plan["scene"]["balls"]["white"] == pytest.approx([0.203, -0.3]), "where the camera sees it"
    assert plan["launcher"]["string"].endswith("p") and plan["pocket"] is None
    assert np.isfinite(predicted_stop(plan)[0]).all()
    assert plan == pair.plan(moved, MODEL, MAP, 1, EFFORT)
    nearest = edge.plan(edge.scene, MODEL, MAP, 1, EFFORT)["stroke"]["side"]
    assert 0.3 * SNOOKER_BALL.radius < nearest < 0.5 * SNOOKER_BALL.radius, "farther out the tip slips"


def test_a_result_that_cannot_be_read_is_named(folder: Path) -> None:
    path = fit_folder(folder, 10) / "result.json"
    path.write_text(json.dumps({"format": "billiard-discovery/1", "next_shots": [asked(cue={"speed": "edge"})]}))
    with pytest.raises(BadInput, match=r"result\.json"):
        chosen_shots(folder, 10, MODEL, MAP, NAMES, 1)


def test_what_is_played_to_pot_is_told_without_them() -> None:
    told = story((0.1, 0.02))
    chosen = shot(5, 3.0, plan={"method": "given"}, potted=False, pot_probability=0.0)
    seen = dataclasses.replace(told, shots=(*told.shots[:4], chosen, *told.shots[5:]))
    assert seen.median_miss(5, 8) == told.median_miss(6, 8) and math.isnan(seen.median_miss(5, 5))
    assert pot_count(seen, (5, 8)) == pot_count(told, (6, 8))
