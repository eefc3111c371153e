"""Preview pictures: for each clip a PNG of its first frame with the detections of its balls drawn over it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path as File

import cv2
import numpy as np

from models.errors import BadInput
from models.files import write_whole
from models.messages import counted
from models.table.palette import ball_colour
from sysid.vision.frames import Footage
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.clips import note
from sysid.vision.tracks.track import ClipTracks, Tracked, lost_frames

SUBPIXEL_BITS = 4  # fractional bits of positions in OpenCV's drawing functions
DIMMING_FRACTION = 0.75  # brightness of the frame under the tracks
MAX_JOINED_PERIODS = 2.5  # detections farther apart in time are not joined by a line


def write_previews(
    folder: File | str, footage: Footage, result: Tracked, progress: Callable[[str], None] = lambda line: None
) -> list[File]:
    """Write a PNG of each clip into a folder, which is made if it is not there."""
    folder = File(folder)
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: is a file; name a folder for the pictures of clips")
    begins: dict[int, list[int]] = {}
    for k, shot in enumerate(result.shots):
        begins.setdefault(shot.first, []).append(k)
    written = []
    for index, picture in _pictures(footage, set(begins)):
        for k in begins.get(index, ()):
            progress(f"picture of clip {k + 1}")
            png_path = folder / f"{k + 1:04d}.png"
            _, png = cv2.imencode(".png", draw_clip(picture, result, k))
            write_whole(png_path, png.tobytes(), parents=True)
            written.append(png_path)
    return written


def draw_clip(picture: Picture, result: Tracked, number: int) -> Picture:
    """A frame (height, width, 3) with the tracks of a clip, counted from 0, and a caption."""
    shot, found = result.shots[number], result.found[number]
    out = np.rint(DIMMING_FRACTION * picture).astype(np.uint8)
    for name in found:
        _draw_track(out, result, found, name)
    track, rows = found[shot.struck]
    lost = lost_frames(result.scene, shot, track, rows)
    what = "spun" if shot.spun else f"struck, {shot.speed:.2f} m/s"
    words = [
        f"clip {number + 1}: {note(number + 1, shot)}",
        f"{shot.struck} {what}, {counted(rows.size, 'detection')}, lost in {counted(lost, 'frame')}",
    ]
    scale = max(picture.shape[1] / 1600, 0.4)
    out[: int(95 * scale)] //= 3
    for line, text in enumerate(words):
        at = (int(20 * scale), int((35 + 40 * line) * scale))
        cv2.putText(out, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def _draw_track(out: Picture, result: Tracked, found: ClipTracks, name: str) -> None:
    """One ball: its first outline, a line along its detections with gaps where it was not seen, a cross at the end."""
    track, rows = found[name]
    red, green, blue = ball_colour(name)
    colour = (blue, green, red) if max(red, green, blue) > 60 else (160, 160, 160)
    points = np.rint(track.pixels[rows] * 2**SUBPIXEL_BITS).astype(np.int32)
    breaks = np.flatnonzero(np.diff(track.time[rows]) > MAX_JOINED_PERIODS * result.scene.period) + 1
    for part in np.split(points, breaks):
        cv2.polylines(out, [part[:, None]], False, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    for point in points:
        cv2.circle(out, point.tolist(), 1 << SUBPIXEL_BITS, colour, -1, cv2.LINE_AA, SUBPIXEL_BITS)
    radius = round(float(track.radius[rows[0]]) * 2**SUBPIXEL_BITS)
    cv2.circle(out, points[0].tolist(), radius, colour, 1, cv2.LINE_AA, SUBPIXEL_BITS)
    arm = 4 << SUBPIXEL_BITS
    for diagonal in ((arm, arm), (arm, -arm)):
        cv2.line(
            out,
            (points[-1] - diagonal).tolist(),
            (points[-1] + diagonal).tolist(),
            colour,
            1,
            cv2.LINE_AA,
            SUBPIXEL_BITS,
        )
    at = (points[0] / 2**SUBPIXEL_BITS + [radius / 2**SUBPIXEL_BITS + 3, 0]).astype(int).tolist()
    cv2.putText(out, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)


def _pictures(footage: Footage, wanted: set[int]) -> Iterator[tuple[int, Picture]]:
    """The pictures of some frames, from a further pass through the footage."""
    last = max(wanted, default=-1)
    for frame in footage:
        if frame.index in wanted:
            yield frame.index, frame.picture
        if frame.index >= last:
            return
