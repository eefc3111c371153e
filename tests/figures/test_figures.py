"""Figures of the pages are those of docs/figures.toml, and these are what the reports in the repository say."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import pytest

from models.commands.console import write_json
from models.errors import BadInput
from robot.learning.summary import figures
from tests.figures.__main__ import entered
from tests.figures.pages import ROOT, filled, pages, read_figures, unmarked_cells, unmarked_quantities, used
from tests.figures.real_shot import picture, real_shot
from tests.figures.sources import AXES, READERS, REPORTS, agree, short, unlike
from tests.support.series_samples import COURSE, story

SOURCES = read_figures()
SENTENCES = ("README.md", "related.md")
WRITTEN = ("benchmarks.md", "catalogue.md", "reference.md")  # by commands
PAGES = [page for page in pages() if used(page.read_text(encoding="utf-8"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_has_the_figures_of_the_file(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert text == filled(text, SOURCES), "run: make figures"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_table_of_figures_has_no_other_ones(page: Path) -> None:
    """But where cells are sentences: there those that stand elsewhere too are marked."""
    if page.name not in SENTENCES:
        assert not unmarked_cells(page.read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", [page for page in pages() if page.name not in WRITTEN], ids=lambda page: page.name)
def test_every_quantity_of_a_page_is_measured_or_given(page: Path) -> None:
    assert unmarked_quantities(page.read_text(encoding="utf-8")) == [], "mark as <!--source.name--> or <!--given-->"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_no_line_of_a_paragraph_begins_with_a_mark(page: Path) -> None:
    """Markdown takes it for HTML, which ends the paragraph before it."""
    lines = page.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if re.match(r"\s*<!--(?!figures\.)[a-z]", line)] == []


def test_quantities_in_prose_are_seen() -> None:
    text = "it is 2.5 mm, <!--a.x-->3 s<!---->, <!--given-->12 ft<!----> or 3 of 4 `x 5 s`\n"
    assert unmarked_quantities(f"{text}\n```\n7 s\n```\n| 3 s | 4 s |\n") == ["2.5 mm", "3 of 4", "4 s"]


def test_every_figure_is_used_and_its_source_is_told() -> None:
    seen = set().union(*(used(page.read_text(encoding="utf-8")) for page in PAGES))
    assert seen == {(source, name) for source, rest in SOURCES.items() for name in rest["figures"]}
    assert all(re.fullmatch(r"[0-9a-f]{7,}", rest["version"]) and rest["date"].year > 2025 for rest in SOURCES.values())


@pytest.mark.parametrize("name", REPORTS)
def test_figures_are_those_of_the_report(name: str) -> None:
    measured = READERS[name](REPORTS[name])
    assert set(SOURCES[name]["figures"]) <= set(measured)
    assert {key: measured[key] for key in SOURCES[name]["figures"]} == SOURCES[name]["figures"], "run: make figures"


def test_pages_are_filled_and_unknown_marks_refused() -> None:
    sources: Any = {"a": {"figures": {"x": "2 mm"}, "date": "d", "version": "v", "command": "c"}}
    assert filled("it is **<!--a.x-->1 mm<!---->**, or so", sources) == "it is **<!--a.x-->2 mm<!---->**, or so"
    with pytest.raises(KeyError, match=r"a\.y is not in"):
        filled("<!--a.y-->1<!---->", sources)
    table = "| what | a | b |\n|---|---|---|\n| 3 shots | <!--a.x-->2 mm<!----> | 7 s |\n| `m2` | - | [c](d.md#4) |\n"
    assert unmarked_cells(table) == ["7 s"] and not unmarked_cells(table.replace("<!--a.x-->2 mm<!---->", "1"))


def test_a_result_is_entered_with_date_and_version_where_it_changed() -> None:
    old: Any = {"a": {"figures": {"x": "1 mm"}, "date": "then", "version": "old", "command": "measure it"}}
    assert entered(old, "a", {"x": "1 mm", "more": "5"}) == old
    new = entered(old, "a", {"x": "2 mm"})["a"]
    assert new["figures"] == {"x": "2 mm"} and new["date"] != "then" and new["version"] != "old"
    with pytest.raises(BadInput, match="a: the result has no x; run the whole of: measure it"):
        entered(old, "a", {"y": "1"})


def test_figures_agree_within_their_last_digit_or_a_share() -> None:
    assert agree("2.16 mm", "2.17 mm", 0.0) and not agree("2.16 mm", "2.19 mm", 0.0)
    assert agree("2.16 mm", "2.19 mm", 0.02)
    assert not agree("2.16 mm", "2.16 m", 0.1) and not agree("1 of 40", "1 of 4 of", 1.0)
    assert unlike({"x": "3 s", "new": "1"}, {"figures": {"x": "9 s"}}, 0.1) == ["x: 3 s measured, 9 s in figures.toml"]


def test_a_series_is_read_block_by_block(tmp_path: Path) -> None:
    """With the keys of `robot learn --json` (robot/learning/summary.py)."""
    course = dataclasses.replace(COURSE, every=4)
    told = tmp_path / "learn.json"
    write_json(told, figures(story((0.1, 0.02), ended="all 8 shots are played"), course, None))
    read = READERS["loop"](told)
    assert (read["shots_1_miss"], read["shots_1_potted"], read["shots_1_predicted"]) == ("100 mm", "4 of 4", "3.2")
    assert {name.split("_", 2)[2] for name in SOURCES["loop"]["figures"]} == {name.split("_", 2)[2] for name in read}


def test_a_match_and_films_are_read_from_their_results(tmp_path: Path) -> None:
    rungs = [{"rms_m": a / AXES, "held_out_rms_m": b / AXES} for a, b in ((0.0293, 0.0521), (0.0238, 0.0518))]
    whole = [
        {"struck_rms_median_held_out_m": m, "segment_ratio_median": r, "held_out_coverage": 0.93}
        for m, r in ((0.116, 2.2), (0.0951, 1.96))
    ]
    slope = {"table_tilt.slope_x": {"value": -0.00157, "sd": 0.00026}}
    write_json(
        tmp_path / "result.json", {"elapsed_s": 610.0, "ladder": rungs, "whole_shots": whole, "parameters": slope}
    )
    (tmp_path / "report.html").write_text(report_of_shots(), encoding="utf-8")
    read = READERS["match"](tmp_path)
    assert set(read) == set(SOURCES["match"]["figures"])
    assert (read["base"], read["mended"], read["segments"]) == ("116 mm", "95 mm", "2.0")
    assert (read["inside_band"], read["time"]) == ("93 %", "10 minutes")
    assert (read["held_out"], read["shot_base"], read["shot_found"]) == ("3", "61 mm", "45 mm")
    assert READERS["films_found"](tmp_path) == {
        "slope": "1.6 +- 0.3 mm/m", "miss": "29.3 to 23.8 mm", "miss_held_out": "52.1 to 51.8 mm"
    }  # fmt: skip
    write_json(tmp_path / "result.json", {"ladder": rungs, "whole_shots": [], "parameters": {}})
    assert "slope" not in READERS["films_found"](tmp_path)


def test_the_picture_shows_the_median_shot_as_filmed_and_by_both_models(tmp_path: Path) -> None:
    report = tmp_path / "report.html"
    report.write_text(report_of_shots(), encoding="utf-8")
    drawn = picture(real_shot(report))
    assert "Base model: rms miss 61 mm" in drawn and "Model that was found: rms miss 45 mm" in drawn
    paths = [path for path in re.findall(r'<path class="(\w+)" d="M([\d. L]+)"', drawn) if "L" in path[1]]
    assert [kind for kind, _ in paths] == ["seen", "before", "seen", "after"]
    starts = [float(points.split()[0]) for _, points in paths]
    assert starts[1] - starts[0] == pytest.approx(61 * (starts[3] - starts[2]) / 45, abs=0.5)
    assert "prefers-color-scheme:dark" in drawn
    report.write_text("<p>nothing</p>", encoding="utf-8")
    with pytest.raises(ValueError, match="no report with shots"):
        real_shot(report)


def report_of_shots() -> str:
    """A report with a shot used and three held out, of a ball that rolls 2 m."""

    def shot(name: str, held: bool, before_mm: int, after_mm: int) -> dict[str, Any]:
        miss = [[[10 * mm] * 3, [0] * 3] for mm in (before_mm, after_mm)]
        ball = {"name": "white", "colour": "rgb(250,250,240)", "t": [0, 600, 600], "x": [-9000, 9000, 9000],
                "y": [0, 0, 0], "miss": miss}  # fmt: skip
        return {"name": name, "held": held, "misses": [f"{before_mm} mm", f"{after_mm} mm"], "balls": [ball]}

    shots = [shot("a", False, 9, 8), shot("b", True, 20, 20), shot("c", True, 61, 45), shot("d", True, 30, 300)]
    player = {"table": [2.84, 1.42], "radius": 0.03, "shots": shots}
    return f'<script type="application/json" id="figures">{json.dumps({"charts": [], "player": player})}</script>'


def test_make_knows_it() -> None:
    assert "python -m tests.figures --enter demo" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_numbers_are_short() -> None:
    assert [short(v) for v in (0.2, 99.82, 128.4, 8.86, 5.7e-10)] == ["0.20", "99.8", "128", "8.9", "6e-10"]
