"""Results as short tables: printed, displayed in a notebook, or converted to a data frame.

In: a result's `Sheet`. Out: text, HTML, or a data frame of pandas or Polars; nothing is computed here.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from html import escape
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from models.commands.console import table
from models.errors import BadInput, one_line

FRAME_LIBRARIES = ("pandas", "polars")  # in order of preference
PNG_DPI = 150
NO_FRAME_REMEDY = "a data frame needs pandas or Polars, and neither is installed: pip install pandas"


@dataclass(frozen=True)
class Sheet:
    """A short table for display, and the columns of the data frame."""

    columns: Mapping[str, Sequence[Any]]  # of the data frame: values in SI, by name
    heads: tuple[str, ...]  # column heads of the displayed table
    rows: tuple[tuple[str, ...], ...]
    lines: tuple[str, ...] = ()  # text above the table

    def text(self) -> str:
        """Lines and table for a terminal."""
        shown = [table([self.heads, *self.rows])] if self.rows else []
        return "\n".join([*self.lines, *shown])

    def html(self) -> str:
        """Lines and table as HTML for a notebook."""
        words = "<br>".join(escape(one_line(line)) for line in self.lines)
        heads = "".join(f"<th>{escape(head)}</th>" for head in self.heads)
        rows = ["".join(f"<td>{escape(one_line(cell))}</td>" for cell in row) for row in self.rows]
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        grid = f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
        return f"<p>{words}</p>{grid}"


def frame_of(columns: Mapping[str, Sequence[Any]]) -> Any:
    """Columns as a data frame of pandas, or of Polars if only that is installed; BadInput if neither is."""
    found = next((name for name in FRAME_LIBRARIES if find_spec(name)), None)
    if found is None:
        raise BadInput(NO_FRAME_REMEDY)
    return import_module(found).DataFrame({name: list(values) for name, values in columns.items()})


class Presented:
    """A result that prints as a short table and converts to a data frame."""

    def sheet(self) -> Sheet:
        """The sheet of the result."""
        raise NotImplementedError

    def frame(self) -> Any:
        """A data frame of pandas, or of Polars if only that is installed.

        Raises:
            BadInput: if neither is installed.
        """
        return frame_of(self.sheet().columns)

    def __str__(self) -> str:
        """The table as text."""
        return self.sheet().text()

    __repr__ = __str__

    def _repr_html_(self) -> str:
        """The table in a notebook."""
        return self.sheet().html()


@dataclass(frozen=True, repr=False)
class Picture:
    """A figure that a notebook displays, and that can be saved as SVG or PNG."""

    name: str
    height: float  # [inch]
    draw: Callable[[Any], None]  # draws into a matplotlib figure

    @cached_property
    def svg(self) -> str:
        """The figure as SVG."""
        from models.report.figure import svg

        return svg(self.name, self.height, self.draw)

    def save(self, path: Path | str) -> None:
        """Write the figure as SVG or PNG, by its suffix, completely or not at all; BadInput if it cannot be written."""
        from models.files import write_whole
        from models.report.figure import png

        suffix = Path(path).suffix.lower()
        if suffix not in (".svg", ".png"):
            raise BadInput(f"{path}: a picture is saved as SVG or PNG; give a name that ends in .svg or .png")
        write_whole(path, self.svg.encode() if suffix == ".svg" else png(self.height, self.draw, PNG_DPI))

    def _repr_svg_(self) -> str:
        """The figure in a notebook, at most as wide as its column."""
        return self.svg.replace("<svg ", '<svg style="max-width:100%;height:auto" ', 1)

    def __repr__(self) -> str:
        """A short description instead of the SVG text."""
        return f"<picture: {self.name}; .save(file.png) or .save(file.svg)>"
