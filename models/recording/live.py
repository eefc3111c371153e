"""Footage in the viewer while it is tracked: the frames with the balls found, and these on the table.

On the timeline `video_time` [s], with `frame` counting. A frame is shown every SHOWN_INTERVAL_S of the clock at most,
so that tracking waits little for it.
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.recording.film import jpeg
from models.recording.video import MAX_WIDTH_PX, draw_cloth, enlarged, table_view
from models.shot import Array, Table
from models.table.palette import MODEL_COLOUR, ball_colour

if TYPE_CHECKING:
    from models.recording.viewer import Feed

LIVE_APPLICATION = "cuelab_live_track"
SHOWN_INTERVAL_S = 0.1  # of the clock, between two frames shown


class LiveTrack:
    """One video in the viewer."""

    def __init__(self, feed: Feed, name: str, table: Table, diameter: float) -> None:
        """Begin to show a video of a table with balls of a diameter [m]."""
        import rerun as rr

        self._rr, self._diameter, self._last, self._scaled = rr, diameter, -math.inf, False
        self._stream = feed.stream(LIVE_APPLICATION, name, _blueprint(table, diameter))
        draw_cloth(rr, self._stream, table)

    def due(self) -> bool:
        """Whether a frame may be shown."""
        return clock.monotonic() - self._last >= SHOWN_INTERVAL_S

    def frame(
        self, number: int, time: float, picture: NDArray[np.uint8], names: Sequence[str], pixels: Array, radii: Array,
        xy: Array,
    ) -> None:  # fmt: skip
        """Show a frame.

        Args:
            number: of the frame.
            time: of the frame [s].
            picture: (height, width, 3) blue, green, red.
            names: of the balls found (n).
            pixels: centres (n, 2) of their outlines.
            radii: (n,) of these [pixels].
            xy: places (n, 2) of the balls [m].
        """
        rr, stream = self._rr, self._stream
        self._last = clock.monotonic()
        stream.set_time("video_time", duration=time)
        stream.set_time("frame", sequence=number)
        if not self._scaled:
            stream.log("picture/video", rr.Transform3D(scale=enlarged(picture)), static=True)
            self._scaled = True
        stream.log("picture/video", rr.EncodedImage(contents=jpeg(picture, MAX_WIDTH_PX), media_type="image/jpeg"))
        colours = [ball_colour(name) for name in names]
        shown = [colour if max(colour) > 90 else (140, 140, 140) for colour in colours]  # black shows on black
        named = {"labels": list(names), "show_labels": False}
        rings = {"centers": pixels.reshape(-1, 2), "half_sizes": 1.2 * np.repeat(np.reshape(radii, (-1, 1)), 2, axis=1)}
        stream.log(
            "picture/found", rr.Ellipses2D(**rings, colors=MODEL_COLOUR, line_radii=-1.5, **named, draw_order=10)
        )
        balls = rr.Points2D(xy.reshape(-1, 2), colors=shown, radii=self._diameter / 2, **named, draw_order=20)
        stream.log("top/found", balls)

    def said(self, time: float, text: str) -> None:
        """Write a line into the log, at a time of the video [s]."""
        self._stream.reset_time()
        self._stream.set_time("video_time", duration=time)
        self._stream.log("log", self._rr.TextLog(text))


def _blueprint(table: Table, diameter: float) -> Any:
    """The video above the table, and the log beside them."""
    import rerun.blueprint as rrb

    video = rrb.Spatial2DView(origin="picture", name="Video and balls found")
    log = rrb.TextLogView(origin="log", name="Shots")
    return rrb.Blueprint(
        rrb.Vertical(rrb.Horizontal(video, table_view(table, diameter)), log, row_shares=[5, 1]),
        rrb.TimePanel(state="collapsed", timeline="video_time", play_state="following"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_layout=False,
        auto_views=False,
    )
