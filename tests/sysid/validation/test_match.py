"""`sysid match`: its rows, the published tables, and clips that a fit of MuJoCo's own contacts starts from."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from models import effect_catalogue
from models.effect_catalogue import catalogue
from models.mjcf.native import Native
from models.model_file import read_model
from sysid import cli
from sysid.clips import read_clip_set
from sysid.validation import match
from sysid.validation.match_result import MatchResult, line
from sysid.validation.published import CUSHION_2009, CUSHION_2010, OBLIQUE_2009

HEADWIND = """
from dataclasses import dataclass
from models.effect import Effect, param

@dataclass(frozen=True)
class Headwind(Effect):
    size: float = param(0.02, off=0.0, unit="m/s^2", bounds=(0.0, 1.0), source="made up")

    def forces(self, ball):
        if ball.rolling:
            ball.ax -= self.size

@dataclass(frozen=True)
class Level(Effect):
    size: float = param(0.02, off=0.0, unit="1", bounds=(0.0, 1.0), source="made up")

    def edit(self, spec):
        spec.option.gravity[0] = self.size
"""


@pytest.fixture(scope="module")
def rows() -> list[MatchResult]:
    return list(match.rows(count=20, shots=6, few=True))


@pytest.mark.slow
def test_effects_reach_every_figure(rows: list[MatchResult]) -> None:
    missed = [line(row) for row in rows if not row.ok]
    assert not missed
    assert sum(row.tolerance is not None for row in rows if not row.case.startswith("effect ")) == 25


@pytest.mark.slow
def test_every_effect_of_the_catalogue_has_its_rows(rows: list[MatchResult]) -> None:
    base = {"decoupled_cloth", "ball_impact", "cushion_impact"}
    for name in {"none", *catalogue()} - base:
        mine = [row for row in rows if row.case.startswith(f"effect {name}, ")]
        assert [row.tolerance for row in mine] == [None if name == "cushion_contact_time" else 2.0, None], name
        assert all(np.isfinite(row.error) for row in mine)


def test_an_effect_of_one_s_own_has_rows_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(effect_catalogue, "_added", {})
    (tmp_path / "headwind.py").write_text(HEADWIND)
    assert effect_catalogue.add_folder(tmp_path) == ("headwind", "level")
    assert "headwind" in match.playable_effects()
    assert "level" not in match.playable_effects(), "it edits the MJCF: only MuJoCo plays it"
    found = match.effect("headwind", 6)
    assert all(row.ok and row.case.startswith("effect headwind, 6 shots") for row in found)


@pytest.mark.slow
def test_native_contact_misses_by_far_more(rows: list[MatchResult]) -> None:
    ours = {row.case: row.error for row in rows if row.model == "effects"}
    pairs = [
        (row.error, ours[row.case])
        for row in rows
        if row.model == "native"
        and row.case in ours
        and row.case.startswith(("cloth", "ball-ball", "cushion", "whole"))
    ]
    assert len(pairs) > 15
    assert all(native > 3 * effects for native, effects in pairs)


@pytest.mark.slow
def test_both_models_are_held_against_the_same_cases(rows: list[MatchResult]) -> None:
    by = [{row.case for row in rows if row.model == name} for name in ("native", "effects")]
    assert by[0] <= by[1]
    for part in ("cloth", "ball-ball", "cushion", "whole shots", "roughness", "rebounds", "oblique"):
        assert any(case.startswith(part) for case in by[0])
    assert any(case.startswith("launcher's tip") for case in by[1])


@pytest.mark.slow
def test_effects_meet_the_measurements_as_the_analytic_models_do(rows: list[MatchResult]) -> None:
    found = [row for row in rows if row.model == "effects" and "Mathavan" in row.case]
    assert len(found) == 6
    for row in found:
        assert row.analytic is not None
        assert row.error == pytest.approx(row.analytic, rel=0.05)


def test_a_row_that_misses_is_not_ok() -> None:
    assert MatchResult("a", "effects", 2.0, "mm", 2.0).ok
    assert not MatchResult("a", "effects", 2.1, "mm", 2.0).ok
    assert not MatchResult("a", "effects", float("nan"), "mm", 2.0).ok
    assert MatchResult("a", "native", 1e9, "mm").ok
    assert "EXCEEDED" in line(MatchResult("a", "effects", 2.1, "mm", 2.0))


@pytest.mark.parametrize(("error", "status"), [(0.5, 0), (1.5, 1)])
def test_the_command_writes_its_rows(
    error: float, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = [MatchResult("motion", "native", 9.0, "mm"), MatchResult("motion", "effects", error, "mm", 1.0)]
    monkeypatch.setattr(match, "rows", lambda: iter(made))
    out = tmp_path / "match.json"
    assert cli.main(["match", "--json", str(out)]) == status
    data = json.loads(out.read_text())
    assert [(r["case"], r["model"], r["error"], r["unit"], r["reach"], r["ok"]) for r in data["rows"]] == [
        ("motion", "native", 9.0, "mm", None, True),
        ("motion", "effects", error, "mm", 1.0, status == 0),
    ]
    assert f"2 rows, 1 with a tolerance, {status} beyond it" in capsys.readouterr().out


def test_clips_of_the_analytic_models(tmp_path: Path) -> None:
    folder = tmp_path / "analytic"
    assert cli.main(["match", "--clips", str(folder)]) == 0
    clip_set = read_clip_set(folder)
    assert len(clip_set.clips) == 30
    assert clip_set.sigma == pytest.approx(2e-4)
    native = read_model(folder / "native.toml")
    assert native.table == clip_set.table
    assert not native.effects


@pytest.mark.slow
def test_the_shipped_native_terms_are_those_that_tuning_finds(tmp_path: Path) -> None:
    out = tmp_path / "tuned.toml"
    assert cli.main(["match", "--tune", str(out)]) == 0
    found, shipped = read_model(out).native, Native()
    for name in Native.parameters():
        assert getattr(shipped, name) == pytest.approx(getattr(found, name), rel=0.02), name


def test_published_tables_are_those_of_the_data(data_folder: Path) -> None:
    for name, table in (
        ("mathavan2010_cushion_fig7a", CUSHION_2010),
        ("mathavan2009_cushion_fig9", CUSHION_2009),
        ("mathavan2009_oblique_ball_ball_table1", OBLIQUE_2009),
    ):
        with (data_folder / "published" / f"{name}.csv").open() as file:
            rows = np.array([[float(x) for x in row] for row in list(csv.reader(file))[1:]])
        assert np.array(table) == pytest.approx(rows[:, : len(table[0])], abs=6e-4)
