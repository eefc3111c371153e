"""Tracks in pixels converted to table coordinates by a camera, with y counted downwards or upwards.

Trackers count y either way. The evidence is the same as for lengths (sysid/clips/consistency/readings.py): rebounds at
the cushions, impacts of balls a diameter apart, and commanded azimuths. With a camera straight above, both may be
equally likely.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from models.messages import MessageParts, option
from models.shot import Array
from sysid.clips.clip_set import ClipSet, Observation
from sysid.clips.consistency.aims import FITTING_TURN, aims, off_aim
from sysid.clips.consistency.readings import Reading, weighed


@dataclass(frozen=True)
class Pixels:
    """The conversion of coordinates in a picture to positions on the table."""

    centres: Callable[[Array], Array]  # (n, 2) [pixels], y from the first row downwards -> (n, 2) [m]
    height: int  # of the picture [pixels]


def seen_through(pixels: Pixels, clip_set: ClipSet, y_down: bool | None) -> tuple[ClipSet, str, list[MessageParts]]:
    """The clip set in table coordinates, a description, and assumptions; `y_down` is None if it is to be inferred."""
    says = "pixels, converted by the camera's file, y counted"
    read = {down: _placed(pixels, clip_set, down) for down in (True, False)}
    words = {True: "downwards from the first row", False: "upwards from the last row"}
    if y_down is not None:
        return read[y_down], f"{says} {words[y_down]} (as stated)", []
    fits = {down: _support(one) for down, one in read.items()}
    best = fits[True] >= fits[False]
    assumed = MessageParts((
        "y is taken to point down, as in pictures; counted upwards from the last row, the tracks fit the table as "
        "well. If it is, give ", option("y", "up"), ", or sidespin changes its sign",
    ))  # fmt: skip
    return read[best], f"{says} {words[best]}", [assumed] if fits[True] == fits[False] else []


def _support(clip_set: ClipSet) -> float:
    """Sort key of a reading's evidence, commands first."""
    pairs, seen = aims(clip_set), weighed(clip_set, Reading())
    if pairs is not None and off_aim(pairs) < FITTING_TURN:
        return math.inf
    return seen.support if seen is not None and seen.holds else -math.inf


def _placed(pixels: Pixels, clip_set: ClipSet, y_down: bool) -> ClipSet:
    def meant(seen: Observation) -> Observation:
        u, v = seen.xy.T
        return dataclasses.replace(
            seen, xy=pixels.centres(np.column_stack([u, v if y_down else pixels.height - 1 - v]))
        )

    clips = [
        dataclasses.replace(clip, balls={n: meant(seen) for n, seen in clip.balls.items()}) for clip in clip_set.clips
    ]
    return dataclasses.replace(clip_set, clips=tuple(clips))
