"""A series of strokes made up: its course, shots and refits."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from models.analytic.cue_impulse import Constants, Geometry
from models.model_file import full_model
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import Execution
from planner.scene import Goal, Scene
from robot.learning.emulated_rig import EmulatedRig, draw_hidden_cue, draw_hidden_table
from robot.learning.history import History, PlayedShot, Refit
from robot.learning.loop import LearningConfig

MODEL = full_model(SNOOKER_TABLE, SNOOKER_BALL)
MAP = CueingMap(Constants(), Geometry(SNOOKER_BALL), np.full((8, 8), math.nan), Execution())
COURSE = LearningConfig(MODEL, MAP, shots=8, every=4)
SCENE = Scene(
    SNOOKER_TABLE, SNOOKER_BALL, ("white", "red"), np.array([[0.0, 0.0], [0.5, 0.2]]),
    Goal("white", "red", (1, 1), np.array([1.0, 0.3])),
)  # fmt: skip


def shot(number: int, miss: float, spread: float = 0.018, every: int = 4, **change: Any) -> PlayedShot:
    """A shot whose cue ball stopped `miss` [m] from where it was told to; nan: in a pocket."""
    end = None if math.isnan(miss) else np.array([0.3 + miss, 0.1])
    away = None if end is None else miss + 0.1
    made = PlayedShot(
        number, SCENE, (number - 1) // every * every, np.array([0.3, 0.1]), spread, 0.8, True, end, 0.018, {},
        {"from_wanted": away}, None,
    )  # fmt: skip
    return dataclasses.replace(made, **change)


def refit(shots: int, verdict: tuple[str, ...] = ("table_tilt",), **change: Any) -> Refit:
    return dataclasses.replace(Refit(shots, verdict, "", 5e-4, 5e-4, 1.0, {}, {}, 30.0), **change)


def story(
    blocks: Sequence[float], every: int = 4, verdicts: Sequence[tuple[str, ...]] | None = None, ended: str = ""
) -> History:
    """Blocks of shots with these median misses [m], a refit after each."""
    shots = []
    for k, middle in enumerate(blocks):
        around = middle * np.linspace(0.5, 1.5, every)
        shots += [shot(k * every + j + 1, float(m), every=every) for j, m in enumerate(around)]
    told = verdicts or [("table_tilt",)] * len(blocks)
    refits = tuple(refit((k + 1) * every, v) for k, v in enumerate(told))
    return History({}, tuple(shots), refits, ended)


TRUE = draw_hidden_cue(np.random.default_rng(11))
RESULT = {
    "format": "billiard-discovery/1", "verdict": ["table_tilt"], "unexplained": None, "next_shots": [],
    "ladder": [{"rms_m": 5e-4, "held_out_rms_m": None, "chi2_reduced": 1.0}],
    "parameters": {"decoupled_cloth.roll": {"value": 0.0125, "sd": 1e-5, "unit": "1"}},
}  # fmt: skip


STAND = EmulatedRig(draw_hidden_table(MODEL, np.random.default_rng(3), "table_tilt"), TRUE)


def series(batches: list[Any], name: str) -> dict[int, list[Any]]:
    """Rows of a column by shot."""
    found: dict[int, list[Any]] = {}
    for batch in batches:
        for label in (label for label in batch.schema.names if label.endswith(name)):
            for shot, row in zip(batch["shot"].to_pylist(), batch[label].to_pylist(), strict=True):
                found.setdefault(shot, []).append(row)
    return found
