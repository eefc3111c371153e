"""`python -m tests.figures.pictures out/demo/report.html`: the pictures of docs/tour.md, from a report.

The machine's Chromium draws the page; its figures are taken out of it as SVG: the shot that it opens with and the error
of every model side by side, and what the base lacks over the cloth beside what the mended model does.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from tests.figures.pages import ROOT
from tests.support.browser import CHROMIUM

PICTURES = ROOT / "docs" / "pictures"
WIDTH_PX, HEIGHT_PX, SHARE = 1000, 270, 0.5  # of the picture, and of its left part
MAPS_PX = (1000, 336)
CHART = """
([name, width, height]) => {
  const given = JSON.parse(document.getElementById("figures").textContent).charts.find((one) => one.name === name);
  const box = document.getElementById("chart-" + name);
  const layout = {...box.layout, width, height, paper_bgcolor: "#fff", showlegend: given.layout.showlegend ?? true};
  return Plotly.toImage({data: box.data, layout}, {format: "svg", width, height});
}
"""
CLOTHS = """
() => {
  const style = getComputedStyle(document.documentElement);
  const plain = (text) => text.replace(/var\\((--[a-z-]+)\\)/g, (_, name) => style.getPropertyValue(name).trim());
  const rules = [...document.styleSheets[0].cssRules].filter((one) => /^\\.cloth/.test(one.selectorText || ""));
  const font = ".cloth,.title{font-family:sans-serif;font-size:11.5px}.title{font-size:14px;font-weight:bold}";
  return [font + rules.slice(1).map((one) => plain(one.cssText)).join(""),
    ...[...document.querySelectorAll("svg.cloth:not(.shot)")].map((one) =>
      [one.previousElementSibling.textContent, new XMLSerializer().serializeToString(one)])];
}
"""
SHOT = "() => new XMLSerializer().serializeToString(document.querySelector('#player svg'))"


def main(report: Path) -> int:
    """Write both pictures."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1400, "height": 900})
        page.goto(report.resolve().as_uri())
        page.wait_for_function("document.documentElement.dataset.drawn")
        left = round(WIDTH_PX * SHARE)
        parts = [_placed(page.evaluate(SHOT), 0, left - 10), _placed(_chart(page, "ladder", left), left, left)]
        _write("before_and_after.svg", _side_by_side(parts, WIDTH_PX, HEIGHT_PX))
        style, *cloths = page.evaluate(CLOTHS)
        width, height = MAPS_PX
        half = width // 2
        parts = [
            f'<text x="{k * half + 14}" y="15" class="title">{escape(title)}</text>'
            + _placed(one, k * half, half - 10, height - 24).replace("<svg", '<svg y="24"', 1)
            for k, (title, one) in enumerate(cloths)
        ]
        _write("where_it_fails.svg", _side_by_side([f"<style>{style}</style>", *parts], width, height))
        browser.close()
    return 0


def _side_by_side(parts: Sequence[str], width: int, height: int) -> str:
    """SVGs on white paper."""
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}">'
    return f'{head}<rect width="100%" height="100%" fill="#fff"/>{"".join(parts)}</svg>\n'


def _chart(page: Any, name: str, width: int, height: int = HEIGHT_PX) -> str:
    """A figure of the page as SVG of a size."""
    from urllib.parse import unquote

    return unquote(str(page.evaluate(CHART, [name, width, height])).removeprefix("data:image/svg+xml,"))


def _placed(svg: str, x: int, width: int, height: int = HEIGHT_PX) -> str:
    """An SVG within another."""
    opening = re.sub(r' (?:width|height|style|role|data-is|aria-label)="[^"]*"', "", svg[: svg.index(">") + 1])
    return opening.replace("<svg", f'<svg x="{x}" width="{width}" height="{height}"', 1) + svg[svg.index(">") + 1 :]


def _write(name: str, text: str) -> None:
    """Numbers with the digits that show; ids that a browser draws anew each time are counted."""
    ids = dict.fromkeys(re.findall(r"[a-z]+-?([0-9a-f]{6})(?=[\"xyc])", text))
    for number, found in enumerate(ids):
        text = text.replace(found, f"id{number:04d}")
    (PICTURES / name).write_text(re.sub(r"(\d+\.\d{3})\d+", r"\1", text), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
