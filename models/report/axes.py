"""What figures of several reports share: the table from above, circles, logarithmic ticks, a legend on cloth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from models.shot import Table
from models.table.palette import CLOTH_COLOUR, CUSHION_COLOUR, POCKET_COLOUR, RAIL_COLOUR

TABLE_MARGIN_M = 0.11  # of cushions and rail around the playing surface, as drawn
CUSHION_DRAWN_M = 0.05
LONG_RANGE = 300.0  # highest over lowest of a logarithmic axis, above which a small figure has room for decades alone


def draw_table(ax: Any, table: Table) -> None:
    """Rail, cushion, bed and pockets, with axes in metres."""
    from matplotlib.patches import Rectangle

    half = np.array([table.length, table.width]) / 2
    colours = [rgb(c) for c in (RAIL_COLOUR, CUSHION_COLOUR, CLOTH_COLOUR)]
    for margin, colour in zip((TABLE_MARGIN_M, CUSHION_DRAWN_M, 0.0), colours, strict=True):
        low, size = -half - margin, 2 * (half + margin)
        ax.add_patch(Rectangle(tuple(low), *size, fc=colour, ec="none", zorder=1))
    if table.pockets:
        centres = [(sx * half[0], sy * half[1]) for sx in (-1, 0, 1) for sy in (-1, 1)]
        for x, y in centres:
            deeper = (x + 0.015 * np.sign(x), y + (0.015 if x else 0.03) * np.sign(y))
            radius = (table.shapes.corner if x else table.shapes.middle).mouth / 2
            ax.add_patch(circle(deeper, radius, fc=rgb(POCKET_COLOUR), ec="none", zorder=3))
    edge = half + TABLE_MARGIN_M
    ax.set(xlim=(-edge[0], edge[0]), ylim=(-edge[1], edge[1]), aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.spines[["left", "bottom"]].set_visible(False)
    ax.tick_params(length=2, labelsize=7.5)


def circle(centre: Any, radius: float, **style: Any) -> Any:
    """A matplotlib patch."""
    from matplotlib.patches import Circle

    return Circle(tuple(centre), radius, **style)


def rgb(colour: Sequence[int]) -> tuple[float, ...]:
    """A colour of bytes as matplotlib takes it, 0 to 1."""
    return tuple(c / 255 for c in colour)


def plain_log_ticks(axis: Any, long_range: float = LONG_RANGE) -> None:
    """Plain numbers on a logarithmic axis: 1, 2 and 5 of every decade; decades alone on an axis of a longer range."""
    from matplotlib.ticker import LogLocator, NullLocator

    low, high = axis.get_view_interval()
    axis.set_major_locator(LogLocator(subs=(1.0,) if high > long_range * low else (1.0, 2.0, 5.0)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(lambda value, _: f"{value:g}")


def legend_on_cloth(fig: Any, handles: Sequence[Any], labels: Sequence[str], columns: int) -> Any:
    """A legend below the figure on the colour of cloth, where white marks show."""
    style = {"facecolor": rgb(CLOTH_COLOUR), "edgecolor": "none", "labelcolor": "white", "framealpha": 1.0}
    return fig.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=True, **style)


def round_down(value: float) -> float:
    """The largest 1, 2 or 5 times a power of ten up to a value."""
    power = 10.0 ** math.floor(math.log10(value))
    return float(f"{max(m for m in (1, 2, 5) if m * power <= value * (1 + 1e-9)) * power:.0e}")
