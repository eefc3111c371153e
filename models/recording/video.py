"""Tracked footage to look at in the Rerun viewer: the video with what was detected, and the tracks on the table.

Everything lies on the timeline `video_time` [s], and `frame` counts the frames. A video that the viewer can play (see
models/recording/film.py) is put in as it is; otherwise pictures follow, reduced and compressed. Both show the same
frames; marks are in the video's own pixels.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.file import whole_recording
from models.recording.film import jpeg, playable_stamps
from models.recording.table import pocket_discs
from models.shot import Array, Table
from models.table.palette import CLOTH_COLOUR, FLOOR_COLOUR, POCKET_COLOUR, ball_colour, ink

TRACK_APPLICATION = "cuelab_track"
MAX_WIDTH_PX = 960  # of single pictures [pixels]
UNSEEN_PERIODS = 2.5  # periods without a sighting after which a ball is hidden
TRACK_GUIDE = """
* **Rings on the video**: detections, in the balls' colours; a ball without a ring was not seen in that frame.
* **Table from above**: where the balls are, with their paths in the shot that is on.
* **Residual**: how far a sighting lies from a cubic through its four neighbours: noise, and a peak at every impact.
"""


@dataclass(frozen=True)
class Sightings:
    """Where one ball was seen."""

    frame: NDArray[np.int64]  # (n,) index of the frame
    time: Array  # (n,) [s]
    pixels: Array  # (n, 2) centre of its outline
    radius: Array  # (n,) of its outline [pixels]
    xy: Array  # (n, 2) [m], table frame
    residual: Array  # (n,) [m]; NaN where it is not known


def write_track(
    path: Path | str,
    video: Path | str,
    frames: tuple[NDArray[np.int64], Array],
    pictures: Callable[[], Iterable[NDArray[np.uint8]]],
    balls: Mapping[str, Sightings],
    shots: Sequence[tuple[float, float, str]],
    table: Table,
    diameter: float,
) -> None:
    """Write one Rerun recording of tracked footage; the file appears whole or not at all.

    Args:
        path: the recording.
        video: the footage; put in as it is where the viewer can play it.
        frames: indices (m,) and times (m,) [s] of its frames.
        pictures: gives these frames (height, width, 3), blue, green, red, in order; used where it cannot.
        balls: sightings by name.
        shots: when each begins and ends [s], and what there is to say of it.
        table: below the balls.
        diameter: of the balls [m].
    """
    import rerun as rr

    digest = hashlib.sha256(repr((table, diameter, shots, *balls)).encode())
    for one in balls.values():
        digest.update(one.time.tobytes() + one.xy.tobytes())
    title, blueprint = f"{Path(video).name}: {len(shots)} shots", _blueprint(table, diameter)
    with whole_recording(path, TRACK_APPLICATION, digest.hexdigest()[:32], title, blueprint) as stream:
        _video(rr, stream, Path(video), frames, pictures)
        draw_cloth(rr, stream, table)
        period = float(np.median(np.diff(frames[1]))) if len(frames[1]) > 1 else 1.0
        for name, one in balls.items():
            _ball(rr, stream, name, one, period, diameter)
            _path(rr, stream, name, one, shots)
        _words(rr, stream, shots)


def _columns(rr: Any, time: Array, frame: NDArray[np.int64] | None) -> list[Any]:
    found = [rr.TimeColumn("video_time", duration=np.asarray(time, float))]
    return found if frame is None else [*found, rr.TimeColumn("frame", sequence=np.asarray(frame, int))]


def _video(
    rr: Any, stream: Any, video: Path, frames: tuple[NDArray[np.int64], Array],
    pictures: Callable[[], Iterable[NDArray[np.uint8]]],
) -> None:  # fmt: skip
    """The footage itself, or its pictures."""
    index, time = frames
    stamps = playable_stamps(video)
    if stamps is not None and len(index) and index[-1] < len(stamps):
        stream.log("picture/video", rr.AssetVideo(path=video), static=True)
        references = rr.VideoFrameReference.columns_nanos(stamps[index])
        stream.send_columns("picture/video", _columns(rr, time, index), references)
        return
    for when, number, picture in zip(time, index, pictures(), strict=False):
        stream.set_time("video_time", duration=float(when))
        stream.set_time("frame", sequence=int(number))
        if number == index[0]:
            stream.log("picture/video", rr.Transform3D(scale=enlarged(picture)), static=True)
        stream.log("picture/video", rr.EncodedImage(contents=jpeg(picture, MAX_WIDTH_PX), media_type="image/jpeg"))
    stream.reset_time()


def enlarged(picture: NDArray[np.uint8]) -> Array:
    """By what a reduced picture is enlarged to its own pixels: (3,)."""
    scale = max(1.0, picture.shape[1] / MAX_WIDTH_PX)
    return np.array([scale, scale, 1.0])


def draw_cloth(rr: Any, stream: Any, table: Table) -> None:
    """The cloth from above; up is +y on a table, -y in a picture."""
    stream.log("top", rr.Transform3D(mat3x3=np.diag([1.0, -1.0, 1.0])), static=True)
    half = np.array([table.length, table.width]) / 2
    place = rr.Transform3D(translation=[*-half, 0], scale=[*half, 1])
    cloth = rr.Image(np.full((2, 2, 3), CLOTH_COLOUR, dtype=np.uint8), draw_order=-100)
    stream.log("top/table/cloth", place, cloth, static=True)
    if table.pockets:
        discs, radii = pocket_discs(table)
        points = rr.Points2D(discs, radii=radii, colors=POCKET_COLOUR, draw_order=-50)
        stream.log("top/table/pockets", points, static=True)


def _ball(rr: Any, stream: Any, name: str, one: Sightings, period: float, diameter: float) -> None:
    """A ball on the video and on the table, hidden while it was not seen, and how its sightings scatter."""
    part, colour = rr.escape_entity_path_part(name), ball_colour(name)
    colour = colour if max(colour) > 90 else (140, 140, 140)  # black shows on black
    gone = np.append(np.diff(one.time) > UNSEEN_PERIODS * period, True)
    order = np.argsort(np.concatenate([one.time, one.time[gone] + 0.5 * period]), kind="stable")
    time = np.concatenate([one.time, one.time[gone] + 0.5 * period])[order]
    frame = np.concatenate([one.frame, one.frame[gone]])[order]
    count = np.concatenate([np.ones(len(one.time), int), np.zeros(int(gone.sum()), int)])[order]
    columns = _columns(rr, time, frame)
    rings = rr.Ellipses2D.columns(centers=one.pixels, half_sizes=np.repeat(one.radius[:, None], 2, axis=1))
    stream.log(f"picture/{part}", rr.Ellipses2D.from_fields(colors=colour, line_radii=-1.0, draw_order=10), static=True)
    stream.send_columns(f"picture/{part}", columns, rings.partition(count))
    dots = rr.Points2D.columns(positions=one.xy)
    stream.log(
        f"top/ball/{part}", rr.Points2D.from_fields(colors=colour, radii=diameter / 2, draw_order=20), static=True
    )
    stream.send_columns(f"top/ball/{part}", columns, dots.partition(count))
    stream.log(f"residual/{part}", rr.SeriesLines(colors=ink(colour), names=name, widths=1.0), static=True)
    curve = rr.Scalars.columns(scalars=1e3 * one.residual)
    stream.send_columns(f"residual/{part}", _columns(rr, one.time, one.frame), curve)


def _path(rr: Any, stream: Any, name: str, one: Sightings, shots: Sequence[tuple[float, float, str]]) -> None:
    """The whole way of a ball in a shot, while the shot lasts."""
    if not shots:
        return
    part, colour = f"top/path/{rr.escape_entity_path_part(name)}", ball_colour(name)
    inside = [(one.time >= begin) & (one.time <= end) for begin, end, _ in shots]
    dots = rr.Points2D.columns(positions=np.concatenate([one.xy[some] for some in inside]))
    stream.log(part, rr.Points2D.from_fields(colors=colour, radii=-1.5, draw_order=10), static=True)
    begins = _columns(rr, np.array([begin for begin, _, _ in shots]), None)
    stream.send_columns(part, begins, dots.partition([int(some.sum()) for some in inside]))


def _words(rr: Any, stream: Any, shots: Sequence[tuple[float, float, str]]) -> None:
    """How to read it, and what happens when."""
    listing = "\n".join(f"* {text}" for _, _, text in shots)
    page = f"# Tracked footage\n{TRACK_GUIDE}\n## Shots\n{listing or 'none'}"
    stream.log("text/guide", rr.TextDocument(page, media_type="text/markdown"), static=True)
    if shots:
        log = rr.TextLog.columns(text=[text for _, _, text in shots])
        stream.send_columns("text/log", _columns(rr, np.array([begin for begin, _, _ in shots]), None), log)


def table_view(table: Table, diameter: float) -> Any:
    """The view of what `draw_cloth` draws, with balls of a diameter [m] on it."""
    import rerun.blueprint as rrb

    x, y = np.array([table.length, table.width]) / 2 + 2 * diameter
    bounds = rrb.VisualBounds2D(x_range=[-x, x], y_range=[-y, y])
    # From the root, as a view leaves out the transform of its own origin.
    plan = {"origin": "/", "contents": "/top/**", "visual_bounds": bounds}
    return rrb.Spatial2DView(**plan, name="Table from above", background=FLOOR_COLOUR)


def _blueprint(table: Table, diameter: float) -> Any:
    """Video and table on the left, words and residuals on the right."""
    import rerun.blueprint as rrb

    above = table_view(table, diameter)
    video = rrb.Spatial2DView(origin="picture", name="Video and detections")
    curves = rrb.TimeSeriesView(origin="residual", name="Residual of sightings [mm]")
    words = rrb.TextDocumentView(origin="text/guide", name="How to read this")
    left = rrb.Vertical(video, above, row_shares=[3, 2])
    right = rrb.Vertical(words, curves, rrb.TextLogView(origin="text/log", name="Shots"), row_shares=[3, 3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(left, right, column_shares=[3, 2]),
        rrb.TimePanel(state="collapsed", timeline="video_time"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
