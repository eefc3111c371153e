"""`robot align`: the stand turned by hand to a direction, while the camera shows how far it is off."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Status
from models.commands.options import gathered, input_option
from models.errors import BadInput
from robot.cli.common import RequiredFilming

if TYPE_CHECKING:
    from models.shot import Array
    from robot.camera.live import LiveCamera


def shown_aligned(camera: LiveCamera, azimuth: float, ball: Array | None) -> bool:
    """Show live how to turn the stand; returns whether it is aligned at the end."""
    from robot.camera.align import align as align_live
    from robot.camera.align import turn_for

    line = align_live(camera.pictures(), camera.seen_with, azimuth, ball)
    for note in line.noted:
        print(f"noted: {note}")
    turn = turn_for(line, azimuth)
    print(f"cue: {math.degrees(line.azimuth):.2f} +- {math.degrees(line.azimuth_sd):.2f} degrees, {turn}")
    return not turn.side


@click.command()
@gathered("filming", RequiredFilming)
@input_option("plan", "PLAN.json", "Plan whose direction is wanted.")
@click.option("--azimuth", metavar="DEG", type=float, help="Wanted direction in the table frame [degrees].")
def align(filming: RequiredFilming, plan_file: Path | None, azimuth: float | None) -> int:
    """Align the stand: show live from the camera how far to turn it.

    Takes the direction from --plan or --azimuth, and prints the remaining turn to a tenth of a degree. Status 1 if the
    cue does not point there at the end.

    Example: robot align --camera cam.toml --video 0 --plan plan.json
    """
    from planner.planning import read_plan
    from planner.scene import scene_from

    if (plan_file is None) == (azimuth is None):
        raise BadInput("give the direction: --plan PLAN.json, or --azimuth DEGREES")
    ball, wanted = None, azimuth
    if plan_file:
        plan = read_plan(plan_file)
        if plan.get("stroke") is None:
            raise BadInput(f"{plan_file}: holds no stroke ({plan.get('why', 'no reason given')}); plan another shot")
        launcher = plan.get("launcher")
        wanted = launcher.get("theta_deg") if isinstance(launcher, dict) else None
        ball = scene_from(plan.get("scene"), f"{plan_file} scene").position[0]
    if not isinstance(wanted, int | float):
        raise BadInput(f"{plan_file}: theta_deg of its launcher is {wanted!r}; make the plan again")
    if not abs(wanted) <= 360:
        raise BadInput(f"{plan_file or '--azimuth'}: the direction is {wanted:g}; give degrees, -360 to 360")
    with filming.open(Path("films")) as camera:
        return Status.DONE if shown_aligned(camera, math.radians(wanted), ball) else Status.FINDING


def in_degrees(azimuth: float) -> str:
    """A direction in words."""
    return f"{math.degrees(azimuth):.2f} degrees"
