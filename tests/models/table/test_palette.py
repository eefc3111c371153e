"""Colours of balls and of their curves."""

from __future__ import annotations

import pytest

from models.mjcf.world import colour as world_colour
from models.table.palette import SCREEN_COLOURS, Colour, ball_colour, ink

LEAST_CONTRAST = 2.0  # of a line with what is behind it


def luminance(colour: Colour) -> float:
    """Relative luminance (WCAG 2.2)."""
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in (v / 255 for v in colour)]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("name", [*SCREEN_COLOURS, "cushion", "red_07", "kugel"])
def test_curves_show_on_black_and_on_white(name: str) -> None:
    line = luminance(ink(ball_colour(name)))
    assert 1.05 / (line + 0.05) > LEAST_CONTRAST, "on white"
    assert (line + 0.05) / 0.05 > LEAST_CONTRAST, "on black"


def test_colours_that_show_stay_as_they_are() -> None:
    assert ink(SCREEN_COLOURS["blue"]) == SCREEN_COLOURS["blue"]


@pytest.mark.parametrize(
    ("names", "colour"),
    [(("8", "ball 8", "8 ball", "eight", "ball_08", "black"), "black"), (("1", "9", "ball 9", "yellow"), "yellow"),
     (("red 8", "red"), "red"), (("cue", "white"), "white")],
)  # fmt: skip
def test_balls_have_one_colour_on_paper_and_in_mujoco(names: tuple[str, ...], colour: str) -> None:
    for name in names:
        assert ball_colour(name) == SCREEN_COLOURS[colour], name
        assert world_colour(name) == pytest.approx([c / 255 for c in SCREEN_COLOURS[colour]], abs=1e-3)
