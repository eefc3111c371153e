"""Shots for a review, one after another on a timeline: measured balls, and every model's.

Clips follow one another on the timeline `shot_time` [s], each with its t = 0 at a whole second; `clip` counts them.
Error e(t) = modelled(t) - measured(t), the model interpolated linearly to the measured times, where both exist.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.table import Out
from models.shot import Array, Event, Track
from models.table.palette import Colour, ball_colour, ink

Series = Mapping[str, tuple[Array, Array]]  # ball -> time (n,) [s] in its clip, increasing; values (n, k)
Rows = tuple[Sequence[int] | Array, Sequence[float] | Array, Sequence[int] | Array]  # clip, time [s], instances

CLIP_GAP_S = 0.5  # least pause between two clips [s]
UNSEEN_S = 0.05  # a ball without data for so long at its clip's end is hidden [s]
MOVED_M = 0.003  # a ball with a smaller range of positions rested
MIN_STEP_M = 1e-6  # a model's ball that moves less from sample to sample is not drawn anew


@dataclass(frozen=True)
class Review:
    """One clip: where each ball was seen, and where the models have it."""

    name: str
    measured: Series  # values are xy (n, 2) [m], table frame; NaN where unseen
    models: Mapping[str, Track] = field(default_factory=dict)  # by label, in the order of the ladder
    note: str = ""
    colours: Mapping[str, Colour] = field(default_factory=dict)  # of balls, in place of the usual ones


@dataclass(frozen=True)
class LaidClip:
    """A review on the timeline: t = 0 at `start`, everything within `first` to `last` [s]."""

    review: Review
    index: int  # 1, 2, ...
    start: float
    first: float
    last: float
    places: Mapping[str, Series]  # "" measured, else a model's label: x, y [m]
    errors: Mapping[str, Series]  # by label: distance, x, y [mm]

    def events(self, label: str) -> list[tuple[Event, Array]]:
        """A model's events in order of time, each with the places of its balls (k, 2) [m], last ones if potted."""
        found, tracks = [], self.review.models
        for event in sorted(tracks[label].events if label in tracks else (), key=lambda event: event.time):
            paths = [finite(*self.places[label][name]) for name in event.balls if name in self.places[label]]
            spots = [[np.interp(event.time, time, axis) for axis in xy.T] for time, xy in paths if time.size]
            found.append((event, np.reshape(spots, (-1, 2))))
        return found

    def distances(self, label: str, *names: str) -> Array:
        """Sizes of a model's position errors of the balls named, of all balls when none is: (m,) [mm]."""
        known = self.errors.get(label, {})
        errors = [known[name] for name in names or known if name in known]
        return np.concatenate([np.empty(0), *(finite(*error)[1][:, 0] for error in errors)])


@dataclass(frozen=True)
class ReviewOut(Out):
    """The open recording of a review."""

    clips: Sequence[LaidClip]
    counter: str = "clip"  # the timeline that counts them

    def moving(self, path: str, kind: Any, style: Mapping[str, Any], data: Mapping[str, Any], rows: Rows) -> None:
        """Log an archetype with a fixed style, if any, and the rows' instances of data."""
        if style:
            self.fixed(path, kind.from_fields(**style))
        time = self.rr.TimeColumn("shot_time", duration=np.asarray(rows[1], dtype=float))
        clip = self.rr.TimeColumn(self.counter, sequence=np.asarray(rows[0], dtype=int))
        self.stream.send_columns(path, [time, clip], kind.columns(**data).partition(rows[2]), strict=True)

    def labels(self) -> list[str]:
        """Every model, in the order of the ladder."""
        return labels_of(self.clips)

    def names(self, label: str) -> list[str]:
        """Every ball that was measured ("") or that a model has, over all clips, in order of appearance."""
        return list(dict.fromkeys(name for clip in self.clips for name in clip.places.get(label, {})))

    def colour(self, name: str) -> Colour:
        """The ball's colour in the first clip that gives it one, else its usual colour."""
        return next((c.review.colours[name] for c in self.clips if name in c.review.colours), ball_colour(name))

    def curve_colour(self, name: str) -> Colour:
        """The same, as it shows in the viewer's dark theme and in its light one."""
        return ink(self.colour(name))

    def per_clip(self, count: Sequence[int] | None = None) -> Rows:
        """One row at each clip's beginning."""
        return [c.index for c in self.clips], [c.first for c in self.clips], count or [1] * len(self.clips)


def labels_of(clips: Sequence[LaidClip]) -> list[str]:
    """Every model of the clips, in the order of the ladder."""
    return list(dict.fromkeys(label for clip in clips for label in clip.review.models))


def finite(time: Array, values: Array) -> tuple[Array, Array]:
    """The samples that are known."""
    known = np.isfinite(values).all(axis=1)
    return time[known], values[known]


def lay_out(reviews: Sequence[Review]) -> list[LaidClip]:
    """The clips one after another; ValueError for arrays that do not fit each other, or without a clip."""
    clips: list[LaidClip] = []
    for index, review in enumerate(reviews, start=1):
        for name, (time, xy) in review.measured.items():
            if np.ndim(time) != 1 or np.shape(xy) != (len(time), 2):
                shapes = f"time {np.shape(time)}, xy {np.shape(xy)}"
                raise ValueError(f"clip {review.name!r}, ball {name!r}: {shapes}; want (n,) and (n, 2)")
        places: dict[str, Series] = {"": review.measured}
        for label, track in review.models.items():
            places[label] = {name: (track.times, track.position[:, k]) for k, name in enumerate(track.names)}
        errors = {label: _errors(review.measured, places[label]) for label in review.models}
        all_times = np.concatenate([np.zeros(1), *(time for one in places.values() for time, _ in one.values())])
        low, high = float(all_times.min()), float(all_times.max())
        start = math.ceil(clips[-1].last + CLIP_GAP_S - low) if clips else 0.0
        clips.append(LaidClip(review, index, start, start + low, start + high, places, errors))
    if not clips:
        raise ValueError("no clips to review")
    return clips


def _errors(measured: Series, modelled: Series) -> Series:
    """Distance and its parts along x and y of every ball that both have: (n, 3) [mm]."""
    found = {}
    for name in (name for name in measured if name in modelled):
        (time, xy), (times, path) = measured[name], modelled[name]
        at = [np.interp(time, times, axis, left=math.nan, right=math.nan) for axis in path.T]
        e = 1e3 * (np.stack(at, axis=1) - xy)
        found[name] = time, np.column_stack([np.hypot(*e.T), e])
    return found


def appearances(clips: Sequence[LaidClip], label: str, name: str) -> tuple[Rows, Array]:
    """Rows of a ball over all clips and its points (m, 2) [m]; a row without a point hides the ball.

    Samples that show nothing new are left out: those of a ball that rests.
    """
    index, times, shown, points = [], [], [], []
    for clip in clips:
        time, xy = clip.places.get(label, {}).get(name, (np.empty(0), np.empty((0, 2))))
        kept = _telling(xy, label == "")
        time, xy = clip.start + time[kept], xy[kept]
        seen: NDArray[np.bool_] = np.asarray(np.isfinite(xy).all(axis=1))
        points.append(xy[seen])
        if not time.size or time[0] > clip.first:
            time, seen = np.append(clip.first, time), np.append(False, seen)
        if seen[-1] and time[-1] < clip.last - UNSEEN_S:
            time, seen = np.append(time, time[-1] + UNSEEN_S), np.append(seen, False)
        index.append(np.full(time.size, clip.index))
        times.append(time)
        shown.append(seen.astype(int))
    return (np.concatenate(index), np.concatenate(times), np.concatenate(shown)), np.concatenate(points)


def _telling(xy: Array, measured: bool) -> NDArray[np.int64]:
    """Samples of places (n, 2) [m] that move a ball, show or hide it; the first and the last always."""
    n = len(xy)
    seen: NDArray[np.bool_] = np.asarray(np.isfinite(xy).all(axis=1))
    if n < 3:
        return np.arange(n)
    if measured:
        rests = bool(seen.all()) and float(np.ptp(xy, axis=0).max()) < MOVED_M
        return np.array([0, n - 1]) if rests else np.arange(n)
    step = np.hypot(*np.diff(xy, axis=0).T)  # NaN where it is hidden on either side
    new = (seen[1:] != seen[:-1]) | (step > MIN_STEP_M)
    kept = np.concatenate([[True], new]) | np.concatenate([new, [True]])
    return np.flatnonzero(kept)
