"""`sysid export`: a fitted table for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from models.command_line import FILE_PATH, effects_option, out_option
from models.console import Progress, Status


@click.command()
@click.argument("model", metavar="MODEL", type=FILE_PATH)
@out_option("T.xml", "Where the MJCF goes.")
@click.option("--balls", metavar="A,B,...", help="Names, which give the colours; by default a frame of snooker.")
@click.option("--launcher", is_flag=True, help="Add the cue launcher behind the first ball.")
@click.option("--bare", is_flag=True, help="Leave out what is only seen.")
@effects_option()
@click.pass_obj
def export(progress: Progress, model: Path, out: Path, balls: str | None, launcher: bool, bare: bool) -> int:
    """Export a fitted table as plain MJCF, for any MuJoCo.

    MODEL is a model file. What is written needs no other file and no code of ours: sizes, masses, noses, pockets and
    slope of the model, and MuJoCo's own contact terms, fitted to it (some minutes). What that leaves out is printed, in
    millimetres, and stands in the head of the file.

    Example: sysid export out/demo/model.toml --out table.xml --balls white,red
    """
    from models.mjcf.export import places_of
    from models.model_file import read_model
    from sysid.mjcf.table import plain_table

    fitted = read_model(model).as_played()
    places = places_of(fitted, None if balls is None else balls.split(","))
    table = plain_table(fitted, places, launcher=launcher, bare=bare, origin=model.name)
    progress.close()
    table.save(out)
    print(f"{out}: a table for any MuJoCo, with {', '.join(places)}")
    print(table)
    return Status.DONE
