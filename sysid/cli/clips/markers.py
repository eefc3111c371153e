"""`sysid markers`: a sheet of markers to print, for calibration where the noses cannot be seen."""

from __future__ import annotations

from pathlib import Path

import click

from models.commands.console import Status
from models.commands.options import out_option
from models.errors import BadInput
from sysid.cli.clips.tables import TABLE_HELP

PDF_SUFFIX = ".pdf"


@click.command()
@click.option("--table", "table_name", metavar="NAME|LxW", required=True, help=TABLE_HELP)
@out_option("FILE.pdf", "File for the sheet.")
def markers(table_name: str, out: Path) -> int:
    """Write a sheet of markers to print and lay on the cushions.

    Writes six cards on A4 at true scale, and a page that shows where to lay them. sysid calibrate reads them if at
    least four are in view.

    Example: sysid markers --table snooker --out markers.pdf
    """
    from models.table.presets import TableSet, find_table
    from sysid.vision import write_markers

    if out.suffix.lower() != PDF_SUFFIX:
        raise BadInput(f"{out}: the sheet is a PDF; end its name in {PDF_SUFFIX}")
    try:
        found = find_table(table_name)
    except BadInput as error:
        raise BadInput(f"--table {error}") from None
    write_markers(out, found.table if isinstance(found, TableSet) else found, table_name)
    print(f"sheet: {out} (print it at 100 %)")
    return Status.DONE
