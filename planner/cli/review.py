"""`planner review`: a plan in the Rerun viewer."""

from __future__ import annotations

from pathlib import Path

import click

from models.commands.console import Progress
from models.commands.options import FILE_PATH, gathered
from sysid.cli.viewing import Viewing


@click.command()
@click.argument("plan", metavar="PLAN.json", type=FILE_PATH)
@gathered("viewing", Viewing)
@click.pass_obj
def review(progress: Progress, plan: Path, viewing: Viewing) -> int:
    """Review a plan in the Rerun viewer: the shot, its possible outcomes, the alternatives.

    Shows the nominal shot, samples under the errors of launcher and model, the possible end points of the cue ball, and
    each alternative. The viewer listens to this machine alone.

    Example: planner review plan.json
    """
    from models.files import entries_of
    from models.recording.plan import write_plan
    from planner.planning import read_plan
    from sysid.clips.trust import tell_doubts

    viewing.check()
    made = read_plan(plan)
    with entries_of(plan, "make it anew with: planner plan"):
        tell_doubts(plan, made["scene"].get("camera_doubts", ()))

    def write(path: Path) -> None:
        with entries_of(plan, "make it again with: planner plan"):
            write_plan(path, made, title=f"The plan {plan.name}")

    return viewing.show(write, progress)
