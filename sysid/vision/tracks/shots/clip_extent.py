"""The extent of a shot's clip: its last frame, and the balls that belong to it.

In: the tracked scene, where a clip begins, and the moves in it. Out: the frame it ends with, and `Present`, or why it
is not known what a ball does; remarks for the user.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.vision.tracks.moves import (
    MAX_UNSEEN_S,
    MIN_REST_DETECTIONS,
    Move,
    TrackedScene,
    pocketed,
    rest_place,
)
from sysid.vision.tracks.shots.breaks import first_break

CLIP_TAIL_S = 0.3  # of rest at the end of a clip


def ending(scene: TrackedScene, first: int, covered: int, after: Sequence[Move], limit: int) -> tuple[int, list[str]]:
    """The last frame of a clip whose first moves end at frame `covered`, others coming after, and what to say of it."""
    for move in sorted(after, key=lambda m: m.began):
        # The ball that sets one at rest in motion may be hidden.
        if move.place is not None or scene.time_of(move.began) - scene.time_of(covered) < 1.5 * scene.period:
            covered = max(covered, min(move.ended, limit))
    last = min(
        int(scene.frames[np.searchsorted(scene.times, scene.time_of(covered) + CLIP_TAIL_S, side="right") - 1]), limit
    )
    last, jumps = first_break(scene, first, last)
    remarks = [f"ends at {scene.time_of(last):.2f} s, where the track of {jumps} jumps"] if jumps else []
    if last >= scene.frames[-1] and covered >= scene.frames[-1] - 1:
        remarks.append("ends with the video")
    return last, remarks


@dataclass(frozen=True)
class Present:
    """The balls of a clip."""

    names: tuple[str, ...]  # those that move first before the others
    potted: Mapping[str, int]  # ball -> the last frame before it is in a pocket
    remarks: tuple[str, ...]


def balls_there(
    scene: TrackedScene, moving: Sequence[str], first: int, last: int, after: Sequence[Move]
) -> tuple[Present | None, str]:
    """The balls of a clip, those that move first and others at rest; or why it is not known what they do.

    Args:
        scene: all tracks.
        moving: balls that move when the clip begins.
        first: frame.
        last: frame.
        after: moves of other balls in the clip.
    """
    potted, balls, remarks = {}, list(moving), list[str]()
    for other in scene.tracks:
        rows = np.flatnonzero((other.frame >= first) & (other.frame <= last))
        before = [rest_place(other, a, b) for a, b in scene.resting[other.name] if other.frame[a] <= first]
        present = rows.size and before and np.linalg.norm(other.xy[rows[0]] - before[-1]) < scene.radius / 2
        if other.name in moving and not rows.size:
            return None, f"{other.name} is not seen in the clip"
        if other.name not in moving and not present:
            if rows.size > MIN_REST_DETECTIONS:
                remarks.append(f"{other.name} appeared at {other.time[rows[0]]:.2f} s and is not in the clip")
            continue
        if other.name not in moving:
            balls.append(other.name)
            gone = [m for m in after if m.name == other.name and m.began <= last]
            if any(m.place is None or m.track.frame[rows[0]] >= m.began for m in gone):
                return None, f"{other.name} was hidden when it was set in motion"
        drop_frame = pocketed(scene, other, rows)
        if drop_frame is not None:
            potted[other.name] = drop_frame
            remarks.append(f"{other.name} potted")
        elif scene.time_of(last) - other.time[rows[-1]] > MAX_UNSEEN_S + scene.period:
            remarks.append(f"{other.name} lost from sight at {other.time[rows[-1]]:.2f} s")
    return Present(tuple(balls), potted, tuple(remarks)), ""
