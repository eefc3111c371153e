"""The contact sheet of a clip set: a row a shot, with its first frame, its tracks, its last frame and its verdict.

In: a clip set that tracking wrote, its camera and its videos. Out: a PNG. Videos without a clip have a row, too.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path as File

import cv2
import numpy as np

from models.errors import BadInput
from models.files import write_whole
from models.table.palette import ball_colour
from sysid.clips import Clip, ClipSet
from sysid.vision.camera.camera_motion import standing
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Footage, open_footage
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.recordings import videos_in

WIDTH_PX = 420  # of a picture
TEXT_PX = 460  # of the words beside them
LINE_PX = 20
LINE_LETTERS = 62
TEXT_SCALE = 0.5
WHITE, DARK = (235, 235, 235), 30


def write_sheet(path: File, clip_set: ClipSet, camera: Camera, videos: Mapping[str, str], fps: float | None) -> None:
    """Write the sheet of all clips whose videos, by name, are at hand."""
    rows = []
    for name, video in videos_in(clip_set).items():
        if name not in videos:
            continue
        clips = [clip for clip in clip_set.clips if clip.extra.get("video") == name]
        wanted = {int(frame) for clip in clips for frame in clip.extra["frames"]} or {0}
        pictures = _pictures(open_footage(videos[name], fps), wanted)
        there = _standing(camera, list(pictures.values()))
        left_out = [f"left out: {text}" for text in video.get("left_out", ())]
        for clip in clips:
            first, last = (pictures.get(int(frame)) for frame in clip.extra["frames"])
            if first is not None and last is not None:
                rows.append(_row([first, _drawn(first, clip, there), last], [clip.file, clip.note, *left_out]))
        if not clips and pictures:
            rows.append(_row([next(iter(pictures.values()))] * 3, [name, "no shot", *left_out]))
    if rows:
        _, png = cv2.imencode(".png", np.concatenate(rows))
        write_whole(path, png.tobytes())


def _pictures(footage: Footage, wanted: set[int]) -> dict[int, Picture]:
    found = {}
    for frame in footage:
        if frame.index in wanted:
            found[frame.index] = frame.picture.copy()
        if frame.index >= max(wanted):
            break
    return found


def _standing(camera: Camera, pictures: Sequence[Picture]) -> Camera:
    """The camera where it stands, to draw with; as calibrated where so few pictures do not show it."""
    try:
        return standing(camera, pictures)[0] if pictures else camera
    except BadInput:
        return camera


def _drawn(picture: Picture, clip: Clip, camera: Camera) -> Picture:
    """A picture with the places of the balls drawn into it."""
    out = (picture * 0.7).astype(np.uint8)
    for name, seen in clip.balls.items():
        red, green, blue = ball_colour(name)
        colour = (blue, green, red) if max(red, green, blue) > 60 else (160, 160, 160)
        places = np.column_stack([seen.xy, np.full(len(seen.xy), camera.radius)])
        for u, v in np.rint(camera.project(places)).astype(int).tolist():
            cv2.circle(out, (u, v), 3, (0, 0, 0), -1, cv2.LINE_AA)
            cv2.circle(out, (u, v), 2, colour, -1, cv2.LINE_AA)
    return out


def wrapped(lines: Sequence[str]) -> list[str]:
    """Lines that fit beside the pictures, broken between words."""
    return [part for line in lines for part in textwrap.wrap(line, LINE_LETTERS) or [""]]


def _row(pictures: Sequence[Picture], lines: Sequence[str]) -> Picture:
    """Pictures side by side and lines of text beside them."""
    scale = WIDTH_PX / pictures[0].shape[1]
    size = (WIDTH_PX, round(scale * pictures[0].shape[0]))
    parts = [cv2.resize(p, size, interpolation=cv2.INTER_AREA) for p in pictures]
    text = np.full((size[1], TEXT_PX, 3), DARK, np.uint8)
    for k, line in enumerate(wrapped(lines)[: size[1] // LINE_PX]):
        at = (8, LINE_PX * (k + 1) - 4)
        cv2.putText(text, line, at, cv2.FONT_HERSHEY_SIMPLEX, TEXT_SCALE, WHITE, 1, cv2.LINE_AA)
    return np.concatenate([*parts, text], axis=1)
