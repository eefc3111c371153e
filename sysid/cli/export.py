"""`sysid export`: a fitted table for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from models.command_line import RESULT_FILE, effects_option
from models.console import Progress, Status


@click.command()
@click.argument("model", metavar="M.toml", type=RESULT_FILE)
@click.option("--out", metavar="T.xml", type=RESULT_FILE, required=True, help="Where the MJCF goes.")
@click.option("--balls", metavar="A,B,...", help="Names, which give the colours; by default a frame of snooker.")
@click.option("--launcher", is_flag=True, help="Add the cue launcher behind the first ball.")
@click.option("--bare", is_flag=True, help="Leave out what is only seen.")
@effects_option()
@click.pass_obj
def export(progress: Progress, model: Path, out: Path, balls: str | None, launcher: bool, bare: bool) -> int:
    """Export a fitted table as plain MJCF, for any MuJoCo.

    The file holds the model's sizes, masses, noses, pockets and slope, and MuJoCo's own contact terms, fitted to the
    model. What MJCF cannot say stands in its head, with what that costs in millimetres.

    Example: sysid export out/demo/model.toml --out table.xml --balls white,red
    """
    from models.files import write_whole
    from models.mjcf.export import places_of
    from models.model_file import read_model
    from sysid.plain_table import SECONDS, SHOTS, plain_table

    fitted = read_model(model).as_played()
    places = places_of(fitted, balls)
    table = plain_table(fitted, places, launcher=launcher, bare=bare, origin=model.name, report=progress)
    progress.close()
    write_whole(out, table.text.encode(), parents=True)
    print(f"{out}: what MJCF cannot say moves the struck ball within {SECONDS:g} s, median of {SHOTS} shots, by")
    for cost in table.costs:
        print(f"  {cost.median_m * 1000:7.1f} mm  {cost.cause}")
    return Status.DONE
