"""Single shots that depart from a model that follows all others: they are reported and excluded.

In: clips (`Split`) and their fit (`FittedModel`). Out: both without these shots.

A departure that no effect explains, and only one shot in many shows, is not a property of the table: another ball was
used, a hand touched the cloth, frames were dropped, the tracker failed. Such a shot would bias constants and favour
effects that change only its own track.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.shot import Event
from sysid.estimation.fitted import FittedModel, HeldOut, Point
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.split import Split, fit_on
from sysid.estimation.states.initial_states import fit_states
from sysid.selection.scoring.evidence import MAX_RESIDUAL_SD, mean_squares

MIN_RATIO = 1.7  # least ratio of a departing shot's mean square to the median of all
MIN_RATIO_SD = 6.0  # least distance of a departing shot's mean square from the median, in standard deviations
MIN_ALLOWED, MAX_SHARE = 2, 0.1  # shots, and share of all, up to which departures are exceptions
MAX_MEDIAN = 1.3  # largest median of the mean squares at which the model follows the others
LOCATING_STEPS = 15  # iterations of the initial states up to each event
MIN_SHARED, MIN_SHARED_SHARE = 2, 0.7  # shots, and share of all that depart, for a shared kind of event


def departing(squares: Array, counts: Array, tau: float, median: float) -> Index:
    """Which shots depart: (n,).

    Args:
        squares: (n,) mean square of the residuals of each shot.
        counts: (n,) how many residuals it has.
        tau: integrated autocorrelation time of the noise [samples].
        median: of the mean squares of the training shots.
    """
    ratio = squares / median
    sd = np.sqrt(2.0 * tau / np.maximum(counts, 1))
    return np.flatnonzero((ratio > MIN_RATIO) & (ratio - 1.0 > MIN_RATIO_SD * sd))


@dataclass(frozen=True)
class ShotDeparture:
    """A shot that departs, and the event after which it does."""

    row: int
    size: float  # rms of its residuals over that of the others
    event: Event | None  # after which it departs; None if it does so from its start

    def text(self, file: str) -> str:
        """A line that reports its exclusion."""
        since = "from its start"
        if self.event is not None:
            with_ = f"its impact at the cushion {self.event.rail}" if self.event.rail else "its impact with a ball"
            since = f"from {with_} at {self.event.time:.2f} s on"
        return (
            f"{file}: excluded: it alone departs, with {self.size:.2g} times the error of the others, {since}, and no "
            "effect that other clips show explains it; look at its film"
        )


def located(at: Point, rows: Index, sizes: Array, tau: float, median: float) -> list[ShotDeparture]:
    """The event after which each of these shots departs: the first up to which it is not followed.

    Args:
        at: the fit.
        rows: of shots that depart.
        sizes: rms of their residuals over that of the others.
        tau: see `departing`.
        median: see `departing`.
    """
    if not rows.size:
        return []
    few, x = at.problem.only(rows), at.initial_states[rows]
    c, every = np.tile(at.constants, (len(rows), 1)), np.arange(len(rows))
    events: dict[int, Event | None] = {}
    for stage in range(few.stages):
        before, seen = x, few.until(few.horizon_at(stage))
        x = fit_states(seen, x, at.constants, LOCATING_STEPS)
        lost = departing(*mean_squares(seen.evaluate(x, c, every), MAX_RESIDUAL_SD), tau, median)
        for k in lost.tolist():
            if k not in events:
                events[k] = _nearest(few, before, c, k, few.events[k][stage - 1]) if stage else None
    return [
        ShotDeparture(row, size, events.get(k))
        for k, (row, size) in enumerate(zip(rows.tolist(), sizes.tolist(), strict=True))
    ]


def _nearest(problem: ShotProblem, x: Array, c: Array, row: int, time: float) -> Event | None:
    """The modelled event nearest to a time, of the balls that move first."""
    (track,) = problem.tracks(x[row : row + 1], c[row : row + 1], np.array([row]))
    own = [event for event in track.events if set(problem.clips[row].first) & set(event.balls)]
    return min(own, key=lambda event: abs(event.time - time), default=None)


def without_departing(parts: Split, ladder: Sequence[FittedModel]) -> tuple[Split, tuple[FittedModel, ...]] | None:
    """Exclude shots that depart from the last fit, and repeat all fits; None if none or too many depart."""
    last, held = ladder[-1], ladder[-1].held_out
    odd, sizes, tau, median = _departing_from(last)
    if median > MAX_MEDIAN:
        return None
    odd_held, held_sizes = _departing_held_out(held, tau, median)
    held_count = len(held.initial_states) if held is not None else 0
    allowed = max(MIN_ALLOWED, int(MAX_SHARE * (len(last.initial_states) + held_count)))
    if not 0 < odd.size + odd_held.size <= allowed:
        return None
    found = located(last, odd, sizes, tau, median)
    lines = tuple(one.text(last.problem.clips[one.row].file) for one in found)
    held_out, rest = parts.held_out, np.arange(held_count)
    if held_out is not None and held is not None and odd_held.size:
        seen = Point(
            held_out.with_model(last.problem.model, last.names),
            held.initial_states,
            last.constants,
            last.discrepancy_rate,
        )
        others = located(seen, odd_held, held_sizes, tau, median)
        found, lines = found + others, lines + tuple(one.text(held_out.clips[one.row].file) for one in others)
        rest = np.setdiff1d(rest, odd_held)
        held_out = held_out.only(rest) if rest.size else None
    if common_event(found) is not None:
        return None
    kept = np.setdiff1d(np.arange(len(last.initial_states)), odd)
    fewer = parts.excluding(lines, parts.training.only(kept), held_out)
    return fewer, tuple(_fit_again(fewer, one, kept, rest) for one in ladder)


def departing_held_out(last: FittedModel) -> list[int]:
    """Held-out shots that depart from a fit that follows the others."""
    _, _, tau, median = _departing_from(last)
    return [] if median > MAX_MEDIAN else _departing_held_out(last.held_out, tau, median)[0].tolist()


def count_departing(last: FittedModel) -> int:
    """How many shots depart from a fit, in training and held out."""
    return len(_departing_from(last)[0]) + len(departing_held_out(last))


def shared_cause(now: Point) -> str | None:
    """The kind of event after which departing shots depart; None if they share none, or none departs."""
    rows, sizes, tau, median = _departing_from(now)
    if median > MAX_MEDIAN or not rows.size:
        return None
    return common_event(located(now, rows, sizes, tau, median))


def _departing_from(at: Point) -> tuple[Index, Array, float, float]:
    """Shots that depart from a fit, their rms over that of the others, and `tau` and `median` as in `departing`."""
    squares, counts = mean_squares(at.residuals(), MAX_RESIDUAL_SD)
    tau, median = at.problem.correlation_time, float(np.median(squares))
    rows = departing(squares, counts, tau, median)
    return rows, np.sqrt(squares[rows] / median), tau, median


def _departing_held_out(held: HeldOut | None, tau: float, median: float) -> tuple[Index, Array]:
    """Held-out shots that depart, with constants as far as the fit leaves them open, and their rms as above."""
    if held is None:
        return np.zeros(0, int), np.zeros(0)
    squares, counts = mean_squares(held.open_residuals, MAX_RESIDUAL_SD)
    rows = departing(squares, counts, tau, median)
    return rows, np.sqrt(squares[rows] / median)


def common_event(found: Sequence[ShotDeparture]) -> str | None:
    """The kind of event after which several shots depart, which suggests a common cause; None if there is none."""
    kinds = Counter(one.event.kind if one.event else "start" for one in found)
    kind, count = kinds.most_common(1)[0] if kinds else ("", 0)
    return kind if count >= MIN_SHARED and count >= MIN_SHARED_SHARE * len(found) else None


def _fit_again(parts: Split, found: FittedModel, kept: Index, held: Index) -> FittedModel:
    """Repeat the fit for some of its shots, and of the held-out ones."""
    if found.held_out is not None:
        states = found.held_out.initial_states[held]
        found = dataclasses.replace(found, held_out=dataclasses.replace(found.held_out, initial_states=states))
    start = Point(found.problem.only(kept), found.initial_states[kept], found.constants, found.discrepancy_rate)
    return fit_on(parts, start, found, "without shots that depart")
