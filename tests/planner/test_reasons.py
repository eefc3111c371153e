"""The reasons that a plan states for its stroke."""

from __future__ import annotations

import dataclasses

from planner.evaluation.risk import draw_errors, evaluate
from planner.evaluation.value import UtilityWeights
from planner.launcher.execution import Execution
from planner.reasons import reasons
from planner.search.candidates import open_routes
from planner.search.search import RankedStroke
from tests.support.planned_shots import ready, straight, stroke


def test_the_utility_that_ranks_strokes_is_the_one_that_is_reported() -> None:
    player, weights = ready(straight()), UtilityWeights()
    rows = stroke(1.5).repeat(2, axis=0)
    first, second = evaluate(player, draw_errors(player.model, Execution(), 4, 0), rows, weights)
    [route, *_], engines = open_routes(player.scene), {"plays": 4, "events": 0.5, "mujoco": 1.0}
    first, second = (dataclasses.replace(one, value=value) for one, value in ((first, 0.832), (second, 0.845)))
    ranked = [RankedStroke(route, first, engines, 0.375), RankedStroke(route, second, engines, 0.0)]
    said = reasons(player, ranked, weights)
    assert said.startswith("The highest expected utility, 0.832 in the event engine and 0.375 more in MuJoCo (only the")
    assert "cue ball over" in said and ", with 0.845. Of 4 plays" in said
