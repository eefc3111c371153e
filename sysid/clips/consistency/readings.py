"""Coordinate conventions: unit, origin and axes, and the evidence for each from the tracks of a clip set.

In: a `ClipSet` as it was written. Out: `Reading`s, each with the evidence for it.

A reading puts the rows on the table. Balls that turn in the open, where neither ball nor pocket is near, must do so at
the cushions, and balls that meet are a diameter apart: that determines unit, origin and which axis is the long one.
Which way y is counted and from which end x shows only in commands: mirrored tables play alike.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from models.shot import Array, Ball, Table
from sysid.clips.clip_set import Clip, ClipSet, Observation
from sysid.clips.consistency.aims import FITTING_TURN, aims, off_aim
from sysid.clips.consistency.contact_distance import contact_distance
from sysid.clips.consistency.contradiction import is_sound
from sysid.clips.consistency.contradictions import CERTAIN_DIAMETER, turns_in_the_open
from sysid.clips.plausibility import MAX_BEYOND_NOSE_M, POCKET_REACH

METRES_BY_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254, "ft": 0.3048}
UNIT_NAMES = {"m": "metres", "in": "inches", "ft": "feet"}
MIN_SHARE_INSIDE = 0.99  # least share of all rows on the table, for a reading to be right
MIN_COVERAGE = 0.25  # least share of the table's length that rows must cover; with less the unit is too large
MIN_BALL_PIXELS = 3.0  # smallest diameter of a ball that can be tracked in a picture
AT_CUSHION = 0.05  # largest distance of a turn from the cushion, over half the table
MIN_TURNS = 2  # fewest turns at cushions that support a reading


@dataclass(frozen=True)
class Reading:
    """A coordinate convention; by default that of a clip set."""

    unit: str = "m"
    corner: bool = False  # the origin is where the nose lines meet, x and y grow from there
    exchanged: bool = False  # x is along the width
    y_down: bool = False  # x, y and up are left-handed, as in pictures
    turned: bool = False  # by half a turn, once all else is read

    @property
    def changes(self) -> int:
        """The number of respects in which it differs from a clip set's convention."""
        return (self.unit != "m") + self.corner + self.exchanged + self.y_down + self.turned

    def metres(self, xy: Array, table: Table) -> Array:
        """Coordinates converted by this convention: (n, 2) [m], table frame."""
        size = np.array([table.length, table.width])
        own = xy * METRES_BY_UNIT[self.unit] - (size[::-1] if self.exchanged else size) / 2 * self.corner
        x, y = own[:, 0], -own[:, 1] if self.y_down else own[:, 1]
        meant = np.column_stack([y, -x] if self.exchanged else [x, y])
        return -meant if self.turned else meant

    def options(self) -> str:
        """The convention as options of `sysid import`."""
        words = [f"--unit {self.unit}", f"--origin {'corner' if self.corner else 'centre'}"]
        words += ["--x-along width"] * self.exchanged + ["--y down"] * self.y_down + ["--turned"] * self.turned
        return " ".join(words)

    def looks(self) -> str:
        """A description of the coordinates in words."""
        words = [UNIT_NAMES.get(self.unit, self.unit)] + ["from a corner"] * self.corner
        axes = "with x and y exchanged" if self.exchanged else "with y downwards" if self.y_down else ""
        return " ".join([*words, axes]).strip()

    def remedy(self) -> str:
        """The operations on the columns that convert them, in words."""
        factor, steps = METRES_BY_UNIT[self.unit], list[str]()
        if self.unit != "m":
            by = f"divide them by {1 / factor:.6g}" if factor in (0.01, 0.001) else f"multiply them by {factor:.6g}"
            steps.append(by)
        if self.corner:
            steps.append("subtract half the table's length and half its width")
        steps[:0] = ["exchange the columns"] * self.exchanged
        x = -1 if self.turned else 1
        y = -x if self.y_down else x
        x, y = (y, -x) if self.exchanged else (x, y)
        flipped = [axis for axis, sign in (("x", x), ("y", y)) if sign < 0]
        if flipped:
            steps.append(f"change the sign{'s' * (len(flipped) > 1)} of {' and '.join(flipped)}")
        return ", then ".join(steps)


@dataclass(frozen=True)
class ReadingEvidence:
    """The evidence for a reading: turns of balls at and off cushions, diameter, spread over the table."""

    reading: Reading
    at_cushions: int
    off_cushions: int
    diameter: int  # 1 where balls that meet are a diameter apart, -1 where they are not, 0 where none is seen
    coverage: float

    @property
    def possible(self) -> bool:
        """Whether nothing contradicts it."""
        return self.at_cushions >= self.off_cushions and self.diameter >= 0

    @property
    def holds(self) -> bool:
        """Whether something supports it and nothing contradicts it."""
        return self.possible and (self.at_cushions >= MIN_TURNS or self.coverage > MIN_COVERAGE)

    @property
    def shows_scale(self) -> bool:
        """Whether cushions or the balls' size support the unit, not extents alone."""
        return self.diameter > 0 or self.at_cushions - self.off_cushions >= MIN_TURNS

    @property
    def rank(self) -> tuple[float, ...]:
        """Sort key of readings: evidence, then spread, then how usual the reading is."""
        return (self.support, round(self.coverage, 1), -self.reading.changes)

    @property
    def support(self) -> int:
        """The amount of evidence beyond extents."""
        return min(self.at_cushions - self.off_cushions, MIN_TURNS) + self.diameter


def read_so(clip_set: ClipSet, reading: Reading) -> ClipSet:
    """The clip set with its coordinates converted by another reading."""

    def meant(seen: Observation) -> Observation:
        return dataclasses.replace(seen, xy=reading.metres(seen.xy, clip_set.table))

    clips = tuple(
        dataclasses.replace(clip, balls={n: meant(seen) for n, seen in clip.balls.items()}) for clip in clip_set.clips
    )
    return dataclasses.replace(clip_set, clips=clips)


def places(clips: Sequence[Clip]) -> list[Array]:
    """All finite coordinates of each clip: (n, 2)."""
    found = [np.concatenate([np.zeros((0, 2)), *(seen.xy for seen in clip.balls.values())]) for clip in clips]
    return [xy[np.isfinite(xy).all(axis=1)] for xy in found]


def share_inside(xy: Array, table: Table, ball: Ball) -> float:
    """Share of the places that are on the table or in a pocket."""
    inside = (np.abs(xy) <= np.array([table.length, table.width]) / 2 + MAX_BEYOND_NOSE_M).all(axis=1)
    near = POCKET_REACH * ball.diameter
    dropping = [k for k in np.flatnonzero(~inside).tolist() if table.to_pocket(xy[k]) <= near]
    return float((np.count_nonzero(inside) + len(dropping)) / len(xy))


def may_be_pixels(clip_set: ClipSet) -> bool:
    """Whether coordinates may be those in a picture: none is negative, and a ball is some pixels wide.

    A picture has any scale, so extents alone cannot distinguish pixels from a unit that makes the table as large.
    """
    xy = np.concatenate([np.zeros((0, 2)), *places(clip_set.clips)])
    if not len(xy) or float(xy.min()) < 0:
        return False
    widest = MIN_BALL_PIXELS * clip_set.table.length / clip_set.ball.diameter
    return float(np.ptp(xy, axis=0).max()) >= MIN_COVERAGE * widest


def weighed(clip_set: ClipSet, reading: Reading) -> ReadingEvidence | None:
    """The evidence for a reading; None where it does not put the rows on the table."""
    table, ball = clip_set.table, clip_set.ball
    xy = np.concatenate([np.zeros((0, 2)), *places(clip_set.clips)])
    meant = reading.metres(xy, table)
    if not len(meant) or share_inside(meant, table, ball) < MIN_SHARE_INSIDE:
        return None
    low, high = np.percentile(meant, (1, 99), axis=0)
    coverage = float(np.max(high - low)) / table.length  # along either axis: which is the long one says nothing of it
    so = read_so(clip_set, reading)
    so = dataclasses.replace(so, clips=tuple(clip for clip in so.clips if is_sound(clip)))
    far = turns_in_the_open(so)
    near = int(np.sum(np.abs(far - 1) < AT_CUSHION))
    contact = contact_distance(so)
    fits = 0
    if contact.count > 1:
        fits = -1 if contact.departs(ball.diameter, CERTAIN_DIAMETER * ball.diameter) else 1
    return ReadingEvidence(reading, near, len(far) - near, fits, coverage)


def likely_readings(clip_set: ClipSet, among: Sequence[Reading]) -> list[ReadingEvidence]:
    """Readings that hold, the likeliest first."""
    found = [seen for reading in among if (seen := weighed(clip_set, reading)) is not None and seen.holds]
    return sorted(found, key=lambda seen: seen.rank, reverse=True)


def possible_readings(clip_set: ClipSet, among: Sequence[Reading]) -> list[ReadingEvidence]:
    """Readings that nothing contradicts; they need not be supported by anything."""
    return [seen for reading in among if (seen := weighed(clip_set, reading)) is not None and seen.possible]


def all_readings() -> list[Reading]:
    """The reading without the directions of its axes: unit, origin and axis."""
    return [Reading(*one) for one in product(METRES_BY_UNIT, (False, True), (False, True))]


def directed(clip_set: ClipSet, reading: Reading) -> Reading | None:
    """The reading with the directions of its axes that commanded azimuths fit; None where they determine none."""
    for exchanged in (reading.exchanged, not reading.exchanged):
        for y_down, turned in product((False, True), (False, True)):
            other = dataclasses.replace(reading, exchanged=exchanged, y_down=y_down, turned=turned)
            if exchanged != reading.exchanged and weighed(clip_set, other) is None:
                continue
            pairs = aims(read_so(clip_set, other))
            if pairs is not None and off_aim(pairs) < FITTING_TURN:
                return other
    return None
