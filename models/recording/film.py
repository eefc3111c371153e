"""Footage in a recording: the videos themselves where a viewer can play them, else their pictures, reduced.

A video goes in whole, as it is, at a hundredth of the size of single pictures. The viewer decodes AV1 by itself, and
all else with the program ffmpeg. Without it, or where the videos have more than MAX_VIDEO_BYTES in all, pictures of the
frames that show the clips go in, MAX_PICTURES at most: of more every second, third ... one.
"""

from __future__ import annotations

import math
import shutil
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from models.messages import counted
from models.recording.clips import LaidClip, ReviewOut, Rows
from models.shot import Array

Picture = NDArray[np.uint8]  # (height, width, 3) blue, green, red

FILM_PATH, FILM_SCREEN = "film", "film/screen"  # below the first everything, at the second what is shown
PLAYED_SUFFIXES = (".mp4", ".m4v", ".mov")  # containers that the viewer may play
OWN_CODECS = ("av01",)  # that it decodes by itself
DECODER_PROGRAM = "ffmpeg"  # of all others
MAX_VIDEO_BYTES = 200e6
MAX_PICTURES = 2000  # of 30 to 60 kB
PICTURE_WIDTH_PX = 640
JPEG_QUALITY = 80


@dataclass(frozen=True)
class Film:
    """A video, and which of its frames show which clip."""

    video: Path
    clips: Mapping[str, tuple[NDArray[np.int64], Array]]  # by clip: frames (n,), and their times in the clip (n,) [s]
    pictures: Callable[[Collection[int]], Iterable[tuple[int, Picture]]]  # some frames, in order, with their numbers

    def identity(self) -> bytes:
        """What distinguishes it from another: its name, and which frames show which clip."""
        return repr((self.video.name, [(name, index.tolist()) for name, (index, _) in self.clips.items()])).encode()


def playable_stamps(video: Path) -> NDArray[np.int64] | None:
    """Times of the frames (n,) [ns] of a video that the viewer plays on this machine; None of any other footage."""
    import rerun as rr

    if video.suffix.lower() not in PLAYED_SUFFIXES or not video.is_file():
        return None
    if shutil.which(DECODER_PROGRAM) is None and _codec(video) not in OWN_CODECS:
        return None
    try:
        return np.asarray(rr.AssetVideo(path=video).read_frame_timestamps_nanos(), np.int64)
    except (RuntimeError, ValueError):
        return None


def _codec(video: Path) -> str:
    """The four letters of a video's codec."""
    capture = cv2.VideoCapture(str(video))
    code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
    capture.release()
    return code.to_bytes(4, "little").decode("latin-1").lower()


def jpeg(picture: Picture, width: int) -> bytes:
    """A picture (height, width, 3) as JPEG, not wider than so many pixels."""
    scale = min(1.0, width / picture.shape[1])
    small = picture if scale == 1.0 else cv2.resize(picture, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])[1].tobytes())


def draw_films(out: ReviewOut, films: Sequence[Film]) -> str:
    """Put films into a review, in the time of its clips; what went in, in words."""
    frames = {clip: (film, _within(out, clip, *film.clips[clip])) for film in films for clip in film.clips}
    shown = {clip.review.name: clip for clip in out.clips if clip.review.name in frames}
    stamps = [playable_stamps(film.video) for film in films]
    size = sum(film.video.stat().st_size for film in films if film.video.is_file())
    _clear(out, [clip for clip in out.clips if clip.review.name not in shown])
    if size <= MAX_VIDEO_BYTES and all(s is not None and _holds(s, f) for s, f in zip(stamps, films, strict=True)):
        for number, (film, stamp) in enumerate(zip(films, stamps, strict=True), 1):
            _draw_video(out, f"{FILM_PATH}/video/{number}", film, stamp, shown, frames)
        return f"{counted(len(films), 'video')} as {'it is' if len(films) == 1 else 'they are'}, {size / 1e6:.1f} MB"
    step = math.ceil(sum(len(index) for _, (index, _) in frames.values()) / MAX_PICTURES)
    count = total = 0
    for film in films:
        for number in _draw_pictures(out, film, shown, frames, step):
            count, total = count + 1, total + number
    thinned = f", one frame of {step}" if step > 1 else ""
    return f"{counted(count, 'picture')} of {counted(len(films), 'video')}{thinned}, {total / 1e6:.1f} MB"


_Frames = Mapping[str, tuple[Film, tuple[NDArray[np.int64], Array]]]  # by clip


def _within(out: ReviewOut, name: str, index: NDArray[np.int64], time: Array) -> tuple[NDArray[np.int64], Array]:
    """Frames and their times that lie within a clip; a film may begin earlier and end later."""
    clip = next((clip for clip in out.clips if clip.review.name == name), None)
    if clip is None:
        return index[:0], time[:0]
    kept = (clip.start + time >= clip.first - 1e-6) & (clip.start + time <= clip.last + 1e-6)
    return index[kept], time[kept]


def _holds(stamps: NDArray[np.int64] | None, film: Film) -> bool:
    """Whether a video has all frames of its clips."""
    return stamps is not None and all(len(index) == 0 or index[-1] < len(stamps) for index, _ in film.clips.values())


def _rows(clip: LaidClip, time: Array) -> Rows:
    return np.full(len(time), clip.index), clip.start + time, np.ones(len(time), int)


def _clear(out: ReviewOut, clips: Sequence[LaidClip]) -> None:
    """Show nothing in clips that have no film."""
    if clips:
        rows = [c.index for c in clips], [c.first for c in clips], [1] * len(clips)
        out.moving(FILM_SCREEN, out.rr.Clear, {}, {"is_recursive": [False] * len(clips)}, rows)


def _draw_video(
    out: ReviewOut, path: str, film: Film, stamps: Any, shown: Mapping[str, LaidClip], frames: _Frames
) -> None:  # fmt: skip
    """The video itself, and which of its frames is on the screen when."""
    out.fixed(path, out.rr.AssetVideo(path=film.video))
    for name in (name for name in film.clips if name in shown):
        index, time = frames[name][1]
        data = {"timestamp": stamps[index], "video_reference": [f"/{path}"] * len(index)}
        out.moving(FILM_SCREEN, out.rr.VideoFrameReference, {}, data, _rows(shown[name], time))


def _draw_pictures(
    out: ReviewOut, film: Film, shown: Mapping[str, LaidClip], frames: _Frames, step: int
) -> Iterable[int]:  # fmt: skip
    """Every so many frames as pictures; gives the size of each [bytes]."""
    when: dict[int, list[tuple[LaidClip, float]]] = {}
    for name in (name for name in film.clips if name in shown):
        index, time = frames[name][1]
        for number, moment in list(zip(index.tolist(), time.tolist(), strict=True))[::step]:
            when.setdefault(number, []).append((shown[name], moment))
    for number, picture in film.pictures(when):
        coded = jpeg(picture, PICTURE_WIDTH_PX)
        for clip, moment in when[number]:
            data = {"blob": [coded], "media_type": ["image/jpeg"]}
            out.moving(FILM_SCREEN, out.rr.EncodedImage, {}, data, _rows(clip, np.array([moment])))
        yield len(coded)
