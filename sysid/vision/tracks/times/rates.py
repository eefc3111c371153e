"""Pictures taken at one rate and stored at another, at even stamps.

In: the tracks, at times of stamps. Out: when the pictures were taken.

A recorder that waits for a slower camera stores some of its pictures twice. Without these, the others seem to come at
uneven times, though the camera took them at even ones: then the balls' steps are even. A conversion to a lower rate
leaves out one picture of every few: balls then take double steps at regular intervals, and the stamps are right in the
mean. Pictures that are missing at irregular places were lost: then all stamps after them are early.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import savgol_filter

from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.follow import BallTrack
from sysid.vision.tracks.times.picks import free_runs, step_misfit

MEAN_PICTURES = 31  # whose stamps show together when the middle one was taken
MAX_PAUSE_PERIODS = 3.5  # a longer one between stamps is real
MIN_LATE_PERIODS = 1.4  # of a step over pictures that were stored twice,
MIN_LATE_STEPS = 8  # in a film; fewer say nothing of the rate of its camera
MIN_UNEVEN_PERIODS = 0.1  # standard deviation of the stamps from even times, for them to be in question
MAX_EVEN_MISFIT = 0.5  # of the steps of balls to even times, over that to the stamps
MIN_REGULAR = 5  # gaps
MIN_REGULAR_SHARE = 0.8  # of all gaps, that are at regular intervals,
MIN_SEEN_SHARE = 0.5  # and of such places between the first and the last of them, at which there is a gap
MAX_INTERVAL = 12  # pictures


@dataclass(frozen=True)
class Conversion:
    """To a lower rate: at regular intervals one picture was left out."""

    interval: int  # from one gap to the next [stored pictures]
    phase: int  # a frame before which one is missing, less than the interval

    @property
    def share(self) -> float:
        """Of the pictures, that were stored."""
        return self.interval / (self.interval + 1)

    def source_times(self, frames: NDArray[np.int64], times: Array, period: float) -> Array:
        """When frames (n,), stored at times (n,) [s] in intervals `period`, were taken."""
        left_out = (frames - self.phase) // self.interval
        begin = times[0] - frames[0] * period  # of the film, where both clocks agree
        return np.asarray(begin + (times - begin + left_out * period) * self.share)

    def text(self, period: float) -> str:
        """What to report of it."""
        rates = f"{1 / (period * self.share):.4g} frames/s stored as {1 / period:.4g}"
        return f"one of {self.interval + 1} pictures is missing, as of {rates}: times corrected"


def even_times(
    tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array, sigma: float
) -> tuple[Array, float] | None:
    """Times (n,) of different pictures (n,) that were taken at a constant rate, and their interval [s].

    None where they were stored at even times (n,) [s], or where the steps of balls agree with the stamps.
    """
    period = float(np.median(np.diff(times)))
    if np.count_nonzero(np.diff(times) > MIN_LATE_PERIODS * period) < MIN_LATE_STEPS:
        return None
    even = np.concatenate([_smooth(part) for part in np.split(times, _pauses(times, period))])
    if float(np.std(even - times)) < MIN_UNEVEN_PERIODS * period:
        return None
    runs, all_steps = free_runs(tracks, frames, sigma), np.ones(len(times) - 1, bool)
    misfit, by_stamps = (step_misfit(runs, np.diff(t) / period, all_steps, period) for t in (even, times))
    if not misfit < MAX_EVEN_MISFIT * by_stamps:
        return None
    seen = np.concatenate([run.at for run in runs])  # where nothing moves, pictures stored twice may go unnoticed
    return even, float(np.median(np.diff(even)[seen]))


def _pauses(times: Array, period: float) -> NDArray[np.intp]:
    """Which times begin after a pause."""
    return np.flatnonzero(np.diff(times) > MAX_PAUSE_PERIODS * period) + 1


def _smooth(times: Array) -> Array:
    """Local linear regression of times on their order (n,)."""
    window = min(MEAN_PICTURES, len(times) - 1 + len(times) % 2)
    return np.asarray(savgol_filter(times, window, 1)) if window > 2 else times


def regular_gaps(gaps: Mapping[int, int]) -> Conversion | None:
    """A conversion that explains the gaps, by the frame after each; None where they are irregular, or few."""
    single = [frame for frame, count in gaps.items() if count == 1]
    for interval in range(MAX_INTERVAL, 1, -1):
        phases = Counter(frame % interval for frame in single)
        phase, count = max(phases.items(), key=lambda one: one[1], default=(0, 0))
        if count < max(MIN_REGULAR, MIN_REGULAR_SHARE * len(gaps)):
            continue
        places = [frame // interval for frame in single if frame % interval == phase]
        if count >= MIN_SEEN_SHARE * (max(places) - min(places) + 1):
            return Conversion(interval, phase)
    return None
