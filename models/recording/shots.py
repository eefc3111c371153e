"""Shots to look at in the Rerun viewer: measured balls against those of one model, or of every model of a ladder.

The recording opens at the first of the clips, so the one that shows most goes first. All models are in it; the table
shows the first and the last, and the others once their entity is made visible. Left out: the balls' rotation.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.messages import counted
from models.recording.clips import LaidClip, Review, ReviewOut, labels_of, lay_out
from models.recording.file import whole_recording
from models.recording.film import FILM_SCREEN, Film, draw_films
from models.recording.layers import (
    EVENT_MARKS,
    draw_events,
    draw_measured,
    draw_misses,
    draw_models,
    draw_spin,
    magnification,
    model_colours,
)
from models.recording.table import draw_table
from models.shot import Array, Ball, Table
from models.table.palette import FLOOR_COLOUR, Colour, ink

REVIEW_APPLICATION = "cuelab_review"
MAX_LEGEND = 6  # most curves that are named in a plot
REVIEW_GUIDE = """
* **Solid balls and dots**: measured, in the balls' own colours.
* **Cyan rings and lines**: the model. Where ring and ball part, the model is wrong.
* **Orange rings and lines**: the base, before effects were added. Models between the two are hidden at first: show or
  hide any of them by its eye in the blueprint panel (button at the top right), under *model*.
* **Orange, magenta, white points**: the model's cushion contacts, ball contacts, pots. **Arrows** there: the impulse on
  the ball, 1 m for 1 N s.
* **Magnified misses**: from where a ball was seen towards where a model has it.
* **Table in 3-D**: arrows on balls are the axes of their spin.
* **Plots**: error = model - measured in mm, as distance, along x (length) and y (width); below, the model's speed.
  Curves are in the balls' colours; distances of several models in the models' own, as their rings are.
* **Clips** play one after another, each from a whole second: *All clips* lists them, the timeline `clip` steps by one.
"""


def write_review(
    path: Path | str, table: Table, ball: Ball, reviews: Sequence[Review], *, title: str, films: Sequence[Film] = ()
) -> str:
    """Write one Rerun recording of all clips; the file appears whole or not at all.

    Films stand beside the table, in the time of their clips; what of them went in is returned in words, "" for none.
    Raises ValueError for arrays that do not fit each other, BadInput where the file cannot be written.
    """
    import rerun as rr

    clips = lay_out(reviews)
    digest = hashlib.sha256(repr((title, table, ball, [(r.name, r.note, *r.models) for r in reviews])).encode())
    each = [series for clip in clips for some in (clip.places, clip.errors) for series in some.values()]
    for time, values in (pair for series in each for pair in series.values()):
        digest.update(time.tobytes() + values.tobytes())
    for film in films:
        digest.update(film.identity())
    larger, labels = magnification(clips), labels_of(clips)
    blueprint = _blueprint(table, ball, clips, larger, filmed=bool(films))
    with whole_recording(path, REVIEW_APPLICATION, digest.hexdigest()[:32], title, blueprint) as stream:
        out = ReviewOut(rr, stream, clips)
        draw_table(out, table, ball)
        draw_measured(out, ball)
        draw_models(out, ball)
        draw_misses(out, larger)
        for last in labels[-1:]:
            draw_events(out, ball, last)
            draw_spin(out, ball, last)
        _plot(out)
        filmed = draw_films(out, films) if films else ""
        _describe(out, title, filmed)
    return filmed


def _plot(out: ReviewOut) -> None:
    """Curves over time: distances of every model, errors along the axes and speeds of the last one."""
    of_model = model_colours(labels := out.labels())
    for label in labels:
        last = label == labels[-1]
        for name in out.names(label):
            found = [(clip, *clip.errors[label][name]) for clip in out.clips if name in clip.errors.get(label, {})]
            path, colour, alone = out.path(name), out.curve_colour(name), len(labels) == 1
            words, distinct = (name, colour) if alone else (f"{name}, {label}", ink(of_model[label]))
            _curve(out, f"error/distance/{out.path(label)}/{path}", words, 1.5 if last else 1.0, found, distinct, 0)
            if last:
                _curve(out, f"error/x/{path}", name, 1.5, found, colour, 1)
                _curve(out, f"error/y/{path}", name, 1.5, found, colour, 2)
                _curve(out, f"speed/{path}", name, 1.5, _speeds(out.clips, label, name), colour, 0)


_Curve = Sequence[tuple[LaidClip, Array, Array]]  # clip, time (n,) [s], values (n, k)


def _speeds(clips: Sequence[LaidClip], label: str, name: str) -> _Curve:
    """Speeds of a model's ball (n, 1) [m/s]."""
    tracks = [(clip, clip.review.models[label]) for clip in clips if label in clip.review.models]
    return [
        (clip, track.times, np.hypot(*track.velocity[:, track.names.index(name)].T)[:, None])
        for clip, track in tracks
        if name in track.names
    ]


def _curve(out: ReviewOut, path: str, words: str, width: float, found: _Curve, colour: Colour, column: int) -> None:
    """One curve over all clips; a NaN after each clip keeps its curve apart from the next clip's."""
    found = [one for one in found if one[1].size]
    if not found:
        return
    times = [clip.start + np.append(time, time[-1] + 1e-3) for clip, time, _ in found]
    values = np.concatenate([np.append(value[:, column], math.nan) for *_, value in found])
    index = np.concatenate([np.full(len(time), one[0].index) for time, one in zip(times, found, strict=True)])
    rows = index, np.concatenate(times), np.ones(len(values), dtype=int)
    out.fixed(path, out.rr.SeriesLines(colors=colour, names=words, widths=width))
    out.moving(path, out.rr.Scalars, {}, {"scalars": values}, rows)


def _rms(distances: Array) -> str:
    return f"{float(np.sqrt(np.mean(distances**2))):.2f} mm" if distances.size else "not known"


def _row(*cells: str) -> str:
    """A row of a table in Markdown."""
    return f"| {' | '.join(cells)} |"


def _page(clip: LaidClip, count: int, labels: Sequence[str]) -> str:
    """The words on one clip, Markdown."""
    review = clip.review
    lines = [f"# {review.name}", f"Clip {clip.index} of {count}, from {clip.start:.0f} s. {review.note}\n"]
    if not review.models:
        return "\n".join([*lines, "Measured only: the model has no track of this clip."])
    lines += [f"**rms position error {_rms(clip.distances(labels[-1]))}**\n"]
    if len(labels) > 1:
        lines += ["| model | rms error |", "|---|---|"]
        lines += [_row(label, _rms(clip.distances(label))) for label in labels] + [""]
    lines += ["| ball | rms error | largest |", "|---|---|---|"]
    for name in review.measured:
        sizes = clip.distances(labels[-1], name)
        lines.append(_row(name, _rms(sizes), f"{sizes.max():.2f} mm" if sizes.size else ""))
    return "\n".join(lines)


def _describe(out: ReviewOut, title: str, filmed: str) -> None:
    """Words: how to read the review, each clip's errors, a list of the clips, what happens when."""
    rr, clips, labels = out.rr, out.clips, out.labels()
    last = labels[-1] if labels else ""
    every = {label: _rms(np.concatenate([clip.distances(label) for clip in clips])) for label in labels}
    rms = "; ".join(f"{label}: {size}" for label, size in every.items()) if len(labels) > 1 else every.get(last, "")
    head = f"# {title}\n{counted(len(clips), 'clip')}, rms position error over all: {rms or 'not known'}\n"
    head += f"\nFilm: {filmed}\n" if filmed else ""
    table = ["", _row("from", "clip", *([f"rms error, {x}" for x in labels] or ["rms error"]), "note")]
    table.append("|---" * (3 + max(1, len(labels))) + "|")
    names = [f"{clip.index}. {clip.review.name}: {_rms(clip.distances(last))}" for clip in clips]
    said = [(clip.index, clip.first, f"CLIP {name}", "INFO") for clip, name in zip(clips, names, strict=True)]
    for clip in clips:
        errors = [_rms(clip.distances(label)) for label in labels or [""]]
        table.append(_row(f"{clip.start:.0f} s", clip.review.name, *errors, clip.review.note))
        for event, _ in clip.events(last):
            what = f"{EVENT_MARKS.get(event.kind, (event.kind,))[0]}: {' and '.join(event.balls)} {event.rail}".rstrip()
            said.append((clip.index, clip.start + event.time, what, "DEBUG"))
    out.fixed("text/guide", rr.TextDocument(head + REVIEW_GUIDE, media_type="text/markdown"))
    out.fixed("text/clips", rr.TextDocument(head + "\n".join(table), media_type="text/markdown"))
    pages = [_page(clip, len(clips), labels) for clip in clips]
    documents = {"text": pages, "media_type": ["text/markdown"] * len(clips)}
    out.moving("text/clip", rr.TextDocument, {}, documents, out.per_clip())
    out.moving("clips/rms", rr.StateChange, {}, {"state": names}, out.per_clip())
    index, time, text, level = zip(*sorted(said, key=lambda row: row[1]), strict=True)
    out.moving("text/log", rr.TextLog, {}, {"text": text, "level": level}, (index, time, [1] * len(said)))


def _table_views(table: Table, ball: Ball, labels: Sequence[str], larger: int) -> tuple[Any, Any, Any]:
    """The table from above, the same in 3-D, and the magnified misses; models between first and last are hidden."""
    import rerun as rr
    import rerun.blueprint as rrb

    x, y = np.array([table.length, table.width]) / 2 + 3 * ball.diameter

    def hidden(origin: str) -> dict[str, Any]:
        behaviour = rrb.EntityBehavior(visible=False)
        return {f"{origin}/{rr.escape_entity_path_part(label)}": behaviour for label in labels[1:-1]}

    # From the root, as a view leaves out the transform of its own origin.
    plan = {"origin": "/", "background": FLOOR_COLOUR}
    plan["visual_bounds"] = rrb.VisualBounds2D(x_range=[-x, x], y_range=[-y, y])
    above = rrb.Spatial2DView(
        **plan, name="Table from above", contents=["+ /top/**", "- /top/miss/**"], overrides=hidden("top/model")
    )
    seen = ["+ /top", "+ /top/table/**", "+ /top/measured_path/**", "+ /top/miss/**"]
    name = f"Misses, {larger} times larger" if larger > 1 else "Misses"
    missed = rrb.Spatial2DView(**plan, name=name, contents=seen, overrides=hidden("top/miss"))
    eye = rrb.EyeControls3D(kind="orbital", position=(0, -1.6 * y, 1.95 * y), look_target=(0, -0.1 * y, 0))
    space = rrb.Spatial3DView(
        origin="space", name="Table in 3-D", eye_controls=eye, background=FLOOR_COLOUR, line_grid=False,
        overrides=hidden("space/model"),
    )  # fmt: skip
    return above, space, missed


def _arranged(tables: Any, missed: Any, words: Any, curves: Any, *, filmed: bool, modelled: bool) -> Any:
    """The views on the screen; where nothing is modelled there is no error to draw."""
    import rerun.blueprint as rrb

    if filmed:
        film = rrb.Spatial2DView(origin=FILM_SCREEN, name="Film", background=FLOOR_COLOUR)
        below = rrb.Horizontal(words, curves, column_shares=[2, 3])
        return rrb.Vertical(rrb.Horizontal(film, tables, column_shares=[1, 1]), below, row_shares=[1, 1])
    if not modelled:
        return rrb.Horizontal(tables, rrb.Vertical(words, curves), column_shares=[3, 2])
    below = rrb.Horizontal(missed, words, column_shares=[1, 1])
    return rrb.Horizontal(rrb.Vertical(tables, below, row_shares=[5, 3]), curves, column_shares=[3, 2])


def _blueprint(table: Table, ball: Ball, clips: Sequence[LaidClip], larger: int, *, filmed: bool) -> Any:
    """Table, misses and words on the left; curves on the right, which follow the time cursor of several clips.

    A film takes the place of the misses, which are then a tab beside the table.
    """
    import rerun as rr
    import rerun.blueprint as rrb

    longest, edge = max(clip.last - clip.first for clip in clips), rrb.TimeRangeBoundary.cursor_relative
    window = rrb.TimeRange(edge(seconds=-longest / 2), edge(seconds=longest))
    axis = rrb.TimeAxis(view_range=window) if len(clips) > 1 else None
    labels, count = labels_of(clips), len({name for c in clips for name in c.review.measured})

    def plot(origin: str, name: str, curves: list[list[Array]], models: int = 1, **more: Any) -> Any:
        ends = [(np.nanmin(joined), np.nanmax(joined)) for joined in (np.concatenate([[0.0], *c]) for c in curves)]
        low, high = np.quantile([end[0] for end in ends], 0.1), np.quantile([end[1] for end in ends], 0.9)
        margin = 0.08 * (high - low) or 1.0
        scale = rrb.ScalarAxis(range=(low - margin, high + margin))
        legend = rrb.PlotLegend("lefttop", visible=models * count <= MAX_LEGEND)
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=axis, axis_y=scale, plot_legend=legend, **more)

    def errors(column: int, *models: str) -> list[list[Array]]:
        known = [[v for label in models for _, v in clip.errors.get(label, {}).values()] for clip in clips]
        return [[values[:, column] for values in some] for some in known]

    last, ends = labels[-1:], dict.fromkeys([*labels[:1], *labels[-1:]])
    hidden = {
        f"error/distance/{rr.escape_entity_path_part(label)}": rrb.EntityBehavior(visible=False)
        for label in labels[1:-1]
    }
    tracks = [[one for label, one in clip.review.models.items() if label in last] for clip in clips]
    speeds = [[np.hypot(*np.moveaxis(one.velocity, -1, 0)).ravel() for one in some] for some in tracks]
    above, space, missed = _table_views(table, ball, labels, larger)
    guide = rrb.TextDocumentView(origin="text/guide", name="How to read this")
    listing = rrb.TextDocumentView(origin="text/clips", name="All clips")
    this = rrb.TextDocumentView(origin="text/clip", name="This clip")
    tabs = rrb.Tabs(this, guide, listing, rrb.TextLogView(origin="text/log", name="Log"))
    distance = "Position error: distance, model to measured [mm]"
    plots = [
        plot("error/distance", distance, errors(0, *ends), len(ends), overrides=hidden),
        plot("error/x", "Position error along x: model - measured [mm]", errors(1, *last)),
        plot("error/y", "Position error along y: model - measured [mm]", errors(2, *last)),
        plot("speed", "Speed of the model's balls [m/s]", speeds),
    ]
    listed = rrb.StateTimelineView(origin="clips", name="Clips, and their rms error")
    curves = rrb.Vertical(*plots, listed, row_shares=[4, 3, 3, 3, 1.7])
    if filmed:
        curves = rrb.Vertical(rrb.Tabs(*plots), listed, row_shares=[3, 1])
    tables = rrb.Tabs(above, space, *([missed] if labels and filmed else []))
    whole = _arranged(tables, missed, tabs, curves if labels else listed, filmed=filmed, modelled=bool(labels))
    return rrb.Blueprint(
        whole,
        rrb.TimePanel(state="collapsed", timeline="shot_time", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
