"""Scenes on a table by its name."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from models.errors import BadInput
from models.shot import Ball
from models.table.presets import POOL_BALL, TABLE_SETS
from planner.scene import read_scene, write_scene
from tests.support.plan_samples import TEXT


def test_a_table_by_name_stands_for_its_pockets_and_balls(tmp_path: Path) -> None:
    named = TEXT.replace("[table]\nlength = 3.569\nwidth = 1.778\n\n[ball]\ndiameter = 0.0525\nmass = 0.1406\n", "")
    head, rest = named.split("\n", 1)
    heavy = 'table = "9ft"\nball = { mass = 0.17 }', Ball(0.05715, 0.17)
    for text, ball in (('table = "pool 9 ft"', POOL_BALL), heavy):
        (tmp_path / "s.toml").write_text(f"{head}\n{text}\n{rest}")
        found = read_scene(tmp_path / "s.toml")
        assert (found.table, found.ball) == (TABLE_SETS["pool 9 ft"].table, ball)
        write_scene(found, tmp_path / "again.toml")
        assert read_scene(tmp_path / "again.toml").table == found.table
    (tmp_path / "s.toml").write_text(f'{head}\ntable = "pol 9 ft"\n{rest}')
    says = """table = 'pol 9 ft': is not a known table; did you mean "pool 9 ft"?, or write [table]"""
    with pytest.raises(BadInput, match=re.escape(says)):
        read_scene(tmp_path / "s.toml")
