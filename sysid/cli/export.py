"""`sysid export`: a fitted table for other programs."""

from __future__ import annotations

from pathlib import Path

import click

from models.commands.console import Progress, Status
from models.commands.options import FILE_PATH, effects_option, out_option
from models.errors import BadInput


@click.command()
@click.argument("model", metavar="MODEL", type=FILE_PATH)
@out_option("T.xml", "File for the MJCF, or the system.")
@click.option(
    "--to", "target", type=click.Choice(["mjcf", "pooltool"]), default="mjcf", show_default=True,
    help="For MuJoCo, or for pooltool 0.6: a system (JSON or MessagePack) and a file of its laws.",
)  # fmt: skip
@click.option("--balls", metavar="A,B,...", help="Balls by name, which sets their colours; by default a snooker frame.")
@click.option("--launcher", is_flag=True, help="Add the cue launcher behind the first ball.")
@click.option("--bare", is_flag=True, help="Leave out purely visual parts.")
@effects_option()
@click.pass_obj
def export(
    progress: Progress, model: Path, out: Path, target: str, balls: str | None, launcher: bool, bare: bool
) -> int:  # fmt: skip
    """Export a fitted table for other programs: as plain MJCF for any MuJoCo, or as a pooltool system.

    MODEL is a model file. The result needs no other file and none of our code: it has the model's sizes, masses, noses,
    pockets and slope, and MuJoCo's own contact terms, fitted to the model (some minutes). What this leaves out is
    printed in millimetres, and written at the head of the file.

    Example: sysid export out/demo/model.toml --out table.xml --balls white,red
    """
    from models.mjcf.export import places_of
    from models.model_file import read_model
    from sysid.mjcf.table import plain_table

    fitted = read_model(model).as_played()
    if target == "pooltool":
        from sysid.pooltool.export import export_pooltool

        if launcher or bare:
            raise BadInput(f"--{'launcher' if launcher else 'bare'} applies to MJCF only; omit it with --to pooltool")
        places = None if balls is None else places_of(fitted, balls.split(","))
        lines = export_pooltool(fitted, out, places)
        progress.close()
        print("\n".join(lines))
        return Status.DONE
    places = places_of(fitted, None if balls is None else balls.split(","))
    table = plain_table(fitted, places, launcher=launcher, bare=bare, origin=model.name)
    progress.close()
    table.save(out)
    print(f"{out}: a table for any MuJoCo, with {', '.join(places)}")
    print(table)
    return Status.DONE
