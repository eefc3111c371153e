"""Several recordings of one camera in one clip set: clips named by video and time, finished videos kept.

In: the clip set so far and the clips of one more video. Out: a clip set that holds both, whose noise is the root of the
mean square over all samples. `videos` in clips.toml lists what is finished, with what became no clip and why; each clip
names its video and frames, and the list where a video was, relative to the clip set.
"""

from __future__ import annotations

import math
import os
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from models.errors import BadInput
from sysid.clips import ClipSet, read_clip_set
from sysid.clips.tracker.clock import sample_intervals
from sysid.clips.trust import camera_doubts, with_doubts
from sysid.vision.camera.projection import Camera
from sysid.vision.tracks.track import Tracked

VIDEOS_KEY = "videos"  # of clips.toml
MAX_SIZE_DIFFERENCE_M = 1e-6  # of tables and balls that are the same


def finished(folder: Path) -> ClipSet | None:
    """The clip set that tracking has begun in a folder; None if there is none."""
    if not (folder / "clips.toml").is_file():
        return None
    found = read_clip_set(folder)
    return found if VIDEOS_KEY in found.extra else None


def video_name(video: str) -> str:
    """A video as clips are named after it: its file name without suffix and without what names may not hold."""
    return re.sub(r"[^\w.-]+", "_", Path(video).stem).strip("._") or "video"


def names_of(videos: Sequence[str]) -> dict[str, str]:
    """Video by name; BadInput where two have one name."""
    named: dict[str, str] = {}
    for video in videos:
        if (name := video_name(video)) in named:
            raise BadInput(f"{video}: has the name of {named[name]}, {name}: rename one of them, clips are named by it")
        named[name] = video
    return named


def videos_in(clip_set: ClipSet | None) -> dict[str, dict[str, Any]]:
    """What is recorded of each finished video, by name."""
    entries = clip_set.extra.get(VIDEOS_KEY) if clip_set is not None else None
    if not isinstance(entries, list | tuple):  # somebody else's key of the same name
        return {}
    return {v["name"]: v for v in entries if isinstance(v, dict) and isinstance(v.get("name"), str)}


def of_video(clip_set: ClipSet, name: str, result: Tracked, file: str = "", fps: float = math.nan) -> ClipSet:
    """The clips of one video, named by it and their time.

    Args:
        clip_set: the clips.
        name: of the video.
        result: of tracking it.
        file: where it is, as the clip set says.
        fps: at which it is read [1/s].
    """
    clips, samples = [], 0
    for clip, shot, found in zip(clip_set.clips, result.shots, result.found, strict=True):
        told_as = f"clips/{name}-{round(1e3 * shot.time):06d}ms.csv"
        first = min(int(track.frame[rows[0]]) for track, rows in found.values())  # that of the clip's first sample
        clips.append(replace(clip, file=told_as, extra={**clip.extra, "video": name, "frames": [first, shot.last]}))
        samples += sum(len(seen.time) for seen in clip.balls.values())
    entry = {"name": name, "clips": len(clips), "samples": samples, "left_out": list(result.left_out)}
    entry |= {"file": file, "fps": fps} if file else {}
    if math.isfinite(result.noise.moving):  # the scatter at rest says too little of balls that move
        entry["sigma"] = result.noise.moving
    entry["places_rms"] = result.places.rms
    return replace(clip_set, clips=tuple(clips), extra={**clip_set.extra, VIDEOS_KEY: [entry]})


def place_of(video: str, folder: Path) -> str:
    """Where a video is, as a clip set in a folder names it: relative, so that both may be moved together."""
    return Path(os.path.relpath(video, folder)).as_posix()


def joined(before: ClipSet | None, more: ClipSet) -> ClipSet:
    """Both clip sets in one, at the frame rate of most samples."""
    if before is None:
        return more
    videos = [*before.extra[VIDEOS_KEY], *more.extra[VIDEOS_KEY]]
    weights = [(v["samples"], v["sigma"]) for v in videos if "sigma" in v]
    total = sum(count for count, _ in weights)
    sigma = math.sqrt(sum(count * sd**2 for count, sd in weights) / total) if total else more.sigma
    clips = (*before.clips, *more.clips)
    usual = float(np.median(sample_intervals(clips)))
    fps = min(before.fps, more.fps, key=lambda rate: abs(usual * rate - 1))
    both = replace(before, clips=clips, fps=fps, sigma=sigma, extra={**before.extra, VIDEOS_KEY: videos})
    return with_doubts(both, camera_doubts(more))


def check_camera(before: ClipSet, camera: Camera, folder: Path) -> None:
    """BadInput where a clip set was filmed on another table or with other balls."""
    table = before.table
    sizes = (table.length, table.width, before.ball.diameter), (
        camera.table.length, camera.table.width, camera.diameter,
    )  # fmt: skip
    if max(abs(a - b) for a, b in zip(*sizes, strict=True)) > MAX_SIZE_DIFFERENCE_M:
        texts = [" x ".join(f"{v:g}" for v in size) for size in sizes]
        raise BadInput(f"{folder}: holds clips of {texts[0]} m, the camera's are {texts[1]} m: choose another folder")
