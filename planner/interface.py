"""The Python interface `planner.plan`.

In: a `Scene`, and a `Model` or a result with one. Out: a `ShotPlan`, billiard-plan/1 as a dict that prints as text.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from models.interface import HasModel, model_of
from models.model_file import Model
from models.report.sheet import Picture, Presented, Sheet
from planner.planning import make_plan
from planner.scene import Scene
from planner.words import STROKE_HEADS, plan_lines, stroke_rows
from sysid.prepare import prepare

STROKE_COLUMNS = ("speed", "azimuth", "side", "height")  # columns of the data frame [m/s, rad, m, m]


class ShotPlan(Presented, dict[str, Any]):
    """A plan: the entries of billiard-plan/1."""

    def sheet(self) -> Sheet:
        """The best stroke, its alternatives, and the reasons, as text."""
        strokes = [self, *self["alternatives"]] if self["stroke"] else []
        columns: dict[str, list[Any]] = {"kind": [one["kind"] for one in strokes]}
        columns |= {name: [one["stroke"][name] for one in strokes] for name in STROKE_COLUMNS}
        for what in ("pot", "foul"):
            columns[f"{what}_probability"] = [one[f"{what}_probability"]["value"] for one in strokes]
        columns["rest_distance_median"] = [one["rest"]["distance_median"] for one in strokes]
        return Sheet(columns, STROKE_HEADS, tuple(stroke_rows(self)), tuple(plan_lines(self)))

    def plot(self) -> Picture:
        """Draw the table from above with planned and sampled paths."""
        from planner.report_figures import table_from_above

        return Picture("plan", *table_from_above(self))

    def report(self, path: Path | str, title: str = "A planned shot") -> None:
        """Write the plan as one HTML file; BadInput if it cannot be written."""
        from planner.report import write_report

        write_report(path, self, title)


def plan(scene: Scene, model: Model | HasModel, **options: Any) -> ShotPlan:
    """Plan a shot.

    Args:
        scene: balls and goal.
        model: fitted to the same table and ball, or a result with such a model.
        options: those of `planner.planning.make_plan`: execution, weights, method, seed, launcher, effort, threads.
    """
    prepare()
    return ShotPlan(make_plan(scene, model_of(model), **options))
