"""The report in a real browser: nothing sticks out at any width, every figure is drawn, no error, on paper too."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from sysid.report.html import Rung, write_report
from sysid.report.verdict import Verdict
from tests.support.browser import chromium
from tests.support.comparison_samples import comparison

WIDTHS_PX = (390, 820, 1400)
MAX_BYTES = 3_000_000
REDRAWN_MS = 700  # after which a page of another width is drawn anew
LONG_NAME = "a_name_of_a_shot_that_is_as_long_as_file_names_of_cameras_are_2026_11_23"
FIGURES = """
[...document.querySelectorAll(".js-plotly-plot")].map((box) => ({
  name: box.id, title: box.parentNode.querySelector("h3").textContent,
  x: box.querySelector(".xtitle")?.textContent ?? "", y: box.querySelector(".ytitle")?.textContent ?? "",
  marks: box.querySelectorAll(".trace path, .hm image, .bars path, .scatterlayer path").length,
  width: box.querySelector("svg").clientWidth, room: box.clientWidth}))
"""
OUTSIDE = """
[...document.querySelectorAll("body *")].filter((one) => !one.closest(".wide, svg, select, .modebar") &&
  one.getBoundingClientRect().right > innerWidth + 1 && one.getBoundingClientRect().width > 0)
  .map((one) => one.tagName + "." + one.className)
"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    """The machine's Chromium."""
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A discovery's report: before and after, a verdict, long names."""
    path = tmp_path_factory.mktemp("page") / "report.html"
    ends = [(f"base + {name}", comparison(12, size, f"clips/{LONG_NAME}_{{}}.csv")) for name, size in
            (("nothing", 0.02), ("table_tilt + cushion_restitution_speed", 0.002))]  # fmt: skip
    said = Verdict(
        "A table that is not level",
        "table_tilt (slope_x 0.0007 ± 0.00001 rad)",
        "the rms miss falls",
        "a delta BIC of 13951",
        "film a shot",
    )
    rungs = [Rung(label, 0.01 / (k + 1), 0.012 / (k + 1), 30.0) for k, (label, _) in enumerate(ends)]
    write_report(path, "What 12 clips say about the table", ends, ladder=rungs, notes=["a line"], verdict=said)
    assert path.stat().st_size < MAX_BYTES
    return path


def opened(browser: Any, path: Path, width: int, scheme: str = "light") -> tuple[Any, list[str]]:
    """The page with all that is folded opened, and what it complained about."""
    page = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme).new_page()
    complaints: list[str] = []
    page.on("console", lambda said: complaints.append(said.text) if said.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on(
        "request",
        lambda asked: None if asked.url.startswith(("file:", "data:", "blob:")) else complaints.append(asked.url),
    )
    page.goto(path.as_uri())
    page.wait_for_function("document.documentElement.dataset.drawn")
    page.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    page.wait_for_timeout(REDRAWN_MS)
    return page, complaints


@pytest.mark.slow
def test_nothing_sticks_out_and_every_figure_is_drawn(browser: Any, report: Path) -> None:
    page, complaints = opened(browser, report, WIDTHS_PX[0])
    for width in WIDTHS_PX:
        page.set_viewport_size({"width": width, "height": 900})
        page.wait_for_timeout(REDRAWN_MS)
        fits(page, width)
    offered = page.evaluate("[...document.querySelectorAll('.modebar-btn')].map((one) => one.dataset.title)")
    assert "Zoom" in offered and not [text for text in offered if re.search("(?i)share|cloud|edit", text)], "uploads"
    assert complaints == []
    page.context.close()


def fits(page: Any, width: int) -> None:
    """Check the page at a width."""
    assert page.evaluate("document.documentElement.scrollWidth") == width
    assert page.evaluate(OUTSIDE) == []
    figures = page.evaluate(FIGURES)
    assert len(figures) == page.evaluate("document.querySelectorAll('[id^=chart-]').length") > 8
    for one in figures:
        assert one["title"] and one["marks"], one
        assert "[" in one["x"] and ("[" in one["y"] or one["y"] == "model"), one
        assert 0.9 * one["room"] < one["width"] <= one["room"], one


@pytest.mark.slow
def test_shots_are_played_and_colours_follow_the_reader(browser: Any, report: Path) -> None:
    page, complaints = opened(browser, report, 820)
    said = page.locator("[data-is=said]")
    both = said.text_content()
    assert re.search(r"misses by [\d.]+ mm, then [\d.]+ mm", both), "before and after"
    rings = (
        "[...document.querySelectorAll('[data-is=table] circle[fill=none]')].map((one) => one.getAttribute('stroke'))"
    )
    assert len(set(page.evaluate(rings))) == 2
    page.select_option("[data-is=model]", "0")
    assert "then" not in said.text_content() and len(set(page.evaluate(rings))) == 1
    page.select_option("[data-is=shot]", index=3)
    page.evaluate(
        "const t = document.querySelector('[data-is=time]'); t.value = 0.5; t.dispatchEvent(new Event('input'))"
    )
    assert said.text_content().startswith("0.50 s")
    page.click("[data-is=play]")
    page.wait_for_function("!document.querySelector('[data-is=said]').textContent.startsWith('0.50 s')")
    ink = "getComputedStyle(document.querySelector('.xtitle')).fill"
    light = page.evaluate(ink)
    page.emulate_media(color_scheme="dark")
    page.wait_for_function(f"{ink} !== '{light}'")
    page.emulate_media(color_scheme="dark", media="print")
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    page.wait_for_function(f"{ink} === '{light}'")
    assert len(page.pdf()) > 10_000
    assert complaints == []
    page.context.close()
