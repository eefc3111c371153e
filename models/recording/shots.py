"""Shots to look at in the Rerun viewer: measured balls against modelled ones.

Clips follow one another on the timeline `shot_time` [s], each with its t = 0 at a whole second; `clip` counts them.
Error e(t) = modelled(t) - measured(t), the model interpolated linearly to the measured times, where both exist.

Left out: the balls' rotation. Cushions and pockets are drawn for orientation only. Row identifiers in the file come
from the clock; all that a reader of the file sees follows from the arguments.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.file import whole_recording
from models.recording.palette import (
    CLOTH_COLOUR,
    CUSHION_COLOUR,
    FLOOR_COLOUR,
    MODEL_COLOUR,
    POCKET_COLOUR,
    RAIL_COLOUR,
    WHITE_COLOUR,
    Colour,
    ball_colour,
)
from models.shot import NOSE_HEIGHT, Array, Ball, Event, Table, Track

Series = Mapping[str, tuple[Array, Array]]  # ball -> time (n,) [s] in its clip, increasing; values (n, k)

REVIEW_APPLICATION = "cuelab_review"
EVENT_MARKS = {
    "cushion": ("cushion", (255, 160, 0)),
    "ball": ("ball hits ball", (255, 70, 220)),
    "pocket": ("pot", WHITE_COLOUR),
}
CLIP_GAP_S = 0.5  # least pause between two clips [s]
UNSEEN_S = 0.05  # a ball without data for so long at its clip's end is hidden [s]
PATH_HEIGHT_M = 0.003  # height of paths over the cloth in the 3-D view [m]
MAX_LABELLED, MAX_LEGEND = 6, 9  # most events of a clip with words on the table; most balls named in the plots
REVIEW_GUIDE = """
* **Solid balls and dots**: measured, in the balls' own colours.
* **Cyan rings and lines**: the model. Where ring and ball part, the model is wrong.
* **Orange, magenta, white points**: the model's cushion contacts, ball contacts, pots.
* **Plots**: error = model - measured in mm, as distance, along x (length) and y (width); below, the model's speed.
* **Clips** play one after another, each from a whole second: *All clips* lists them, the timeline `clip` steps by one.
"""


@dataclass(frozen=True)
class Review:
    """One clip: where each ball was seen, and where the model has it."""

    name: str
    measured: Series  # values are xy (n, 2) [m], table frame; NaN where unseen
    modelled: Track | None = None
    note: str = ""
    colours: Mapping[str, Colour] = field(default_factory=dict)  # of balls, in place of the usual ones


@dataclass(frozen=True)
class _Clip:
    """A review on the timeline: t = 0 at `start`, everything within `first` to `last` [s]."""

    review: Review
    index: int  # 1, 2, ...
    start: float
    first: float
    last: float
    series: Mapping[str, Series]  # "measured", "modelled" x, y [m], "error" distance, x, y [mm]; "speed" [m/s]

    def events(self) -> list[tuple[Event, Array]]:
        """The model's events in order of time, each with the places of its balls (k, 2) [m], last ones if potted."""
        found = []
        for event in sorted(self.review.modelled.events if self.review.modelled else (), key=lambda event: event.time):
            paths = [_finite(*self.series["modelled"][name]) for name in event.balls if name in self.series["modelled"]]
            places = [[np.interp(event.time, time, axis) for axis in xy.T] for time, xy in paths if time.size]
            found.append((event, np.reshape(places, (-1, 2))))
        return found

    def distances(self, *names: str) -> Array:
        """Sizes of the position errors of the balls named, of all balls when none is: (m,) [mm]."""
        errors = [self.series["error"][name] for name in names or self.series["error"] if name in self.series["error"]]
        return np.concatenate([np.empty(0), *(_finite(*error)[1][:, 0] for error in errors)])


_Rows = tuple[Sequence[int] | Array, Sequence[float] | Array, Sequence[int] | Array]  # clip, time [s], instances


@dataclass(frozen=True)
class Out:
    """The open recording."""

    rr: Any  # the module
    stream: Any
    clips: Sequence[_Clip]

    def path(self, *parts: str) -> str:
        """An entity path, from parts that may hold any character."""
        return "/".join(self.rr.escape_entity_path_part(part) for part in parts)

    def fixed(self, path: str, *what: Any) -> None:
        """Log what holds at all times."""
        self.stream.log(path, *what, static=True, strict=True)

    def moving(self, path: str, kind: Any, style: Mapping[str, Any], data: Mapping[str, Any], rows: _Rows) -> None:
        """Log an archetype with a fixed style, if any, and the rows' instances of data."""
        if style:
            self.fixed(path, kind.from_fields(**style))
        time = self.rr.TimeColumn("shot_time", duration=np.asarray(rows[1], dtype=float))
        clip = self.rr.TimeColumn("clip", sequence=np.asarray(rows[0], dtype=int))
        self.stream.send_columns(path, [time, clip], kind.columns(**data).partition(rows[2]), strict=True)

    def names(self, who: str) -> list[str]:
        """Every ball of the series, over all clips, in order of appearance."""
        return list(dict.fromkeys(name for clip in self.clips for name in clip.series[who]))

    def colour(self, name: str) -> Colour:
        """The ball's colour in the first clip that gives it one, else its usual colour."""
        return next((c.review.colours[name] for c in self.clips if name in c.review.colours), ball_colour(name))

    def per_clip(self, count: Sequence[int] | None = None) -> _Rows:
        """One row at each clip's beginning."""
        return [c.index for c in self.clips], [c.first for c in self.clips], count or [1] * len(self.clips)


def write_review(path: Path | str, table: Table, ball: Ball, reviews: Sequence[Review], *, title: str) -> None:
    """Write one Rerun recording of all clips; the file appears whole or not at all.

    Raises ValueError for arrays that do not fit each other, BadInput where the file cannot be written.
    """
    import rerun as rr

    clips = _lay_out(reviews)
    digest = hashlib.sha256(repr((title, table, ball, [review.name for review in reviews])).encode())
    for time, values in (pair for clip in clips for series in clip.series.values() for pair in series.values()):
        digest.update(time.tobytes() + values.tobytes())
    blueprint = _blueprint(table, ball, clips)
    with whole_recording(path, REVIEW_APPLICATION, digest.hexdigest()[:32], title, blueprint) as stream:
        out = Out(rr, stream, clips)
        draw_table(out, table, ball)
        _draw_balls(out, ball)
        _draw_events(out, ball)
        _plot(out)
        _describe(out, title)


def _finite(time: Array, values: Array) -> tuple[Array, Array]:
    known = np.isfinite(values).all(axis=1)
    return time[known], values[known]


def _lay_out(reviews: Sequence[Review]) -> list[_Clip]:
    clips: list[_Clip] = []
    for index, review in enumerate(reviews, start=1):
        for name, (time, xy) in review.measured.items():
            if np.ndim(time) != 1 or np.shape(xy) != (len(time), 2):
                shapes = f"time {np.shape(time)}, xy {np.shape(xy)}"
                raise ValueError(f"clip {review.name!r}, ball {name!r}: {shapes}; want (n,) and (n, 2)")
        series: dict[str, dict[str, tuple[Array, Array]]]
        series = {"measured": dict(review.measured), "modelled": {}, "error": {}, "speed": {}}
        if (track := review.modelled) is not None:
            for column, name in enumerate(track.names):
                series["modelled"][name] = track.times, track.position[:, column]
                series["speed"][name] = track.times, np.hypot(*track.velocity[:, column].T)[:, None]
        for name in (name for name in review.measured if name in series["modelled"]):
            (time, xy), (times, path) = review.measured[name], series["modelled"][name]
            at = [np.interp(time, times, axis, left=math.nan, right=math.nan) for axis in path.T]
            e = 1e3 * (np.stack(at, axis=1) - xy)
            series["error"][name] = time, np.column_stack([np.hypot(*e.T), e])
        all_times = np.concatenate([np.zeros(1), *(time for one in series.values() for time, _ in one.values())])
        low, high = float(all_times.min()), float(all_times.max())
        start = math.ceil(clips[-1].last + CLIP_GAP_S - low) if clips else 0.0
        clips.append(_Clip(review, index, start, start + low, start + high, series))
    if not clips:
        raise ValueError("no clips to review")
    return clips


def draw_table(out: Out, table: Table, ball: Ball) -> None:
    rr, half, d, nose = out.rr, np.array([table.length, table.width]) / 2, ball.diameter, NOSE_HEIGHT * ball.radius
    out.fixed("top", rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])))  # up is +y on a table, -y in a picture
    layers = (("rail", 2.6 * d, RAIL_COLOUR), ("cushion", d, CUSHION_COLOUR), ("cloth", 0.0, CLOTH_COLOUR))
    for order, (name, margin, colour) in enumerate(layers):
        scale = half + margin  # an image of 2 by 2: the only thing that Rerun fills in 2-D
        image = rr.Image(np.full((2, 2, 3), colour, dtype=np.uint8), draw_order=order - 100)
        out.fixed(f"top/table/{name}", rr.Transform3D(translation=[*-scale, 0], scale=[*scale, 1]), image)
    (x, y), (u, v) = half + d / 2, half
    centres = [(0, 0, -0.01), (x, 0, nose / 2), (-x, 0, nose / 2), (0, y, nose / 2), (0, -y, nose / 2)]
    halves = [(*half + d, 0.01), *[(d / 2, v + d, nose / 2)] * 2, *[(u, d / 2, nose / 2)] * 2]
    colours = [CLOTH_COLOUR] + [CUSHION_COLOUR] * 4
    out.fixed("space/table", rr.Boxes3D(centers=centres, half_sizes=halves, colors=colours, fill_mode="solid"))
    if table.pockets:
        discs, r = pocket_discs(table)
        out.fixed("top/table/pockets", rr.Points2D(discs, radii=r, colors=POCKET_COLOUR, draw_order=-50))
        holes = {"lengths": 1.1 * nose, "radii": r, "centers": lift(discs, nose / 2), "fill_mode": "solid"}
        out.fixed("space/table/pockets", rr.Cylinders3D(**holes, colors=POCKET_COLOUR))


def pocket_discs(table: Table) -> tuple[Array, Array]:
    """Discs as wide as the mouths, for orientation: centres (6, 2) and radii (6,) [m]."""
    u, v, r, q = table.length / 2, table.width / 2, table.shapes.corner.mouth / 2, table.shapes.middle.mouth / 2
    corners = [(sx * (u + 0.3 * r), sy * (v + 0.3 * r)) for sx in (-1, 1) for sy in (-1, 1)]
    return np.array([*corners, (0, v + 0.8 * q), (0, -v - 0.8 * q)]), np.array([r] * 4 + [q] * 2)


def lift(xy: Array, height: float) -> Array:
    return np.column_stack([xy, np.full(len(xy), height)])


def _appearances(clips: Sequence[_Clip], who: str, name: str) -> tuple[_Rows, Array]:
    """Rows of a ball over all clips and its points (m, 2) [m]; a row without a point hides the ball."""
    index, times, shown, points = [], [], [], []
    for clip in clips:
        time, xy = clip.series[who].get(name, (np.empty(0), np.empty((0, 2))))
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(xy).all(axis=1))
        time = clip.start + time
        points.append(xy[seen])
        if not time.size or time[0] > clip.first:
            time, seen = np.append(clip.first, time), np.append(False, seen)
        if seen[-1] and time[-1] < clip.last - UNSEEN_S:
            time, seen = np.append(time, time[-1] + UNSEEN_S), np.append(seen, False)
        index.append(np.full(time.size, clip.index))
        times.append(time)
        shown.append(seen.astype(int))
    return (np.concatenate(index), np.concatenate(times), np.concatenate(shown)), np.concatenate(points)


def _draw_balls(out: Out, ball: Ball) -> None:
    """Balls as they move, and over each clip their whole paths: measured dots, modelled lines."""
    rr, r = out.rr, ball.radius
    for who, name in [(which, one) for which in ("measured", "modelled") for one in out.names(which)]:
        rows, xy = _appearances(out.clips, who, name)
        whole = [_finite(*clip.series[who][name])[1] if name in clip.series[who] else xy[:0] for clip in out.clips]
        things: list[tuple[str, str, Any, dict[str, Any], dict[str, Any], _Rows]]
        high, strips = lift(xy, r), [path for path in whole if len(path) > 1]
        if who == "measured":
            colour, dots, flat = out.colour(name), out.per_clip([len(path) for path in whole]), np.concatenate(whole)
            things = [
                ("top", "", rr.Points2D, {"radii": r, "draw_order": 20}, {"positions": xy}, rows),
                ("top", "_path", rr.Points2D, {"radii": -1.8, "draw_order": 0}, {"positions": flat}, dots),
                ("space", "", rr.Points3D, {"radii": r}, {"positions": high}, rows),
                ("space", "_path", rr.Points3D, {"radii": -1.5}, {"positions": lift(flat, PATH_HEIGHT_M)}, dots),
            ]
        else:
            colour, lines = MODEL_COLOUR, out.per_clip([int(len(path) > 1) for path in whole])
            ring = {"centers": xy, "half_sizes": np.full(xy.shape, r)}
            globe = {"centers": high, "half_sizes": np.full(high.shape, 1.04 * r)}
            glass = {"fill_mode": "transparentfillmajorwireframe", "line_radii": -0.7}
            raised = [lift(strip, PATH_HEIGHT_M) for strip in strips]
            things = [
                ("top", "", rr.Ellipses2D, {"line_radii": -1.5, "draw_order": 30}, ring, rows),
                ("top", "_path", rr.LineStrips2D, {"radii": -1.0, "draw_order": 10}, {"strips": strips}, lines),
                ("space", "", rr.Ellipsoids3D, glass, globe, rows),
                ("space", "_path", rr.LineStrips3D, {"radii": -1.0}, {"strips": raised}, lines),
            ]
        for view, part, kind, style, data, when in things:
            shared = {"colors": colour, "labels": f"{name}, {who}", "show_labels": False}
            out.moving(f"{view}/{out.path(who + part, name)}", kind, {**shared, **style}, data, when)


def _draw_events(out: Out, ball: Ball) -> None:
    """The model's contacts: a mark on the table for the whole clip, and one at zero in the plot of errors."""
    rr = out.rr
    for kind, (word, colour) in EVENT_MARKS.items():
        found = [(c, e, xy.mean(axis=0)) for c in out.clips for e, xy in c.events() if e.kind == kind and len(xy)]
        if found:
            words = [f"{word} {e.time:.2f} s" if len(c.events()) <= MAX_LABELLED else "" for c, e, _ in found]
            count = [sum(clip is c for c, *_ in found) for clip in out.clips]
            style = {"colors": colour, "radii": 0.35 * ball.radius, "draw_order": 40}
            data = {"positions": np.array([xy for *_, xy in found]), "labels": words}
            out.moving(f"top/event/{kind}", rr.Points2D, style, data, out.per_clip(count))
            rows = [c.index for c, *_ in found], [c.start + e.time for c, e, _ in found], [1] * len(found)
            style = {"colors": colour, "markers": "diamond", "marker_sizes": 5.0, "names": word}
            out.fixed(f"error/distance/event_{kind}", rr.SeriesPoints(**style))
            out.moving(f"error/distance/event_{kind}", rr.Scalars, {}, {"scalars": np.zeros(len(found))}, rows)


def _plot(out: Out) -> None:
    """Curves over time; a NaN after each clip keeps its curve apart from the next clip's."""
    rr = out.rr
    for who, plots in (("error", ("error/distance", "error/x", "error/y")), ("speed", ("speed",))):
        for name in out.names(who):
            index, times, values = [], [], []
            for clip in out.clips:
                time, value = clip.series[who].get(name, (np.empty(0), np.empty((0, len(plots)))))
                if time.size:
                    times.append(clip.start + np.append(time, time[-1] + 1e-3))
                    values.append(np.vstack([value, np.full(len(plots), math.nan)]))
                    index.append(np.full(time.size + 1, clip.index))
            if times:
                rows = (np.concatenate(index), np.concatenate(times), np.ones(sum(map(len, times)), dtype=int))
                colour = out.colour(name)
                colour = colour if max(colour) > 90 else (140, 140, 140)  # black shows on black
                for plot, column in zip(plots, np.concatenate(values).T, strict=True):
                    out.fixed(f"{plot}/{out.path(name)}", rr.SeriesLines(colors=colour, names=name, widths=1.5))
                    out.moving(f"{plot}/{out.path(name)}", rr.Scalars, {}, {"scalars": column}, rows)


def _rms(distances: Array) -> str:
    return f"{float(np.sqrt(np.mean(distances**2))):.2f} mm" if distances.size else "not known"


def _page(clip: _Clip, count: int) -> str:
    """The words on one clip, Markdown."""
    review = clip.review
    lines = [f"# {review.name}", f"Clip {clip.index} of {count}, from {clip.start:.0f} s. {review.note}\n"]
    if review.modelled is None:
        return "\n".join([*lines, "Measured only: the model has no track of this clip."])
    lines += [f"**rms position error {_rms(clip.distances())}**\n", "| ball | rms error | largest |", "|---|---|---|"]
    for name in review.measured:
        sizes = clip.distances(name)
        lines.append(f"| {name} | {_rms(sizes)} | {f'{sizes.max():.2f} mm' if sizes.size else ''} |")
    return "\n".join(lines)


def _describe(out: Out, title: str) -> None:
    """Words: how to read the review, each clip's errors, a list of the clips, what happens when."""
    rr, clips = out.rr, out.clips
    rms = _rms(np.concatenate([clip.distances() for clip in clips]))
    head = f"# {title}\n{len(clips)} clip{'s' * (len(clips) > 1)}, rms position error over all: {rms}\n"
    table = ["", "| from | clip | rms error | note |", "|---|---|---|---|"]
    names = [f"{clip.index}. {clip.review.name}: {_rms(clip.distances())}" for clip in clips]
    said = [(clip.index, clip.first, f"CLIP {name}", "INFO") for clip, name in zip(clips, names, strict=True)]
    for clip in clips:
        table.append(f"| {clip.start:.0f} s | {clip.review.name} | {_rms(clip.distances())} | {clip.review.note} |")
        for event, _ in clip.events():
            what = f"{EVENT_MARKS.get(event.kind, (event.kind,))[0]}: {' and '.join(event.balls)} {event.rail}".rstrip()
            said.append((clip.index, clip.start + event.time, what, "DEBUG"))
    out.fixed("text/guide", rr.TextDocument(head + REVIEW_GUIDE, media_type="text/markdown"))
    out.fixed("text/clips", rr.TextDocument(head + "\n".join(table), media_type="text/markdown"))
    pages = {"text": [_page(clip, len(clips)) for clip in clips], "media_type": ["text/markdown"] * len(clips)}
    out.moving("text/clip", rr.TextDocument, {}, pages, out.per_clip())
    out.moving("clips/rms", rr.StateChange, {}, {"state": names}, out.per_clip())
    index, time, text, level = zip(*sorted(said, key=lambda row: row[1]), strict=True)
    out.moving("text/log", rr.TextLog, {}, {"text": text, "level": level}, (index, time, [1] * len(said)))


def _blueprint(table: Table, ball: Ball, clips: Sequence[_Clip]) -> Any:
    """Table and words on the left, curves on the right, which follow the time cursor when there are several clips."""
    import rerun.blueprint as rrb

    x, y = np.array([table.length, table.width]) / 2 + 3 * ball.diameter
    longest, edge = max(clip.last - clip.first for clip in clips), rrb.TimeRangeBoundary.cursor_relative
    window = rrb.TimeRange(edge(seconds=-longest / 2), edge(seconds=longest))
    axis = rrb.TimeAxis(view_range=window) if len(clips) > 1 else None
    legend = rrb.PlotLegend("lefttop", visible=len({name for c in clips for name in c.review.measured}) <= MAX_LEGEND)

    def plot(origin: str, name: str, who: str, column: int) -> Any:
        curves = [[values[:, column] for _, values in clip.series[who].values()] for clip in clips]
        ends = [(np.nanmin(joined), np.nanmax(joined)) for joined in (np.concatenate([[0.0], *c]) for c in curves)]
        low, high = np.quantile([end[0] for end in ends], 0.1), np.quantile([end[1] for end in ends], 0.9)
        margin = 0.08 * (high - low) or 1.0
        scale = rrb.ScalarAxis(range=(low - margin, high + margin))
        return rrb.TimeSeriesView(origin=origin, name=name, axis_x=axis, axis_y=scale, plot_legend=legend)

    eye = rrb.EyeControls3D(kind="orbital", position=(0, -1.6 * y, 1.95 * y), look_target=(0, -0.1 * y, 0))
    # From the root, as a view leaves out the transform of its own origin.
    plan = {"origin": "/", "contents": "/top/**", "visual_bounds": rrb.VisualBounds2D(x_range=[-x, x], y_range=[-y, y])}
    above = rrb.Spatial2DView(**plan, name="Table from above", background=FLOOR_COLOUR)
    space = rrb.Spatial3DView(
        origin="space", name="Table in 3-D", eye_controls=eye, background=FLOOR_COLOUR, line_grid=False
    )
    guide = rrb.TextDocumentView(origin="text/guide", name="How to read this")
    listing = rrb.TextDocumentView(origin="text/clips", name="All clips")
    tabs = rrb.Tabs(guide, listing, rrb.TextLogView(origin="text/log", name="Log"))
    words = rrb.Horizontal(rrb.TextDocumentView(origin="text/clip", name="This clip"), tabs, column_shares=[2, 3])
    curves = rrb.Vertical(
        plot("error/distance", "Position error: distance, model to measured [mm]", "error", 0),
        plot("error/x", "Position error along x: model - measured [mm]", "error", 1),
        plot("error/y", "Position error along y: model - measured [mm]", "error", 2),
        plot("speed", "Speed of the model's balls [m/s]", "speed", 0),
        rrb.StateTimelineView(origin="clips", name="Clips, and their rms error"),
        row_shares=[4, 3, 3, 3, 1.7],
    )
    return rrb.Blueprint(
        rrb.Horizontal(rrb.Vertical(rrb.Tabs(above, space), words, row_shares=[5, 3]), curves, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="shot_time", loop_mode="all"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
