"""Options that name a table: everywhere the same names, with the table's own pockets and balls."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.errors import BadInput
from models.table.presets import TABLE_SETS
from sysid.cli.clips.calibrate import TableSize
from sysid.cli.clips.tables import TableOptions, table_set
from sysid.vision.camera.projection import read_camera, write_camera
from tests.support.table_views import over_table


@pytest.mark.parametrize("name", TABLE_SETS)
def test_a_named_table_keeps_its_pockets_and_balls(tmp_path: Path, name: str) -> None:
    meant = TABLE_SETS[name]
    found = TableOptions(name).table_set()
    assert found == meant
    table, diameter = TableSize(table_name=name).known()
    assert (table, diameter) == (meant.table, meant.ball.diameter)
    assert table_set(name, None, None, no_pockets=True).table.pockets is False
    camera = over_table()
    write_camera(tmp_path / "cam.toml", type(camera)(**{**vars(camera), "table": table}))
    assert read_camera(tmp_path / "cam.toml").table == table


def test_balls_of_another_size_weigh_as_much_more() -> None:
    plain, other = (table_set("carom", d, None, no_pockets=False).ball for d in (None, 0.0525))
    assert plain == TABLE_SETS["carom"].ball
    assert other.mass == pytest.approx(0.1406) and table_set("carom", 0.0525, 0.2, no_pockets=False).ball.mass == 0.2


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (TableSize(table_name="8ft", length=2.0), "omit --length"),
        (TableSize(length=2.0), "--width, --diameter missing"),
        (TableSize(length=1.0, width=2.0, diameter=0.05), "exchange"),
        (TableSize(table_name="2x1"), "give --ball-diameter"),
    ],
)
def test_tables_that_are_not_known_to_calibrate(options: TableSize, told: str) -> None:
    with pytest.raises(BadInput, match=told):
        options.known()


def test_a_table_must_be_told() -> None:
    with pytest.raises(BadInput, match="--table is missing"):
        TableOptions().table_set()
