"""Single shots that depart from a model that follows the others to the noise: named, and excluded from the fit.

In: clips (`Split`) and their fit (`FittedModel`). Out: both without those shots.

What no effect explains, and only one shot in many shows, is no structure of the table: another ball was taken, a hand
touched the cloth, frames were dropped, a tracker slipped. Left in, such a shot biases constants and invites effects
that bend only its own track.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence

import numpy as np

from sysid.estimation.fitted import FittedModel, Point
from sysid.estimation.fitting import fit
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.split import Split, tried
from sysid.selection.evidence import MAX_RESIDUAL_SD, correlation_time, mean_squares

MIN_RATIO = 1.7  # of a shot's mean square over the median of all, for it to depart
MIN_RATIO_SD = 6.0  # and standard deviations above it
MIN_ALLOWED, MAX_SHARE = 2, 0.1  # shots, and share of all, more of which are no exceptions
MAX_MEDIAN = 1.3  # of the mean squares, for the model to follow the others
log = logging.getLogger(__name__)


def departing(squares: Array, counts: Array, tau: float, median: float) -> Index:
    """Shots that depart.

    Args:
        squares: (n,) mean square of the residuals of each shot.
        counts: (n,) how many residuals it has.
        tau: integrated autocorrelation time of residuals [samples].
        median: of the mean squares of the training shots.
    """
    ratio = squares / median
    sd = np.sqrt(2.0 * tau / np.maximum(counts, 1))
    return np.flatnonzero((ratio > MIN_RATIO) & (ratio - 1.0 > MIN_RATIO_SD * sd))


def departure_lines(problem: ShotProblem, rows: Index, ratios: Array) -> tuple[str, ...]:
    """One line for each shot that departs; ratios (n,) of mean squares."""
    return tuple(
        f"{problem.clips[k].file}: set aside, it departs alone, with {np.sqrt(ratios[k]):.2g} times the error of the "
        "others, and no effect explains it: look at its film"
        for k in rows.tolist()
    )


def without_departing(parts: Split, ladder: Sequence[FittedModel]) -> tuple[Split, tuple[FittedModel, ...]] | None:
    """The clips without shots that depart from the last fit, and all fits anew; None where none or too many depart."""
    last, held = ladder[-1], ladder[-1].held_out
    squares, counts = mean_squares(last.residuals(), MAX_RESIDUAL_SD)
    median = float(np.median(squares))
    if parts.cut or median > MAX_MEDIAN:
        return None
    tau = correlation_time(last, last.discrepancy_rate)
    odd = departing(squares, counts, tau, median)
    held_squares, held_counts = mean_squares(held.residuals, MAX_RESIDUAL_SD) if held else (np.zeros(0), np.zeros(0))
    odd_held = departing(held_squares, held_counts, tau, median)
    total = len(counts) + len(held_counts)
    if not 0 < odd.size + odd_held.size <= max(MIN_ALLOWED, int(MAX_SHARE * total)):
        return None
    lines = departure_lines(last.problem, odd, squares / median)
    kept = np.setdiff1d(np.arange(len(counts)), odd)
    held_out = parts.held_out
    if held_out is not None and odd_held.size:
        lines += departure_lines(held_out, odd_held, held_squares / median)
        rest = np.setdiff1d(np.arange(len(held_counts)), odd_held)
        held_out = held_out.only(rest) if rest.size else None
    fewer = parts.excluding(lines, parts.training.only(kept), held_out)
    return fewer, tuple(_fit_again(fewer, one, kept) for one in ladder)


def _fit_again(parts: Split, found: FittedModel, kept: Index) -> FittedModel:
    """The fit anew, of some of its shots."""
    start = Point(found.problem.only(kept), found.initial_states[kept], found.constants, found.discrepancy_rate)
    return tried(parts, fit(start, "without shots that depart"), None)
