"""`planner plan`: the stroke for a scene."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Progress, Status, table, write_json
from models.commands.options import (
    FILE_PATH,
    Number,
    effects_option,
    gathered,
    given,
    input_option,
    out_option,
    output_option,
    seed_option,
)
from models.errors import BadInput
from planner.cli.common import execution_option, load_execution, load_model, model_option
from sysid.cli.common import print_recording

if TYPE_CHECKING:
    from models.model_file import Model
    from planner.evaluation.value import UtilityWeights
    from planner.launcher.execution import Execution
    from planner.launcher.stroke import LauncherModel


@dataclass(frozen=True)
class Hardware:
    """Options of the launcher: repeatability, cueing map, bounds on the cue's speed [m/s]."""

    execution_file: Path | None = given(execution_option)
    map_file: Path | None = given(
        input_option("map", "MAP.toml", "Cueing map of the launcher, made with: robot map; by default a regular cue's.")
    )
    cue_speed: tuple[float, float] | None = given(
        "--cue-speed", "LOW HIGH", "Bounds on the cue's speed [m/s].", float, nargs=2
    )

    def launcher(self, model: Model) -> tuple[LauncherModel, Execution | None]:
        """The launcher and its repeatability, which includes the uncertainty of its map."""
        from planner.launcher.stroke import LauncherModel, with_speeds

        launcher = LauncherModel()
        if self.cue_speed:
            slow, fast = self.cue_speed
            if not launcher.last <= slow < fast <= launcher.first:
                raise BadInput(
                    f"--cue-speed {slow:g} {fast:g}: give two speeds within {launcher.last:g} to {launcher.first:g} m/s"
                )
            launcher = with_speeds(launcher, slow, fast)
        from planner.launcher.mapped import execution_of, usual_launcher, with_map

        if not self.map_file:
            return usual_launcher(model, launcher), None
        from planner.launcher.cueing_map import read_map

        cueing_map = read_map(self.map_file)
        return with_map(launcher, cueing_map, model.ball), None if self.execution_file else execution_of(cueing_map)


@dataclass(frozen=True)
class Utility:
    """Options of the outcomes' weights, in pots."""

    rest_weight: float = given(
        "--rest-weight", "W", "Part of a pot's value that depends on where the cue ball stops.", Number(0, 1), 0.2
    )
    far: float = given(
        "--far",
        "D",
        "Distance from the wanted place at which the part of --rest-weight falls to 1/e [m].",
        Number(1e-3, 10),
        0.35,
    )
    foul_cost: float = given("--foul-cost", "C", "Cost of a foul, in pots.", Number(0, 100), 0.5)

    def weights(self) -> UtilityWeights:
        """The weights for the evaluation of plans."""
        from planner.evaluation.value import UtilityWeights

        return UtilityWeights(self.rest_weight, self.far, self.foul_cost)


@dataclass(frozen=True)
class Search:
    """Options of the search."""

    method: str = given(
        "--method", "", "risk: over errors of launcher and model; ga: the published genetic search, on the nominal "
        "model.", click.Choice(["risk", "ga"]), "risk",
    )  # fmt: skip
    seed: int = given(seed_option(), default=0)


@dataclass(frozen=True)
class PlanOutputs:
    """Options of the output files."""

    out: Path = given(out_option("PLAN.json", "File for the plan."))
    report_file: Path | None = given(output_option("report", "FILE.html", "Write the plan with pictures."))
    picture_file: Path | None = given(output_option("picture", "FILE.png", "Draw the table from above."))
    rrd_file: Path | None = given(output_option("rrd", "FILE.rrd", "Write the plan as a recording for Rerun."))


@click.command()
@click.argument("scene", metavar="SCENE.toml", type=FILE_PATH)
@model_option
@gathered("hardware", Hardware)
@gathered("search", Search)
@gathered("utility", Utility)
@gathered("outputs", PlanOutputs)
@effects_option()
@click.pass_obj
def plan(
    progress: Progress, scene: Path, model_file: Path | None, hardware: Hardware, search: Search,
    utility: Utility, outputs: PlanOutputs,
) -> int:  # fmt: skip
    """Plan the stroke for a scene, in physical units and as the launcher's command.

    Reads a scene file and a fitted model. Writes the plan, and prints the stroke with its probabilities and the
    alternatives. Status 1 if no shot is reasonable.

    Example: planner plan scene.toml --model fitted.toml --out plan.json
    """
    from planner.planning import make_plan
    from planner.scene import read_scene
    from sysid.clips.trust import tell_doubts

    asked = read_scene(scene)
    tell_doubts(scene, asked.camera_doubts)
    model = load_model(model_file, asked)
    launcher, execution = hardware.launcher(model)
    execution = execution or load_execution(hardware.execution_file, model)
    started = time.monotonic()
    made = make_plan(
        asked, model, execution, utility.weights(), method=search.method, seed=search.seed, launcher=launcher
    )
    progress.close()
    made["model"]["file"] = model_file.name if model_file else None
    write_json(outputs.out, made)
    print_plan(made)
    print(f"plan: {outputs.out} ({time.monotonic() - started:.1f} s)")
    _draw(outputs, made, f"A shot for {scene.name}")
    return Status.DONE if made["stroke"] else Status.FINDING


def _draw(outputs: PlanOutputs, made: dict[str, Any], title: str) -> None:
    """Write report, picture and recording on request."""
    if outputs.report_file:
        from planner.report import write_report

        write_report(outputs.report_file, made, title)
        print(f"report: {outputs.report_file}")
    if outputs.picture_file:
        from planner.report import write_picture

        write_picture(outputs.picture_file, made)
        print(f"picture: {outputs.picture_file}")
    if outputs.rrd_file:
        from models.recording.plan import write_plan

        write_plan(outputs.rrd_file, made, title=title)
        print_recording(outputs.rrd_file)


def print_plan(made: dict[str, Any]) -> None:
    """Print a plan in words and figures."""
    from planner.words import STROKE_HEADS, plan_lines, stroke_rows

    print("\n".join(plan_lines(made)))
    if rows := stroke_rows(made):
        print(table([STROKE_HEADS, *rows]))
        print("rest: median distance of the cue ball's end point from the wanted place, or else from its mean")
