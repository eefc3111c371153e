"""A campaign of strokes to look at in the Rerun viewer: where each hit the ball, what the ball did, what was predicted.

Strokes follow one another on the timeline `shot`, in the order in which they were played. The ball is drawn as it is
seen from behind the cue, x' to the right and y' up.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.file import whole_recording
from models.recording.table import Out
from models.shot import Array, Ball
from models.table.palette import FLOOR_COLOUR, MODEL_COLOUR, Colour

CAMPAIGN_APPLICATION = "cuelab_campaign"
MEASURED_COLOUR: Colour = (255, 255, 255)
MISS_COLOUR: Colour = (255, 159, 28)
MISCUE_COLOUR: Colour = (255, 122, 217)
MM_PER_M = 1e3
CAMPAIGN_GUIDE = """
* **The ball from behind**: dots are where the cue's axis met it, of all strokes; the ring is this stroke.
* **White points**: measured. **Cyan points**: predicted by the cueing map. **Orange**: measured - predicted.
* **Squirt**: the ball's direction against the aim, > 0 to the left.
* **Pink**: a miscue, which no map predicts.
* **Timeline** `shot`: the strokes in the order in which they were played.
"""


@dataclass(frozen=True)
class Strokes:
    """Strokes in the order in which they were played, (n) of each."""

    number: Array  # counted from 1
    place: Array  # (n, 2) of the cue's axis from the ball's centre, to the right and up [m]
    cue_speed: Array  # (n,) [m/s]
    measured: Array  # (n, 2) speed of the ball [m/s], squirt [rad]
    predicted: Array  # (n, 2) of the same
    miscue: NDArray[np.bool_]  # (n,) whether it was one


def write_campaign(path: Path | str, strokes: Strokes, ball: Ball, *, title: str, words: str) -> None:
    """Write one Rerun recording of a campaign; the file appears whole or not at all.

    Raises BadInput where it cannot be written.
    """
    import rerun as rr

    digest = hashlib.sha256(repr((title, words, ball)).encode())
    for values in vars(strokes).values():
        digest.update(np.asarray(values, float).tobytes())
    views = _blueprint(ball, strokes.number)
    with whole_recording(path, CAMPAIGN_APPLICATION, digest.hexdigest()[:32], title, views) as stream:
        out = Out(rr, stream)
        _draw_ball(out, strokes, ball)
        _plot(out, strokes)
        _describe(out, strokes, title, words)


def _send(out: Out, path: str, kind: Any, data: dict[str, Any], number: Array) -> None:
    column = [out.rr.TimeColumn("shot", sequence=number.astype(int))]
    out.stream.send_columns(path, column, kind.columns(**data), strict=True)


def _draw_ball(out: Out, strokes: Strokes, ball: Ball) -> None:
    """The ball [mm], where all strokes met it, and where this one does; up is +y', which is down in a picture."""
    rr, flip = out.rr, np.array([1.0, -1.0])
    turn = np.linspace(0.0, 2 * math.pi, 97)
    circle = MM_PER_M * ball.radius * np.column_stack([np.cos(turn), np.sin(turn)])
    bars = [MM_PER_M * ball.radius * np.array(bar) for bar in ([[-1, 0], [1, 0]], [[0, -1], [0, 1]])]
    out.fixed("face/ball", rr.LineStrips2D([circle, *bars], colors=(120, 120, 120), radii=-1.0))
    colours = [MISCUE_COLOUR if bad else MEASURED_COLOUR for bad in strokes.miscue]
    places = MM_PER_M * strokes.place * flip
    out.fixed("face/strokes", rr.Points2D(places, colors=colours, radii=-2.0))
    style = {"colors": MODEL_COLOUR, "half_sizes": [[0.7, 0.7]], "line_radii": -2.0, "draw_order": 10.0}
    out.fixed("face/this", rr.Ellipses2D.from_fields(**style))
    _send(out, "face/this", rr.Ellipses2D, {"centers": places}, strokes.number)


def _plot(out: Out, strokes: Strokes) -> None:
    """Speed and squirt, measured and predicted, and their differences."""
    rr = out.rr
    known = np.where(np.asarray(strokes.miscue, bool)[:, None], math.nan, strokes.measured)
    miss = known - strokes.predicted
    for part, column, scale in (("speed", 0, 1.0), ("squirt", 1, 1e3)):
        curves = (("measured", strokes.measured, MEASURED_COLOUR), ("predicted", strokes.predicted, MODEL_COLOUR))
        for name, values, colour in curves:
            style = rr.SeriesPoints(colors=colour, names=name, marker_sizes=3.0 if name == "measured" else 2.0)
            out.fixed(f"{part}/{name}", style)
            _send(out, f"{part}/{name}", rr.Scalars, {"scalars": scale * values[:, column]}, strokes.number)
        style = rr.SeriesPoints(colors=MISS_COLOUR, names="measured - predicted", marker_sizes=3.0)
        out.fixed(f"miss/{part}", style)
        _send(out, f"miss/{part}", rr.Scalars, {"scalars": 1e3 * miss[:, column]}, strokes.number)


def _describe(out: Out, strokes: Strokes, title: str, words: str) -> None:
    """Words: the campaign, each stroke, how to read it."""
    style = {"media_type": "text/markdown"}
    out.fixed("text/campaign", out.rr.TextDocument(f"# {title}\n{words}", **style))
    out.fixed("text/guide", out.rr.TextDocument(CAMPAIGN_GUIDE, **style))
    pages = [_page(strokes, k) for k in range(len(strokes.number))]
    _send(out, "text/stroke", out.rr.TextDocument, {"text": pages, "media_type": ["text/markdown"] * len(pages)},
          strokes.number)  # fmt: skip


def _page(strokes: Strokes, k: int) -> str:
    """One stroke in words, Markdown."""
    (x, y), (speed, squirt), (speed_by_map, squirt_by_map) = (
        values[k].tolist() for values in (MM_PER_M * strokes.place, strokes.measured, strokes.predicted)
    )
    rows = [
        ("ball speed [m/s]", f"{speed:.3f}", f"{speed_by_map:.3f}"),
        ("squirt [mrad]", f"{1e3 * squirt:+.1f}", f"{1e3 * squirt_by_map:+.1f}"),
    ]
    miscue = "\n\n**A miscue.**" if strokes.miscue[k] else ""
    head = f"# Stroke {strokes.number[k]:.0f}\nCue at {strokes.cue_speed[k]:.2f} m/s, {x:+.1f} mm, {y:+.1f} mm.{miscue}"
    return "\n".join(
        [head, "", "| | measured | predicted |", "|---|---|---|", *("| " + " | ".join(r) + " |" for r in rows)]
    )


def _blueprint(ball: Ball, number: Array) -> Any:
    """The ball and words on the left, figures on the right, of all strokes by their number."""
    import rerun.blueprint as rrb

    r = 1.1 * MM_PER_M * ball.radius
    bounds = rrb.VisualBounds2D(x_range=[-r, r], y_range=[-r, r])
    face = rrb.Spatial2DView(
        origin="face", name="The ball from behind [mm]", visual_bounds=bounds, background=FLOOR_COLOUR
    )
    names = {"stroke": "This stroke", "campaign": "The campaign", "guide": "How to read this"}
    pages = [rrb.TextDocumentView(origin=f"text/{key}", name=name) for key, name in names.items()]
    figures = {
        "speed": "Speed of the ball [m/s]", "squirt": "Squirt [mrad]",
        "miss/speed": "Speed, measured - predicted [mm/s]", "miss/squirt": "Squirt, measured - predicted [mrad]",
    }  # fmt: skip
    edges = [rrb.TimeRangeBoundary.absolute(seq=int(edge)) for edge in (number.min(), number.max() + 1)]
    axis = rrb.TimeAxis(view_range=rrb.TimeRange(*edges))
    plots = [rrb.TimeSeriesView(origin=origin, name=name, axis_x=axis) for origin, name in figures.items()]
    left = rrb.Vertical(face, rrb.Tabs(*pages), row_shares=[3, 2])
    return rrb.Blueprint(
        rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[2, 3]),
        rrb.TimePanel(state="collapsed", timeline="shot", fps=4.0, loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
