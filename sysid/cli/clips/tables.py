"""Options that name a table: --table by name or size, --ball-diameter, --no-pockets, --mass."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING

import click

from models.commands.options import Number, given
from models.errors import BadInput
from sysid.cli.common import mass_option

if TYPE_CHECKING:
    from models.shot import Table
    from models.table.presets import TableSet

TABLE_HELP = 'Table by name (snooker, "pool 8 ft" or 8ft, carom, ...) or size, nose to nose [m].'
diameter_option = click.option(
    "--ball-diameter", "--diameter", "diameter", metavar="D", type=Number(0.015, 0.12, unit="metres"),
    help="Diameter of the balls [m]; a named table implies it.",
)  # fmt: skip


@dataclass(frozen=True)
class TableOptions:
    """A table and its balls, by name or by size."""

    table_name: str | None = given("--table", "NAME|LxW", TABLE_HELP)
    diameter: float | None = given(diameter_option)
    no_pockets: bool = given("--no-pockets", "", "The table has no pockets.", bool)
    mass: float | None = given(mass_option)

    def table_set(self) -> TableSet:
        """Table and balls; BadInput if --table is missing, or is a size without a ball diameter."""
        if self.table_name is None:
            raise BadInput('--table is missing: give a name, such as "pool 8 ft", or a size, such as 3.569x1.778')
        return table_set(self.table_name, self.diameter, self.mass, self.no_pockets)


def table_set(name: str, diameter: float | None, mass: float | None, no_pockets: bool) -> TableSet:
    """A table by name or size, with its own balls or the given ones: see `usual_mass`."""
    from models.shot import Ball
    from models.table.presets import TableSet, find_table, usual_mass

    try:
        found = find_table(name)
    except BadInput as error:
        raise BadInput(f"--table {error}") from None
    known = found.ball if isinstance(found, TableSet) else None
    if diameter is None and known is None:
        raise BadInput(f"--table {name}: a size does not determine the balls; give --ball-diameter, such as 0.0525")
    table: Table = found.table if isinstance(found, TableSet) else found
    size = diameter if diameter is not None else known.diameter if known else 0.0
    if mass is None:
        mass = known.mass if known is not None and known.diameter == size else usual_mass(size)[0]
    pockets = False if no_pockets else table.pockets
    return TableSet(dataclasses.replace(table, pockets=pockets), Ball(size, mass))
