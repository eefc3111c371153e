"""A series of shots as plain values: what was planned in each, what came of it, and how the miss fell.

In: what whoever played the series knows of it, who lies further down the house. Out: `SeriesRecording`, which story.py
shows in the Rerun viewer.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from models.shot import Array, Ball, Table
from models.table.palette import Colour
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE

Way = tuple[Array, Array]  # time (n,) [s] in its shot, increasing; places (n, 2) [m]; NaN where unseen
TARGET_COLOUR: Colour = (255, 159, 28)
STORY_CURVES: Mapping[str, tuple[str, Colour]] = {
    "miss": ("miss of the cue ball", (140, 190, 240)),
    "median": ("its median in the block", (60, 130, 255)),
    "spread": ("what the plan foresaw", TARGET_COLOUR),
    "floor": ("the launcher's own scatter", (200, 200, 200)),
}


@dataclass(frozen=True)
class SeriesShot:
    """One shot: what was planned, and what came of it."""

    number: int  # from 1
    start: Mapping[str, Array]  # ball -> (2,) [m], table frame
    planned: Mapping[str, Way] = field(default_factory=dict)  # by ball, of those that move
    played: Mapping[str, Way] = field(default_factory=dict)  # by ball, as filmed; empty where there is no film
    target: Array | None = None  # (2,) where the cue ball was commanded to stop [m]
    stopped: Array | None = None  # (2,) where it did [m]
    wanted: Array | None = None  # (2,) where it was wanted [m]
    curves: Mapping[str, float] = field(default_factory=dict)  # a key of STORY_CURVES -> [m]; NaN for none
    words: str = ""  # what came of it, in a line
    page: str = ""  # the same at length, Markdown
    clip: str = ""  # what films call it


@dataclass(frozen=True)
class SeriesRecording:
    """A series."""

    scenes: Sequence[SeriesShot]
    lessons: Sequence[tuple[int, str]] = ()  # shots that a refit was made after, and what it found, in a line
    words: str = ""  # what the series came to, Markdown
    table: Table = SNOOKER_TABLE
    ball: Ball = SNOOKER_BALL
