"""A contradiction between a clip set's tracks and its entries, and the typical values that show it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sysid.clips.clip_set import Clip

ALL_CLIPS = "all clips"
MIN_SIGNIFICANCE = 5.0  # standard errors
MAX_PLACE_M, MAX_TIME_S, MIN_STEP_S = 100.0, 1e7, 1e-6  # limits of rows that computations can handle


@dataclass(frozen=True)
class Contradiction:
    """A contradiction as one line with its remedy."""

    where: str  # the file whose statement the tracks contradict, or all clips
    text: str
    certain: bool  # whether it is a fault; otherwise it is a warning
    places: bool = False  # whether it implies that many balls lie off the stated table
    unless: str = ""  # entry of clips.toml with which its author confirms the values nevertheless


@dataclass(frozen=True)
class Typical:
    """The median of some values, and its standard error."""

    value: float
    error: float
    count: int

    def departs(self, from_value: float, tolerance: float) -> bool:
        """Whether it differs from a value by more than a tolerance and by more than chance explains."""
        off = abs(self.value - from_value)  # NaN of none
        return off > max(tolerance, MIN_SIGNIFICANCE * self.error)


def typical(values: list[float], least_count: int, least_spread: float = 0.0) -> Typical:
    """Median and standard error of some values; the error of too few values is infinite."""
    if len(values) < least_count:
        return Typical(np.nan, np.inf, len(values))
    median = float(np.median(values))
    spread = max(1.4826 * float(np.median(np.abs(np.array(values) - median))), least_spread)
    return Typical(median, 1.2533 * spread / np.sqrt(len(values)), len(values))


def is_sound(clip: Clip) -> bool:
    """Whether times increase and all values are finite and within the limits of computations."""
    return bool(clip.balls) and all(
        len(seen.time) > 0
        and bool((np.abs(seen.time) < MAX_TIME_S).all())
        and bool((np.abs(seen.xy) < MAX_PLACE_M).all())
        and bool((np.diff(seen.time) > MIN_STEP_S).all())
        for seen in clip.balls.values()
    )
