"""`python -m tests.figures.pictures out/demo/report.html`: the pictures of README.md and docs/tour.md, from a report.

The machine's Chromium draws the page; its figures are taken out of it as SVG: the shot that it opens with and the error
of every model side by side, and where the base fails.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

from tests.figures.pages import ROOT
from tests.support.browser import CHROMIUM

PICTURES = ROOT / "docs" / "pictures"
WIDTH_PX, HEIGHT_PX, SHARE = 1000, 270, 0.5  # of the picture, and of its left part
MAP_SIZE_PX = (720, 460)
CHART = """
([name, width, height]) => {
  const given = JSON.parse(document.getElementById("figures").textContent).charts.find((one) => one.name === name);
  const box = document.getElementById("chart-" + name);
  const layout = {...box.layout, width, height, paper_bgcolor: "#fff", showlegend: given.layout.showlegend ?? true};
  return Plotly.toImage({data: box.data, layout}, {format: "svg", width, height});
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
        head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH_PX} {HEIGHT_PX}">'
        cloth = '<rect width="100%" height="100%" fill="#fff"/>'
        _write("before_and_after.svg", f"{head}{cloth}{''.join(parts)}</svg>\n")
        _write("where_it_fails.svg", _chart(page, "before", *MAP_SIZE_PX) + "\n")
        browser.close()
    return 0


def _chart(page: Any, name: str, width: int, height: int = HEIGHT_PX) -> str:
    """A figure of the page as SVG of a size."""
    from urllib.parse import unquote

    return unquote(str(page.evaluate(CHART, [name, width, height])).removeprefix("data:image/svg+xml,"))


def _placed(svg: str, x: int, width: int) -> str:
    """An SVG within another."""
    opening = re.sub(r' (?:width|height|style|class|role|data-is|aria-label)="[^"]*"', "", svg[: svg.index(">") + 1])
    return opening.replace("<svg", f'<svg x="{x}" width="{width}" height="{HEIGHT_PX}"', 1) + svg[svg.index(">") + 1 :]


def _write(name: str, text: str) -> None:
    """Numbers with the digits that show; ids that a browser draws anew each time are counted."""
    ids = dict.fromkeys(re.findall(r"[a-z]+-?([0-9a-f]{6})(?=[\"xyc])", text))
    for number, found in enumerate(ids):
        text = text.replace(found, f"id{number:04d}")
    (PICTURES / name).write_text(re.sub(r"(\d+\.\d{3})\d+", r"\1", text), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
