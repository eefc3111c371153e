"""The page of a plan on a phone: its figures show the shot, and are dark in the dark; in a real browser."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from models.report.axes import TABLE_MARGIN_M
from planner.report import write_report
from planner.report_figures import part_used
from tests.support.browser import chromium
from tests.support.plan_samples import HALF, sample

LOADED = "[...document.images].every((one) => one.complete && one.naturalWidth > 0)"
ABOVE = "img[alt='The shot']"


def picture(page: Any, of: str) -> Any:
    """What the browser shows of an element, (height, width, 3), blue first."""
    return cv2.imdecode(np.frombuffer(page.locator(of).screenshot(), np.uint8), cv2.IMREAD_COLOR).astype(int)


def share_of_cloth(seen: Any) -> float:
    """Of the pixels of a picture."""
    return float((np.abs(seen - (58, 92, 18)).sum(axis=2) < 6).mean())


@pytest.mark.slow
def test_figures_fit_a_phone_and_follow_the_readers_colours(tmp_path: Path) -> None:
    write_report(tmp_path / "plan.html", sample(), "Red into the corner")
    with chromium() as browser:
        corner = {}
        for scheme in ("light", "dark"):
            page = browser.new_context(viewport={"width": 390, "height": 900}, color_scheme=scheme).new_page()
            page.goto((tmp_path / "plan.html").as_uri())
            page.wait_for_function(LOADED)
            corner[scheme] = picture(page, ABOVE)[:4, :4].mean()
            moved = "[...document.querySelectorAll('.wide')].filter((one) => one.scrollWidth > one.clientWidth).length"
            assert page.evaluate("document.documentElement.scrollWidth") == 390 and page.evaluate(moved) == 0
            tall = page.evaluate(f'document.querySelector("{ABOVE}").getBoundingClientRect().height')
            assert tall > 180, "higher than the whole table would be at this width"
            assert share_of_cloth(picture(page, ABOVE)) > 0.4
            page.set_viewport_size({"width": 1400, "height": 900})
            page.wait_for_function(f'document.querySelector("{ABOVE}").getBoundingClientRect().width > 900')
            page.context.close()
        assert corner["light"] > 240 and corner["dark"] < 50


def test_the_figure_for_phones_holds_the_whole_shot_and_no_more_than_the_table() -> None:
    edge = HALF + TABLE_MARGIN_M
    for k in range(20):
        rng = np.random.default_rng(k)
        xy = rng.uniform(-HALF, HALF, (2, 2)) * ([1, 1], [1e-3, 1])[k % 2]
        low, high = part_used({"tracks": [{"ball": "white", "t": [0.0, 1.0], "xy": xy.tolist()}]}, edge)
        assert (low <= xy.min(axis=0)).all() and (high >= xy.max(axis=0)).all()
        assert (low >= -edge - 1e-9).all() and (high <= edge + 1e-9).all()
        assert 0.49 < (high - low)[1] / (high - low)[0] < 2.01
    assert np.array(part_used({}, edge)) == pytest.approx(np.array([-edge, edge]))
