"""A picture of each clip: where its balls were seen, over the frame that it begins with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path as File

import cv2
import numpy as np

from models.errors import BadInput
from models.files import write_whole
from models.recording.palette import ball_colour
from sysid.vision.frames import Footage, Picture
from sysid.vision.tracks.track import Found, Tracked, lost_frames, note, pictures

SHIFT = 4  # bits of sub-pixel positions in OpenCV's drawing
DARK = 0.75  # of the picture under the tracks
MISSING = 2.5  # periods between two sightings that are not joined


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
    for index, picture in pictures(footage, set(begins)):
        for k in begins.get(index, ()):
            progress(f"picture of clip {k + 1}")
            path = folder / f"{k + 1:04d}.png"
            _, png = cv2.imencode(".png", drawn(picture, result, k))
            write_whole(path, png.tobytes(), parents=True)
            written.append(path)
    return written


def drawn(picture: Picture, result: Tracked, number: int) -> Picture:
    """A frame (height, width, 3) with the tracks of a clip, counted from 0, and what there is to say of it."""
    shot, found = result.shots[number], result.found[number]
    out = np.rint(DARK * picture).astype(np.uint8)
    for name in found:
        _draw(out, result, found, name)
    path, rows = found[shot.struck]
    lost = lost_frames(result.scene, shot, path, rows)
    what = "spun" if shot.spun else f"struck, {shot.speed:.2f} m/s"
    words = [
        f"clip {number + 1}: {note(number + 1, shot)}",
        f"{shot.struck} {what}, {rows.size} sightings, {lost} lost",
    ]
    scale = max(picture.shape[1] / 1600, 0.4)
    out[: int(95 * scale)] //= 3
    for line, text in enumerate(words):
        at = (int(20 * scale), int((35 + 40 * line) * scale))
        cv2.putText(out, text, at, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA)
    return out


def _draw(out: Picture, result: Tracked, found: Found, name: str) -> None:
    """One ball: its outline at first, a line along its sightings, broken where it was not seen, a cross at the end."""
    path, rows = found[name]
    red, green, blue = ball_colour(name)
    colour = (blue, green, red) if max(red, green, blue) > 60 else (160, 160, 160)
    points = np.rint(path.pixels[rows] * 2**SHIFT).astype(np.int32)
    breaks = np.flatnonzero(np.diff(path.time[rows]) > MISSING * result.scene.period) + 1
    for part in np.split(points, breaks):
        cv2.polylines(out, [part[:, None]], False, colour, 1, cv2.LINE_AA, SHIFT)
    for point in points:
        cv2.circle(out, point.tolist(), 1 << SHIFT, colour, -1, cv2.LINE_AA, SHIFT)
    radius = round(float(path.radius[rows[0]]) * 2**SHIFT)
    cv2.circle(out, points[0].tolist(), radius, colour, 1, cv2.LINE_AA, SHIFT)
    arm = 4 << SHIFT
    for way in ((arm, arm), (arm, -arm)):
        cv2.line(out, (points[-1] - way).tolist(), (points[-1] + way).tolist(), colour, 1, cv2.LINE_AA, SHIFT)
    at = (points[0] / 2**SHIFT + [radius / 2**SHIFT + 3, 0]).astype(int).tolist()
    cv2.putText(out, name, at, cv2.FONT_HERSHEY_SIMPLEX, 0.4, colour, 1, cv2.LINE_AA)
