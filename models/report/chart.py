"""Interactive figures as plain values, which Plotly draws in the page: traces, layout, title, axes with units.

In: numbers. Out: a `Chart`, and the JSON of several for the page; the same bytes for the same values.

Plotly's bundle for Cartesian axes (scripts/plotly-cartesian.min.js, release 4.1.1, MIT) is embedded once in a page
that has figures. Its figures are plain JSON and drawn as SVG, sharp on paper and open to a test; it is 1.5 MB, a third
of the whole library. Bokeh's core is smaller, but draws pixels, numbers its figures by a counter of the process, and
brings a server along. Colours written as `var(--name)` are those of the page, light or dark.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import one_line
from models.report.axes import LONG_RANGE
from models.shot import Table

PLOTLY_FILE = Path(__file__).with_name("scripts") / "plotly-cartesian.min.js"
DRAWING_FILE = Path(__file__).with_name("scripts") / "report.js"
SIGNIFICANT_DIGITS = 4  # of numbers in figures
INK, SOFT = "var(--ink)", "var(--soft)"
MODEL, HELD_OUT, BEFORE, PERFECT = "#3478c6", "#e07b1a", "#8a94a0", "rgba(138,148,160,0.28)"
MAP_COLOURS = [[0.0, "var(--map-low)"], [0.25, "#fecc5c"], [0.6, "#f0542c"], [1.0, "#a50026"]]
ARROW_PX = 9  # of arrow heads


@dataclass(frozen=True)
class Chart:
    """One figure: Plotly's traces and layout."""

    name: str  # of its place in the page, unique there
    title: str
    data: tuple[Mapping[str, Any], ...]
    layout: Mapping[str, Any] = field(default_factory=dict)
    height: int = 300  # [pixels]
    aspect: float = 0.0  # height over width of the plotted area, instead of a height; 0 for none

    def to_json(self) -> dict[str, Any]:
        """As scripts/report.js reads it."""
        return {
            "name": self.name, "title": self.title, "data": list(self.data), "layout": dict(self.layout),
            "height": self.height, "aspect": self.aspect,
        }  # fmt: skip


def embedded(value: Any) -> str:
    """A value as JSON that may stand in a script element: rounded, NaN as null, no tag in it."""
    text = json.dumps(_plain(value), separators=(",", ":"), ensure_ascii=True)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        value = value.tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value


def label(text: str, most: int = 60) -> str:
    """A text of users as Plotly shows it unchanged."""
    return escape(shortened(text, most), quote=False)


def shortened(text: str, most: int) -> str:
    """A text on one line of at most so many characters."""
    line = one_line(text)
    return line if len(line) <= most else line[: most - 1] + "…"


def axis(title: str, **more: Any) -> dict[str, Any]:
    """An axis with its quantity and unit."""
    return {"title": {"text": title}, "automargin": True, **more}


def log_axis(title: str, low: float, high: float, **more: Any) -> dict[str, Any]:
    """A logarithmic axis from `low` to `high`: 1, 2 and 5 of every decade, decades alone where it is long."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    steps = (1, 2, 5) if high < LONG_RANGE * low else (1,)
    ticks = [float(f"{step}e{k}") for k in decades for step in steps]
    ends = [math.log10(low), math.log10(high)]
    return axis(title, type="log", range=ends, tickvals=ticks, ticktext=[f"{v:g}" for v in ticks], **more)


def line_at(value: float, name: str, across: Sequence[Any], *, vertical: bool = False) -> dict[str, Any]:
    """A dashed reference line with a name in the legend; `across` are the ends of the other axis."""
    ends = {"x": [value, value], "y": list(across)} if vertical else {"x": list(across), "y": [value, value]}
    return {
        "type": "scatter", "mode": "lines", "name": name, "line": {"color": INK, "dash": "dash", "width": 1.3},
        "hoverinfo": "name", **ends,
    }  # fmt: skip


def table_map(name: str, title: str, table: Table, z: Any, top: float, unit: str, arrows: Mapping[str, Any]) -> Chart:
    """Cells of the table coloured from 0 to `top`, and arrows on them.

    Args:
        name: of the figure.
        title: of the figure.
        table: seen from above.
        z: (nx, ny) values of the cells, NaN for none.
        top: at which the colours end.
        unit: what the colours stand for, with its unit.
        arrows: "tails" and "heads" (n, 2) [m], "texts" of each.
    """
    edges = [
        np.linspace(-size / 2, size / 2, n + 1) for size, n in zip((table.length, table.width), z.shape, strict=True)
    ]
    x, y = (0.5 * (e[1:] + e[:-1]) for e in edges)
    cells = {
        "type": "heatmap", "x": x, "y": y, "z": np.asarray(z).T, "zmin": 0, "zmax": top, "colorscale": MAP_COLOURS,
        "hovertemplate": "x %{x:.2f} m, y %{y:.2f} m: %{z:.3g}<extra></extra>", "xgap": 1, "ygap": 1,
        "colorbar": {"title": {"text": unit, "side": "bottom", "font": {"size": 12}}, "orientation": "h",
                     "thickness": 9, "yref": "container", "y": 0, "yanchor": "bottom", "len": 0.9},
    }  # fmt: skip
    tails, heads = np.asarray(arrows["tails"]), np.asarray(arrows["heads"])
    gaps = np.full(len(tails), np.nan)
    lines = {
        "type": "scatter", "mode": "lines+markers", "showlegend": False, "hoverinfo": "text",
        "x": np.column_stack([tails[:, 0], heads[:, 0], gaps]).ravel(),
        "y": np.column_stack([tails[:, 1], heads[:, 1], gaps]).ravel(),
        "text": [text for one in arrows["texts"] for text in ("", one, "")], "line": {"color": INK, "width": 1.6},
        "marker": {"symbol": "arrow", "angleref": "previous", "color": INK, "line": {"width": 0},
                   "size": [0, ARROW_PX, 0] * len(tails)},
    }  # fmt: skip
    half = np.array([table.length, table.width]) / 2
    rail = {"type": "rect", "x0": -half[0], "x1": half[0], "y0": -half[1], "y1": half[1], "line": {"color": SOFT}}
    pockets = [(sx * half[0], sy * half[1]) for sx in (-1, 0, 1) for sy in (-1, 1)] if table.pockets else []
    holes = {
        "type": "scatter", "mode": "markers", "showlegend": False, "hoverinfo": "skip",
        "x": [p[0] for p in pockets], "y": [p[1] for p in pockets], "marker": {"color": INK, "size": 8},
    }  # fmt: skip
    span = [(-1.04 * h, 1.04 * h) for h in half]
    layout = {
        "xaxis": axis("x [m]", range=span[0], constrain="domain", zeroline=False, showgrid=False),
        "yaxis": axis("y [m]", range=span[1], scaleanchor="x", constrain="domain", zeroline=False, showgrid=False),
        "shapes": [rail],
    }
    return Chart(name, title, (cells, lines, holes), layout, aspect=table.width / table.length)
