"""Pages from templates: escaped, complete or refused, the same again, and jinja2 only where one is written."""

from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path
from xml.etree import ElementTree

import jinja2
import pytest

from models.report.figure import INK_COLOUR, svg
from models.report.numbers import millimetres, number, value_with_sd
from models.report.page import in_readers_colours, render

PAGE = (
    '{% extends "page.html.j2" %}{% from "macros.html.j2" import bar, figure, notes, table %}{% block body %}'
    "{{ notes(lines) }}{{ table([('name', false), ('size', true)], [(lines[0], 3)]) }}{{ bar(50, 25) }}"
    '{% call figure(picture, "a picture") %}What it shows.{% endcall %}{% endblock %}'
)


@pytest.fixture
def template(tmp_path: Path) -> Path:
    path = tmp_path / "own.html.j2"
    path.write_text(PAGE, encoding="utf-8")
    return path


def test_values_are_escaped_and_spelt_out(template: Path) -> None:
    line = "<b>& \x07\ud800\nnew"
    text = render(template, title=line, lines=[line], picture="<svg/>")
    assert text.count("&lt;b&gt;&amp; \\x07\\ud800 new") == 4  # title twice, note, cell
    assert "<b>" not in text
    assert text.encode()
    assert '<td class="n">3</td>' in text
    assert 'style="width:50.0%"' in text and 'style="left:25.0%"' in text
    assert '<img alt="a picture" src="data:image/svg+xml;base64,PHN2Zy8+"></div><figcaption>What it shows.<' in text
    assert render(template, title=line, lines=[line], picture="<svg/>") == text


def test_a_figure_has_the_readers_colours_and_keeps_those_of_what_it_shows() -> None:
    drawn = svg("a", 2.0, lambda figure: figure.subplots().plot([0, 1], color="#ffffff", label="ball"))
    shown = in_readers_colours(drawn)
    assert drawn.count("#ffffff") == 2 and shown.count("#ffffff") == 1
    assert 'style="fill: none"' in shown and "stroke: #ffffff" in shown
    assert "fill: var(--ink)" in shown and shown.count(INK_COLOUR) == 1
    assert ElementTree.fromstring(shown).tag.endswith("svg")


def test_a_figure_for_phones_stands_beside_the_wide_one(template: Path) -> None:
    template.write_text(PAGE.replace('"a picture")', '"a picture", narrow)'), encoding="utf-8")
    text = render(template, title="t", lines=["a"], picture="<svg/>", narrow="<svg></svg>")
    assert '<picture><source media="screen and (max-width:560px)" srcset="data:image/svg+xml;base64,' in text
    assert 'class="wide"><img' not in text


def test_signs_of_a_terminal_are_those_of_print_and_names_stay(template: Path) -> None:
    text = render(template, title="a^2.csv", lines=["10.1 +- 0.6 mm/s^2"], picture=None)
    assert "10.1 ± 0.6 mm/s²" in text and "<h1>a^2.csv</h1>" in text


def test_a_direction_is_not_broken_after_its_sign(template: Path) -> None:
    """A browser breaks a line after a hyphen, which put the sign of -y at the end of one and y into the next."""
    text = render(template, title="t", lines=["pulled towards -y (-x); --y up, --pocket=-x, re-x"], picture=None)
    assert "towards \N{MINUS SIGN}y (\N{MINUS SIGN}x); --y up, --pocket=-x, re-x" in text


def test_a_missing_figure_says_so_and_no_notes_leave_no_box(template: Path) -> None:
    text = render(template, title="t", lines=["a"], picture=None)
    assert "Nothing to show." in text and "<img" not in text
    template.write_text(PAGE.replace("{{ table([('name', false), ('size', true)], [(lines[0], 3)]) }}", ""))
    assert 'class="notes"' not in render(template, title="t", lines=[], picture=None)


def test_a_name_without_a_value_is_an_error(template: Path) -> None:
    with pytest.raises(jinja2.UndefinedError, match="lines"):
        render(template, title="t", picture=None)


def test_jinja2_is_imported_only_when_a_page_is_written() -> None:
    code = "import sys, sysid.report.outcome, planner.report, robot.learning.report; print('jinja2' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["False"]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.nan, "–"),
        (None, "–"),
        (3, "3"),
        (3.0, "3.00"),
        (300, "300"),
        (12345.6, "12\u202f346"),
        (0.012345, "0.0123"),
        (1e-5, "1e-05"),
    ],
)
def test_numbers_have_three_digits(value: float | None, text: str) -> None:
    assert number(value) == text


def test_an_uncertainty_that_was_not_computed_is_a_dash() -> None:
    assert value_with_sd(0.2, 0.00123) == "0.2000 ± 0.0012"
    assert value_with_sd(0.2, math.nan) == value_with_sd(0.2, 0.0) == "0.2 ± –"
    assert value_with_sd(math.nan, 1.0) == "–"
    assert (millimetres(0.00123), millimetres(math.inf)) == ("1.23 mm", "–")
