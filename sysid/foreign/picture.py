"""The tracks of a clip set over its table: one look tells whether unit, origin and axes were read rightly.

In: a clip set. Out: a PNG.
"""

from __future__ import annotations

import io

import numpy as np

from models.recording.palette import ball_colour
from models.report.axes import draw_table, rgb
from sysid.clips import ClipSet

MAX_POINTS = 1000  # of one track
MARGIN_M = 0.15  # around the table


def tracks_png(clip_set: ClipSet, title: str) -> bytes:
    """All tracks from above, a ring where each struck ball begins."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    table = clip_set.table
    figure = Figure(figsize=(11, 1.2 + 10.5 * table.width / table.length), layout="constrained")
    ax = figure.add_subplot()
    draw_table(ax, table)
    for clip in clip_set.clips:
        for name, seen in clip.balls.items():
            colour = rgb(ball_colour(name))
            few = seen.xy[:: max(1, len(seen.xy) // MAX_POINTS)]
            ax.plot(*few.T, "-", lw=0.7, color=colour, zorder=6)
        start = clip.balls[clip.struck].xy[0]
        ax.plot(*start, "o", ms=7, mfc="none", mec="white", zorder=7)
    places = np.concatenate([seen.xy for clip in clip_set.clips for seen in clip.balls.values()])
    far = np.maximum(np.abs(places).max(axis=0), [table.length / 2, table.width / 2]) + MARGIN_M
    ax.set(xlim=(-far[0], far[0]), ylim=(-far[1], far[1]), xlabel="x [m]", ylabel="y [m]", aspect="equal")
    ax.spines[:].set_visible(False)
    ax.set_title(title, fontsize=9, loc="left")
    data = io.BytesIO()
    FigureCanvasAgg(figure).print_png(data, metadata={"Software": None})
    return data.getvalue()
