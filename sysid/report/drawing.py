"""Pictures as bytes: nothing in them depends on the clock, the user's settings or earlier pictures."""

from __future__ import annotations

import io
import warnings
from collections.abc import Callable
from typing import Any

INK, MODEL, HELD_OUT, NOISE, SHOWN = "#1f2933", "#2563a8", "#d9730d", "#8a94a0", "#00dcf5"
WIDTH = 10.6  # of every picture [inch of 72 points]
STYLE = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans", "Verdana", "Arial"],
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titlelocation": "left",
    "axes.titley": 1.0,  # where it is anyway, without a look at every tick for one in its way
    "axes.edgecolor": NOISE,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "text.color": INK,
    "xtick.color": INK,
    "ytick.color": INK,
    "grid.color": "#e3e7eb",
    "grid.linewidth": 0.7,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
}


def svg(name: str, height: float, draw: Callable[[Any], None]) -> str:
    """A picture as SVG; `name` makes its ids its own, `height` in inches, `draw` is given the figure."""
    text: str = _drawn(
        height, draw, {"svg.hashsalt": name}, io.StringIO(), format="svg", metadata={"Date": None, "Creator": None}
    )
    return text


def png(height: float, draw: Callable[[Any], None], dpi: int) -> bytes:
    """A picture as PNG, of so many dots an inch."""
    data: bytes = _drawn(height, draw, {}, io.BytesIO(), format="png", dpi=dpi, metadata={"Software": None})
    return data


def _drawn(height: float, draw: Callable[[Any], None], more: dict[str, Any], out: Any, **rest: Any) -> Any:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph .* missing")  # a browser has more fonts
        matplotlib.rcdefaults()
        matplotlib.rcParams.update({**STYLE, **more})
        figure = Figure(figsize=(WIDTH, height), layout="constrained")
        draw(figure)
        _lay_out(figure, rest["format"], rest.get("dpi", 72))
        figure.savefig(out, facecolor="white", **rest)
    return out.getvalue()


def _lay_out(figure: Any, kind: str, dpi: int) -> None:
    """Place what a figure holds as saving it would, which draws it whole a first time for that and throws it away."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    usual = figure.dpi
    (FigureCanvasSVG if kind == "svg" else FigureCanvasAgg)(figure)
    figure.dpi = dpi
    figure.get_layout_engine().execute(figure)
    figure.set_layout_engine(None)
    figure.dpi = usual
