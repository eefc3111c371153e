"""Units, origin and axes of a whole clip set: coordinates and times that are all wrong in the same way.

In: the `Rows` of all clips with the table and the frame rate that clips.toml states. Out: one fault in place of one for
every row. A reading is tried where many rows lie off the table: other units, the origin in a corner, x and y exchanged;
the one that puts all rows on the table and covers most of it is named.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from models.shot import Array, Ball, Table
from sysid.clips.rows import Rows

METRES_BY_UNIT = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inches": 0.0254}
SECONDS_BY_UNIT = {"milliseconds": 1e-3, "microseconds": 1e-6}
MIN_SHARE_OUTSIDE = 0.05  # of the rows of a clip, for its coordinates to be suspect
MIN_SHARE_SUSPECT = 0.5  # of the clips, for the set to be
MIN_SHARE_INSIDE = 0.99  # of all rows, for another reading to be right
MIN_ROWS = 30  # of all clips, below which rows are looked at one by one
MAX_IN_POCKET_DIAMETERS = 2.0  # beyond the nose line, of a ball that drops
MIN_COVERAGE = 0.25  # of the table's length or width by the rows: fewer are in too large a unit
MAX_OFF_UNIT = 0.3  # of an interval from a frame's in another unit, relative
MIN_FRAMES_APART = 5.0  # nominal frames between rows, from which whole numbers count frames
WHOLE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Reading:
    """A way to read coordinates; as they are meant to be read by default."""

    unit: str = "m"
    corner: bool = False  # the origin is where the nose lines meet at -x, -y
    exchanged: bool = False

    @property
    def changes(self) -> int:
        """By how many things it differs from what is meant."""
        return (self.unit != "m") + self.corner + self.exchanged

    def metres(self, xy: Array, table: Table) -> Array:
        """Coordinates as they were meant: (n, 2) [m], table frame."""
        meant = (xy[:, ::-1] if self.exchanged else xy) * METRES_BY_UNIT[self.unit]
        return meant - np.array([table.length, table.width]) / 2 * self.corner

    def words(self) -> tuple[str, str]:
        """What the coordinates look like, and the remedy."""
        factor = METRES_BY_UNIT[self.unit]
        by = f"divide them by {1 / factor:.6g}" if factor in (0.01, 0.001) else f"multiply them by {factor:.6g}"
        looks = [f"{self.unit}" if self.unit != "m" else "metres"]
        remedies = [by] if self.unit != "m" else []
        if self.corner:
            looks.append("from a corner")
            remedies.append("subtract half the table's length and half its width")
        if self.exchanged:
            looks.append("with x and y exchanged")
            remedies.insert(0, "exchange the columns")
        return " ".join(looks), ", then ".join(remedies)


def coordinates_fault(clips: Sequence[Rows], table: Table, ball: Ball) -> str | None:
    """How the coordinates of most clips must have been written, where that is not in metres from the centre."""
    all_xy = [rows.xy[np.isfinite(rows.xy).all(axis=1)] for rows in clips]
    all_xy = [xy for xy in all_xy if len(xy)]
    suspect = [_inside(xy, table, ball) < 1 - MIN_SHARE_OUTSIDE for xy in all_xy]
    if sum(map(len, all_xy)) < MIN_ROWS or np.mean(suspect) < MIN_SHARE_SUSPECT:
        return None
    xy = np.concatenate(all_xy)
    fits = []
    for unit, corner, exchanged in product(METRES_BY_UNIT, (False, True), (False, True)):
        reading = Reading(unit, corner, exchanged)
        meant = reading.metres(xy, table)
        covers = _coverage(meant, table)
        if reading.changes and _inside(meant, table, ball) >= MIN_SHARE_INSIDE and covers > MIN_COVERAGE:
            fits.append((round(covers, 1), -reading.changes, reading))
    if not fits:
        return None
    looks, remedy = max(fits, key=lambda fit: fit[:2])[2].words()
    (x0, y0), (x1, y1) = np.percentile(xy, (0, 100), axis=0)
    return (
        f"x runs from {x0:.4g} to {x1:.4g} and y from {y0:.4g} to {y1:.4g} on a table {table.length:g} m long and "
        f"{table.width:g} m wide, and look like {looks}: {remedy}"
    )


def _inside(xy: Array, table: Table, ball: Ball) -> float:
    """Share of the places that are on the table or in a pocket."""
    limit = np.array([table.length, table.width]) / 2 + MAX_IN_POCKET_DIAMETERS * ball.diameter
    return float(np.mean((np.abs(xy) <= limit).all(axis=1)))


def _coverage(xy: Array, table: Table) -> float:
    """Share of the table's length or width over which the places are spread, the larger."""
    low, high = np.percentile(xy, (1, 99), axis=0)
    return float(np.max((high - low) / np.array([table.length, table.width])))


def times_fault(clips: Sequence[Rows], fps: float) -> str | None:
    """The unit in which the times of all clips must have been written, where that is not seconds."""
    steps = np.concatenate([np.zeros(0), *(np.diff(np.unique(rows.time[np.isfinite(rows.time)])) for rows in clips)])
    if len(steps) < MIN_ROWS:
        return None
    step = float(np.median(steps))
    head = f"rows are {step:.4g} apart where {fps:g} frames a second make {1 / fps:.4g} s"
    for unit, seconds in SECONDS_BY_UNIT.items():
        if abs(step * fps * seconds - 1) < MAX_OFF_UNIT:
            return f"{head}, and t looks like {unit}: divide it by {1 / seconds:.0f}"
    whole = np.abs(steps - np.round(steps)) < WHOLE_TOLERANCE
    if step * fps > MIN_FRAMES_APART and whole.all() and step < MIN_FRAMES_APART:
        return f"{head}, and t counts frames: divide it by the frame rate"
    return None
