"""Figures as bytes: nothing in them depends on the clock, the user's settings or earlier figures."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable
from typing import Any

Draw = Callable[[Any], None]  # draws into a matplotlib figure

NARROW_WIDTH_IN = 4.4  # of a figure for the screen of a phone
FIGURE_WIDTH_IN = 10.6  # of every figure that spans the page [inch of 72 points]
INK_COLOUR = "#1f2933"  # text, axes, reference lines
MODEL_COLOUR = "#2563a8"
HELD_OUT_COLOUR = "#d9730d"
NOISE_COLOUR = "#8a94a0"
GRID_COLOUR = "#e3e7eb"
PAPER_COLOUR = "#fefefe"  # behind words, and within hollow marks: that of the page
PATH_COLOUR = "#00dcf5"  # a model's path on the cloth
PATH, DECIMALS = re.compile(r' d="[^"]*"'), re.compile(r"(\.\d\d)\d+")  # a hundredth of a point is fine enough
RC_PARAMS = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # as by default, but matplotlib need not search all ticks for one in its way
    "axes.edgecolor": NOISE_COLOUR,
    "axes.facecolor": "none",
    "axes.labelcolor": INK_COLOUR,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK_COLOUR,
    "xtick.color": INK_COLOUR,
    "ytick.color": INK_COLOUR,
    "grid.color": GRID_COLOUR,
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}


def svg(name: str, height: float, draw: Draw) -> str:
    """A figure as SVG; its ids are made from `name`, `height` in inches."""
    text: str = _drawn(
        height, draw, {"svg.hashsalt": name}, io.StringIO(), format="svg", metadata={"Date": None, "Creator": None}
    )
    return PATH.sub(lambda path: DECIMALS.sub(r"\1", path[0]), text)


def png(height: float, draw: Draw, dpi: int) -> bytes:
    """A figure as PNG; `height` in inches."""
    data: bytes = _drawn(height, draw, {}, io.BytesIO(), format="png", dpi=dpi, metadata={"Software": None})
    return data


def _drawn(height: float, draw: Draw, more: dict[str, Any], out: Any, **options: Any) -> Any:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a browser has more fonts
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**RC_PARAMS, **more})
        figure = Figure(figsize=(FIGURE_WIDTH_IN, height), layout="constrained")
        draw(figure)
        _lay_out(figure, options["format"], options.get("dpi", 72))
        figure.savefig(out, facecolor="white", **options)
    return out.getvalue()


def _lay_out(figure: Any, kind: str, dpi: int) -> None:
    """Run the layout engine once; savefig would draw the whole figure an extra time for it."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    usual = figure.dpi
    (FigureCanvasSVG if kind == "svg" else FigureCanvasAgg)(figure)
    figure.dpi = dpi
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)
    figure.dpi = usual
