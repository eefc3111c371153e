"""The table of benchmarks grows by dated rows, and begins anew where its columns change."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from tests.bench.growth import exponent, noted


def test_rows_are_added_and_other_columns_begin_a_new_table(tmp_path: Path) -> None:
    page, day = tmp_path / "benchmarks.md", datetime.date(2026, 11, 23)
    page.write_text("# What it costs\n", encoding="utf-8")
    noted({"check [s]": "5"}, day, "abc", page)
    noted({"check [s]": "6"}, day, "abd", page)
    noted({"fit [s]": "7"}, day, "abe", page)
    rows = [line for line in page.read_text(encoding="utf-8").splitlines() if line.startswith("| 2026-11-23 | ab")]
    assert [row.split(" | ")[1] for row in rows] == ["abc", "abd", "abe"]
    assert page.read_text(encoding="utf-8").count("|---") == 4 + 4


def test_twice_the_cost_of_twice_the_size_is_linear() -> None:
    assert exponent([2.0, 4.0], [3.0, 6.0]) == pytest.approx(1.0)
