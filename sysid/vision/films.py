"""The films of a clip set: where they are, and which of their frames show which clip.

In: a clip set that tracking wrote, which names its videos. Out: `models.recording.film.Film`, for recordings. A clip's
first frame is that of its first sample. Where a clip has as many moments as frames, these are the frames' times, since
tracking finds frames missing which the video's stamps do not show. Left out: clips in which frames are also doubled,
or show no ball; there the film runs ahead of the tracks where frames are missing.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from models.commands.console import named
from models.errors import BadInput
from models.recording.film import Film
from sysid.clips import Clip, ClipSet
from sysid.vision.frames import open_footage
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.recordings import VIDEOS_KEY, place_of, video_name, videos_in

STRIKE_TOLERANCE_S = 1e-4  # of a frame's stamp from the strike
VIDEO_SUFFIXES = (".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm", ".mpg", ".mpeg", ".mts", ".ts", ".wmv")


def films_of(clip_set: ClipSet, folder: Path | None = None) -> tuple[list[Film], list[str]]:
    """The films of a clip set that are found, and the names of those that are not.

    Args:
        clip_set: names its videos, or none.
        folder: where they are; by default where they were tracked, or beside the clip set or its folder.

    Raises:
        BadInput: a folder is given and holds none of them, or a film is shorter than its clips.
    """
    found, missing = [], []
    named = videos_in(clip_set)
    filmed = {name: [c for c in clip_set.clips if c.extra.get("video") == name and _span(c)] for name in named}
    for name in (name for name in named if filmed[name]):
        video = _find(name, named[name], clip_set.folder, folder)
        if video is None:
            missing.append(name)
        else:
            found.append(_film(video, named[name].get("fps"), filmed[name]))
    if folder is not None and not found:
        raise BadInput(_absent(clip_set, folder, missing))
    return found, missing


def missing_line(missing: Sequence[str], folder: Path | None) -> str:
    """What is said of films that are not found, in a folder where one was given."""
    if folder is not None:
        return f"{folder} holds no film of {named(missing)}: these clips are shown without a film"
    return f"film not found of {named(missing)}: give its folder with --video DIR"


def film_entries(clip_set: ClipSet, video: Path, frames: tuple[int, int]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What a clip from a film says of it, and what the clip set that it joins does: the `extra` of both.

    Args:
        clip_set: as it is before.
        video: the film.
        frames: the first and the last one of the clip.
    """
    videos = list(videos_in(clip_set).values())
    name, used = video_name(video.name), {entry["name"] for entry in videos}
    while name in used:
        name += "-again"
    videos.append({"name": name, "file": place_of(str(video), clip_set.folder), "fps": clip_set.fps})
    return {"video": name, "frames": list(frames)}, {**clip_set.extra, VIDEOS_KEY: videos}


def _absent(clip_set: ClipSet, folder: Path, missing: Sequence[str]) -> str:
    if not missing:
        return f"{clip_set.folder}: does not say which films its clips are from; leave --video out, or track them again"
    where = "no such folder" if not folder.is_dir() else f"holds no film of {named(missing)}"
    return f"{folder}: {where}; name the folder of the films that {clip_set.folder} was tracked from"


def _span(clip: Clip) -> tuple[int, int] | None:
    """The first and the last frame of a clip, where it names them."""
    span = clip.extra.get("frames")
    if not isinstance(span, list | tuple) or len(span) != 2 or not all(isinstance(k, int) for k in span):
        return None
    return (span[0], span[1]) if 0 <= span[0] <= span[1] else None


def _find(name: str, entry: Mapping[str, Any], clips: Path, folder: Path | None) -> Path | None:
    """The video of a name: in the folder given, else where it was tracked, else beside the clip set or its folder."""
    places = [clips, clips.resolve().parent] if folder is None else [folder]
    recorded = entry.get("file")
    if folder is None and isinstance(recorded, str) and (video := clips / recorded).exists():
        return video
    for place in (place for place in places if place.is_dir()):
        for path in sorted(place.iterdir()):
            if path.suffix.lower() in VIDEO_SUFFIXES and video_name(path.name) == name:
                return path
    return None


def _film(video: Path, fps: object, clips: Sequence[Clip]) -> Film:
    """A film with the times of its frames in each clip; BadInput where it ends too early."""
    spans = {clip.file: span for clip in clips if (span := _span(clip)) is not None}
    rate = float(fps) if isinstance(fps, int | float) else None
    wanted = {k for first, last in spans.values() for k in range(first, last + 1)}
    times = {frame.index: frame.time for frame in _frames(video, rate, wanted)}
    shown = {}
    for clip in clips:
        first, last = spans[clip.file]
        if first not in times or last not in times:
            raise BadInput(f"{video}: lacks frames {first} to {last} of {clip.file}; name the film that it is from")
        index = np.array([k for k in range(first, last + 1) if k in times], np.int64)
        stamped = np.array([times[k] for k in index.tolist()]) - times[first] - clip.origin
        before = stamped[stamped < -STRIKE_TOLERANCE_S]  # the strike
        moments = np.unique(np.concatenate([seen.time for seen in clip.balls.values()]))
        whole = len(before) + len(moments) == len(index)
        shown[clip.file] = index, np.concatenate([before, moments]) if whole else stamped
    return Film(video, shown, partial(_pictures, video, rate))


def _pictures(video: Path, fps: float | None, wanted: Collection[int]) -> Iterator[tuple[int, Picture]]:
    for frame in _frames(video, fps, wanted):
        yield frame.index, frame.picture


def _frames(video: Path, fps: float | None, wanted: Collection[int]) -> Iterator[Any]:
    """Some frames of a video, without reading on after the last."""
    last = max(wanted, default=-1)
    for frame in open_footage(video, fps).frames(set(wanted)):
        yield frame
        if frame.index >= last:
            return
