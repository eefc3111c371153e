"""A series of shots to look at in the Rerun viewer: where each was to go, where it went, and how the miss fell.

`shot` counts the shots: on this timeline the table shows how each one ended, and the curves run over the series. On
`shot_time` [s] the balls roll as filmed, one shot after another, each with its t = 0 at a whole second. Left out: the
third dimension, and what the refits made of single films. The same values give the same recording.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.recording.clips import CLIP_GAP_S, UNSEEN_S, LaidClip, Review, ReviewOut
from models.recording.file import whole_recording
from models.recording.film import FILM_SCREEN, Film, draw_films
from models.recording.series import STORY_CURVES, TARGET_COLOUR, SeriesRecording, SeriesShot, Way
from models.recording.table import Out, draw_table
from models.shot import Array, Ball, Table
from models.table.palette import FLOOR_COLOUR, MODEL_COLOUR, WHITE_COLOUR, ball_colour, ink

if TYPE_CHECKING:
    from models.recording.viewer import Feed

STORY_APPLICATION, LIVE_APPLICATION = "cuelab_story", "cuelab_live_series"
STORY_GUIDE = """
* **Solid balls and thick lines**: as filmed, in the balls' own colours. **Thin cyan lines**: as planned.
* **Orange cross**: where the cue ball was commanded to stop; the **arrow** leads from there to where it did.
* **White circle**: where it was wanted. **Thin rings**: where the balls lay.
* **Timelines**: `shot` steps from shot to shot and shows how each ended; on `shot_time` the balls roll.
* **Curves**, in mm over the shots: they end at the launcher's own scatter, if all else was learnt.
"""


def write_story(path: Path | str, recording: SeriesRecording, *, title: str, films: Sequence[Film] = ()) -> str:
    """Write one Rerun recording of a series; what of films went in, in words. The file appears whole or not at all.

    Raises BadInput where it cannot be written.
    """
    import rerun as rr

    table, ball = recording.table, recording.ball
    blueprint, digest = _blueprint(table, ball, filmed=bool(films)), _digest(recording, title, films)
    with whole_recording(path, STORY_APPLICATION, digest, title, blueprint) as stream:
        out = _Drawing(rr, stream, _lay_out(recording.scenes))
        draw_table(out, table, ball)
        _draw_story(out, recording, title)
        return draw_films(out.as_clips(), films) if films else ""


class LiveStory:
    """A series in the viewer while it is played."""

    def __init__(self, feed: Feed, title: str, table: Table, ball: Ball) -> None:
        """Begin to show a series on a table."""
        import rerun as rr

        self._rr, self._title, self._ends, self._said = rr, title, dict[int, float](), dict[int, str]()
        self._stream = feed.stream(
            LIVE_APPLICATION, title, _blueprint(table, ball, play_state="following", loop_mode="off")
        )
        draw_table(Out(rr, self._stream), table, ball)

    def show(self, recording: SeriesRecording) -> None:
        """Show shots that are new, or known better than before, and the lessons of the recording."""
        before = max((end for number, end in self._ends.items() if number < recording.scenes[0].number), default=None)
        laid = _lay_out(recording.scenes, before)
        self._ends |= {one.scene.number: one.last for one in laid}
        _draw_story(_Drawing(self._rr, self._stream, laid, dict(self._said)), recording, self._title)
        self._said |= {one.scene.number: one.scene.words for one in laid}


def _draw_story(out: _Drawing, recording: SeriesRecording, title: str) -> None:
    """The shots that are laid out, their curves and all words."""
    _draw_balls(out, recording.ball)
    _draw_marks(out, recording.ball)
    if any(one.scene.curves for one in out.laid):  # none of a shot that is planned only
        _plot(out)
    _describe(out, recording, title)


@dataclass(frozen=True)
class _Laid:
    """A shot on the timeline: t = 0 at `start`, everything until `last` [s]."""

    scene: SeriesShot
    start: float
    last: float


@dataclass(frozen=True)
class _Drawing(Out):
    """The open recording, with the shots one after another."""

    laid: Sequence[_Laid]
    said: Mapping[int, str] = field(default_factory=dict)  # lines that the log has, by shot

    def names(self, who: str) -> list[str]:
        """Every ball in `start`, `planned` or `played` of the shots, in order of appearance."""
        return list(dict.fromkeys(name for one in self.laid for name in getattr(one.scene, who)))

    def send(self, path: str, kind: Any, style: Mapping[str, Any], data: Mapping[str, Any], rows: Any) -> None:
        """Log an archetype with a fixed style; rows are (shot, time [s], instances)."""
        shot, time, count = (np.asarray(part) for part in rows)
        if not len(shot):
            return
        if style:
            self.fixed(path, kind.from_fields(**style))
        columns = [self.rr.TimeColumn("shot", sequence=shot.astype(int))]
        columns.append(self.rr.TimeColumn("shot_time", duration=time.astype(float)))
        self.stream.send_columns(path, columns, kind.columns(**data).partition(count.astype(int)), strict=True)

    def as_clips(self) -> ReviewOut:
        """The shots as films take them."""
        clips = [
            LaidClip(Review(one.scene.clip, {}), one.scene.number, one.start, one.start, one.last, {}, {})
            for one in self.laid
        ]
        return ReviewOut(self.rr, self.stream, clips, "shot")

    def per_shot(self, count: Sequence[int] | None = None) -> tuple[list[int], list[float], Sequence[int]]:
        """One row at each shot's beginning."""
        laid = self.laid
        return [one.scene.number for one in laid], [one.start for one in laid], count or [1] * len(laid)


def _digest(recording: SeriesRecording, title: str, films: Sequence[Film]) -> str:
    """Of all that is shown."""
    digest = hashlib.sha256(repr((title, recording.table, recording.ball, recording.words, recording.lessons)).encode())
    for film in films:
        digest.update(film.identity())
    for scene in recording.scenes:
        digest.update(repr((scene.number, scene.words, scene.page, sorted(scene.curves.items()))).encode())
        places = [scene.target, scene.stopped, scene.wanted, *scene.start.values()]
        ways = [part for who in (scene.planned, scene.played) for way in who.values() for part in way]
        for values in (np.empty(0) if part is None else np.asarray(part, float) for part in [*places, *ways]):
            digest.update(values.tobytes())
    return digest.hexdigest()[:32]


def _lay_out(scenes: Sequence[SeriesShot], before: float | None = None) -> list[_Laid]:
    """The shots one after another, each from a whole second, after others that end at `before` [s]."""
    laid: list[_Laid] = []
    for scene in scenes:
        times = [time for who in (scene.planned, scene.played) for time, _ in who.values()]
        for name, (time, xy) in (pair for who in (scene.planned, scene.played) for pair in who.items()):
            if np.ndim(time) != 1 or np.shape(xy) != (len(time), 2):
                shapes = f"time {np.shape(time)}, xy {np.shape(xy)}"
                raise ValueError(f"shot {scene.number}, ball {name!r}: {shapes}; want (n,) and (n, 2)")
        whole = np.concatenate([np.zeros(1), *times])
        last = laid[-1].last if laid else before
        start = 0.0 if last is None else math.ceil(last + CLIP_GAP_S - float(whole.min()))
        laid.append(_Laid(scene, start, start + float(whole.max())))
    return laid


def _line(way: Way | None) -> Array:
    """Where a ball was, without what is not known: (n, 2) [m]."""
    return np.empty((0, 2)) if way is None else np.asarray(way[1])[np.isfinite(way[1]).all(axis=1)]


def _draw_balls(out: _Drawing, ball: Ball) -> None:
    """Balls as filmed, at their places where there is no film; their ways, planned and played, over the whole shot."""
    rr, r = out.rr, ball.radius
    for who, radius, order in (("planned", -0.8, 12.0), ("played", -1.8, 10.0)):
        for name in out.names(who):
            lines = [_line(getattr(one.scene, who).get(name)) for one in out.laid]
            strips = [line for line in lines if len(line) > 1]
            style = {
                "radii": radius,
                "colors": MODEL_COLOUR if who == "planned" else ball_colour(name),
                "draw_order": order,
            }
            rows = out.per_shot([int(len(line) > 1) for line in lines])
            out.send(f"top/{who}/{out.path(name)}", rr.LineStrips2D, style, {"strips": strips}, rows)
    for name in dict.fromkeys([*out.names("start"), *out.names("played")]):
        shot, times, shown, points = [], [], [], []
        for one in out.laid:
            time, xy, known = _appearance(one, name)
            shot += [one.scene.number] * len(time)
            times += list(one.start + time)
            shown += known.astype(int).tolist()
            points.append(xy[known])
        style = {"radii": r, "colors": ball_colour(name), "labels": name, "show_labels": False, "draw_order": 20.0}
        data = {"positions": np.concatenate([np.empty((0, 2)), *points])}
        out.send(f"top/ball/{out.path(name)}", rr.Points2D, style, data, (shot, times, shown))
    for name in out.names("start"):
        lies = [one.scene.start.get(name) for one in out.laid]
        rings = np.array([xy for xy in lies if xy is not None]).reshape(-1, 2)
        style = {"line_radii": -0.6, "colors": ball_colour(name), "draw_order": 15.0}
        data = {"centers": rings, "half_sizes": np.full(rings.shape, r)}
        rows = out.per_shot([int(xy is not None) for xy in lies])
        out.send(f"top/start/{out.path(name)}", rr.Ellipses2D, style, data, rows)


def _appearance(one: _Laid, name: str) -> tuple[Array, Array, Any]:
    """Times (n,) [s], places (n, 2) [m] of a ball in a shot and whether it is seen (n,); a row unseen hides it."""
    scene = one.scene
    if name not in scene.played:
        lies = scene.start.get(name)
        if lies is None or scene.played:  # where there is a film, what it does not show is not there
            return np.zeros(1), np.full((1, 2), math.nan), np.zeros(1, bool)
        return np.zeros(1), np.reshape(lies, (1, 2)), np.ones(1, bool)
    time, xy = np.asarray(scene.played[name][0], float), np.asarray(scene.played[name][1], float)
    if not len(time) or time[0] > 0:
        time, xy = np.append(0.0, time), np.vstack([scene.start.get(name, np.full(2, math.nan)), xy])
    if time[-1] < max((t[-1] for t, _ in scene.played.values() if len(t)), default=0.0) - UNSEEN_S:
        time, xy = np.append(time, time[-1] + UNSEEN_S), np.vstack([xy, np.full(2, math.nan)])
    return time, xy, np.isfinite(xy).all(axis=1)


def _draw_marks(out: _Drawing, ball: Ball) -> None:
    """Where the cue ball was commanded to stop, where it stopped, where it was wanted."""
    rr, r = out.rr, ball.radius
    scenes = [one.scene for one in out.laid]
    targets = [s.target if s.target is not None and np.isfinite(s.target).all() else None for s in scenes]
    bars = [
        [xy + r * np.array(bar) for bar in ([[-1, -1], [1, 1]], [[-1, 1], [1, -1]])] for xy in targets if xy is not None
    ]
    style: dict[str, Any] = {"radii": -1.6, "colors": TARGET_COLOUR, "draw_order": 40.0}
    rows = out.per_shot([0 if xy is None else 2 for xy in targets])
    out.send("top/target", rr.LineStrips2D, style, {"strips": [bar for pair in bars for bar in pair]}, rows)
    pairs = [None if a is None or s.stopped is None else (a, s.stopped) for a, s in zip(targets, scenes, strict=True)]
    known = np.array([pair for pair in pairs if pair is not None]).reshape(-1, 2, 2)
    data = {"origins": known[:, 0], "vectors": known[:, 1] - known[:, 0]}
    style = {"radii": -1.4, "colors": TARGET_COLOUR, "draw_order": 45.0}
    out.send("top/miss", rr.Arrows2D, style, data, out.per_shot([int(pair is not None) for pair in pairs]))
    for part, colour, places in (
        ("stopped", TARGET_COLOUR, [s.stopped for s in scenes]), ("wanted", WHITE_COLOUR, [s.wanted for s in scenes])
    ):  # fmt: skip
        rings = np.array([xy for xy in places if xy is not None]).reshape(-1, 2)
        data = {"centers": rings, "half_sizes": np.full(rings.shape, 1.2 * r)}
        style = {"line_radii": -1.4, "colors": colour, "draw_order": 42.0}
        out.send(f"top/{part}", rr.Ellipses2D, style, data, out.per_shot([int(xy is not None) for xy in places]))


def _plot(out: _Drawing) -> None:
    """Miss and forecast of every shot [mm]; a shot without leaves a gap."""
    rr = out.rr
    for key, (name, colour) in STORY_CURVES.items():
        values = [1e3 * one.scene.curves.get(key, math.nan) for one in out.laid]
        if key == "miss":
            style = rr.SeriesPoints(colors=ink(colour), names=name, marker_sizes=4.0)
        else:
            style = rr.SeriesLines(colors=ink(colour), names=name, widths=2.0)
        out.fixed(f"plot/{key}", style)
        out.send(f"plot/{key}", rr.Scalars, {}, {"scalars": values}, out.per_shot())


def _describe(out: _Drawing, recording: SeriesRecording, title: str) -> None:
    """Words: the series, how to read it, each shot, what refits found."""
    rr, style = out.rr, {"media_type": "text/markdown"}
    out.fixed("text/series", rr.TextDocument(f"# {title}\n{recording.words}", **style))
    out.fixed("text/guide", rr.TextDocument(STORY_GUIDE, **style))
    pages = [one.scene.page or one.scene.words for one in out.laid]
    data = {"text": pages, "media_type": ["text/markdown"] * len(pages)}
    out.send("text/shot", rr.TextDocument, {}, data, out.per_shot())
    new = [one for one in out.laid if out.said.get(one.scene.number) != one.scene.words]
    log = {"text": [one.scene.words for one in new], "level": ["DEBUG"] * len(new)}
    rows = [one.scene.number for one in new], [one.start for one in new], [1] * len(new)
    out.send("log/shot", rr.TextLog, {}, log, rows)
    last = {one.scene.number: one.last for one in out.laid}
    lessons = [(shots, last.get(shots, max(last.values(), default=0.0)), text) for shots, text in recording.lessons]
    if lessons:
        shots, times, texts = zip(*lessons, strict=True)
        log = {"text": list(texts), "level": ["INFO"] * len(texts)}
        out.send("log/refit", rr.TextLog, {}, log, (shots, times, [1] * len(texts)))


def _blueprint(table: Table, ball: Ball, *, filmed: bool = False, **playing: str) -> Any:
    """Table, film and log on the left, curves and words on the right; `playing` is how time runs at first."""
    import rerun.blueprint as rrb

    x, y = np.array([table.length, table.width]) / 2 + 3 * ball.diameter
    # From the root, as a view leaves out the transform of its own origin.
    plan = {"origin": "/", "contents": "/top/**", "visual_bounds": rrb.VisualBounds2D(x_range=[-x, x], y_range=[-y, y])}
    above = rrb.Spatial2DView(**plan, name="The shot from above", background=FLOOR_COLOUR)
    curves = rrb.TimeSeriesView(
        origin="plot", name="Miss of the cue ball over the shots [mm]", plot_legend=rrb.Corner2D.RightTop
    )
    log = rrb.TextLogView(origin="log", name="Shots, and what refits found")
    series = rrb.TextDocumentView(origin="text/series", name="The series")
    guide = rrb.TextDocumentView(origin="text/guide", name="How to read this")
    shot = rrb.TextDocumentView(origin="text/shot", name="This shot")
    film = [rrb.Spatial2DView(origin=FILM_SCREEN, name="Film", background=FLOOR_COLOUR)] * filmed
    left = rrb.Vertical(above, *film, log, row_shares=[5, *[5] * filmed, 2])
    right = rrb.Vertical(curves, rrb.Tabs(shot, series, guide), row_shares=[1, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="shot", fps=1.0, **{"loop_mode": "all"} | playing),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
