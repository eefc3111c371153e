"""A report as one HTML file: self-contained, escaped, the same bytes for the same values.

A template extends `page.html.j2`, which holds the style, and imports figures, tables and notes from `macros.html.j2`.
Every value is escaped, characters that cannot be shown are spelt out, and a name that no value was given for is an
error. Scripts are those of this room alone, embedded. jinja2 is imported only when a report is written: commands that
write none start without it.
"""

from __future__ import annotations

import base64
import re
from functools import partial
from pathlib import Path

from models.files import write_whole
from models.report.chart import DRAWING_FILE, PLOTLY_FILE
from models.report.figure import GRID_COLOUR, INK_COLOUR, MODEL_COLOUR, PAPER_COLOUR
from models.report.numbers import millimetres, number

MINUS_OF_AXIS = re.compile(r"(?<=[ (])-(?=[xy]\b)")  # of an axis: a line may end after a hyphen, not after a minus sign
SQUARED_UNIT = re.compile(r"(?<=/s)\^2\b")  # of a unit
FIGURE_BACKGROUND = re.compile(r'(<g id="patch_1">\s*<path d="[^"]*" style="fill: )#ffffff')  # of one by matplotlib
FIGURE_COLOURS = {  # in a light page, in a dark one (templates/style.css.j2)
    "ink": (INK_COLOUR, "#e6eaee"), "grid": (GRID_COLOUR, "#333b44"), "blue": (MODEL_COLOUR, "#5b9be0"),
    "paper": (PAPER_COLOUR, "#15191d"),
}  # fmt: skip
SHARED_TEMPLATES = Path(__file__).with_name("templates")


def write_page(path: Path | str, template: Path, **values: object) -> None:
    """Render a template and write it, whole or not at all.

    Args:
        path: the HTML file.
        template: the report's own template; others in its folder may be included from it.
        values: what the template names; `title` always.

    Raises:
        BadInput: the file cannot be written there.
    """
    write_whole(path, render(template, **values).encode())


def render(template: Path, **values: object) -> str:
    """The text of a page; jinja2.UndefinedError where the template names a value that is not given."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader([template.parent, SHARED_TEMPLATES]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_finalize,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"svg_uri": svg_uri, "number": number, "mm": millimetres}
    environment.globals |= {
        "plotly_script": partial(_script, PLOTLY_FILE),
        "drawing_script": partial(_script, DRAWING_FILE),
    }
    return environment.get_template(template.name).render(values)


def _script(path: Path) -> object:
    """A script of this room, as it may stand in a page."""
    from markupsafe import Markup

    return Markup(path.read_text(encoding="utf-8"))


def printable(text: object) -> str:
    """Any text on one line; characters that cannot be shown are spelt out."""
    return "".join(c if c.isprintable() else " " if c.isspace() else ascii(c)[1:-1] for c in str(text))


def svg_uri(picture: str) -> str:
    """An SVG as the address of an image, so that the page needs no other file; in the reader's colours."""
    return "data:image/svg+xml;base64," + base64.b64encode(in_readers_colours(picture).encode()).decode()


def in_readers_colours(picture: str) -> str:
    """An SVG of models.report.figure on the page's own background, its text and lines light where the page is dark."""
    picture = FIGURE_BACKGROUND.sub(r"\1none", picture, count=1)
    for name, (colour, _) in FIGURE_COLOURS.items():
        picture = picture.replace(colour, f"var(--{name})")
    light, dark = ("".join(f"--{name}:{pair[k]};" for name, pair in FIGURE_COLOURS.items()) for k in (0, 1))
    style = f"<style>:root{{{light}}}@media(prefers-color-scheme:dark){{:root{{{dark}}}}}</style>"
    return picture.replace("</svg>", f"{style}</svg>")


def _finalize(value: object) -> object:
    """A plain string made printable, with the signs of print for those of a terminal; what is HTML already stays."""
    if type(value) is not str:
        return value
    return SQUARED_UNIT.sub("²", MINUS_OF_AXIS.sub("\N{MINUS SIGN}", printable(value).replace(" +- ", " ± ")))
