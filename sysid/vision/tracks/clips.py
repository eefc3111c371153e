"""Tracked shots as clips.

In: the result of tracking, and what else is known of each shot. Out: a clip set, and the note on each clip.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from models.errors import BadInput
from models.messages import counted
from sysid.clips import Clip, ClipSet, Observation
from sysid.clips.trust import with_doubts
from sysid.vision.camera.projection import Array, Camera, ball_of
from sysid.vision.tracks.shots.strikes import TrackedShot
from sysid.vision.tracks.track import Tracked


@dataclass(frozen=True)
class Extra:
    """What is known of a shot beside positions."""

    theta: Mapping[str, Array] = field(
        default_factory=dict
    )  # ball -> angle at each of its detections in the clip [rad]
    tip: str = ""  # such as "cue tip 1.43 +- 0.01 m/s at 34.2 deg"


def note(number: int, shot: TrackedShot, extra: Extra = Extra()) -> str:
    """The note on a clip: what it shows, for the user."""
    count = counted(len(shot.balls), "ball")
    what = f"{shot.struck} spins in place" if shot.spun else f"{'running clip' if shot.running else 'shot'} {number}"
    return "; ".join([f"{what} at {shot.time:.2f} s", count, *shot.remarks, *([extra.tip] if extra.tip else [])])


def clip_set(result: Tracked, camera: Camera, mass: float, fps: float, extras: Sequence[Extra] = ()) -> ClipSet:
    """The shots as clips.

    Args:
        result: the result of tracking.
        camera: with the table and the balls' diameter.
        mass: of a ball [kg].
        fps: nominal frame rate [1/s].
        extras: angles and notes of each shot.
    """
    if not result.shots:
        raise BadInput("video: holds no shot to write; film whole shots, from before the stroke until the balls rest")
    clips = []
    for number, (shot, found) in enumerate(zip(result.shots, result.found, strict=True), 1):
        extra = extras[number - 1] if extras else Extra()
        start = min(float(track.time[rows[0]]) for track, rows in found.values())
        balls = {}
        for name, (track, rows) in found.items():
            unseen = np.full(rows.size, np.nan)
            balls[name] = Observation(track.time[rows] - start, track.xy[rows], extra.theta.get(name, unseen))
        text = note(number, shot, extra)
        clips.append(Clip(f"clips/{number:04d}.csv", shot.struck, balls, note=text, running=shot.running))
    sigma = result.noise.sigma
    known = sigma if math.isfinite(sigma) else None
    return with_doubts(ClipSet(camera.table, ball_of(camera, mass), fps, tuple(clips), known), camera.doubts)
