"""`sysid init`: a clip set to fill in."""

from __future__ import annotations

import shlex
from pathlib import Path

import click

from models.commands.console import Status, as_called
from models.commands.options import FILE_PATH, gathered
from models.errors import BadInput
from sysid.cli.clips.tables import TableOptions


@click.command()
@click.argument("folder", metavar="DIR", type=FILE_PATH)
@gathered("sizes", TableOptions)
def init(folder: Path, sizes: TableOptions) -> int:
    """Write a clip set to fill in, every entry explained.

    Makes DIR with clips.toml and one clip as an example; sysid check DIR passes on it.

    Example: sysid init CLIPS --table "pool 8 ft"
    """
    from models.table.presets import TABLE_SETS
    from sysid.clips.template import EXAMPLE_FILE, write_template

    known = sizes.table_set()
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(f"{folder}: already exists; choose another folder")
    names = [name for name, one in TABLE_SETS.items() if one.table == known.table]
    write_template(folder, known, names[0] if names else None)
    shown = shlex.quote(str(folder))
    print(f"{folder}: clips.toml and {EXAMPLE_FILE}")
    print(
        f"next: write your shots beside the example, name them in clips.toml, then: {as_called(f'sysid check {shown}')}"
    )
    return Status.DONE
