"""Frames that are picks of a finer sequence: stored at even stamps, taken at uneven times.

In: the tracks, at times of stamps. Out: how long after the one before each frame was taken, in units of the finer
sequence. Cut or converted films keep one, two or three pictures of 60 a second in turn, so that every ball that moves
seems to scatter along its way, all at once and not across it. A ball that rolls freely shows the time between two
frames by the length of its step beside those around it; the balls of a frame must agree. No frame is late by a period
or more, so the steps before and after an impact, which itself shows nothing, together determine when its frames were
taken. Nothing is changed unless such times explain the steps far better than the stamps do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from models.messages import counted
from sysid.vision.camera.projection import Array
from sysid.vision.tracks.following.follow import BallTrack

FINER_PICTURES = 2  # of a period: the finer sequence has twice as many pictures
MIN_STEP_SD = 4.0  # of a step that counts, in standard deviations of its own,
MIN_STEP_M = 2e-3  # and its length
MIN_SD_M = 2e-5  # of a place
MAX_TURN_SINE = 0.3  # between steps of a ball that rolls freely, beside what noise turns them
IMPACT_STEPS = 4  # before an impact and after it,
MAX_SPEED_RATIO = 1.7  # of whose means there is none
SPEED_STEPS = 5  # steps on either side, from which the speed at one is estimated
MIN_WINDOW = 5  # steps of it that are there
UNEVEN_SD = 0.4  # of durations that seem uneven [periods]
MIN_UNEVEN_RATIO = 2.5  # of second differences of places along the way of balls to those across it, median,
MIN_UNEVEN_CHANGE = 0.15  # and to the steps
MIN_STEPS = 20  # that show it,
PART_STEPS = 100  # in a part of a film
ROUND_SDS = (0.4, 0.3, 0.2, 0.1, 0.0, 0.0, 0.0)  # of durations, in rounds of speeds and durations in turn [periods]
ACCELERATION_SD_M_S2 = 1.0  # of a ball that rolls or slides
MAX_SD_PARTS = 0.25  # of the duration of a step, of one part, beyond which the stamps are kept
MAX_OFF_PARTS = 0.4  # of a duration from a whole number of them
MIN_UNEVEN = 8  # durations that are not what stamps say,
MIN_UNEVEN_FRACTION = 0.2  # and of those that are known,
MIN_KNOWN_FRACTION = 0.75  # of those that can be, by agreeing balls
MAX_ERROR_RATIO = (
    0.35  # of the mean misfit of steps to that by the stamps; picks from four times as many leave 0.39 or more
)
CHANGE_COST = 1e-3  # of what no step shows, so that a frame is as late as the one before


@dataclass(frozen=True)
class Picks:
    """Durations of some steps between frames."""

    durations: dict[int, int]  # in parts of a period, by the frame that ends the step, where it is not what stamps say

    def delays(self, frames: NDArray[np.int64], times: Array, period: float) -> Array:
        """What is to be added to the stamps (n,) of all frames (n,) [s]."""
        late = np.zeros(len(frames))
        for k in range(1, len(frames)):
            if (parts := self.durations.get(int(frames[k]))) is not None:
                late[k] = parts * period / FINER_PICTURES - (times[k] - times[k - 1])
        return np.cumsum(late)

    def text(self, period: float) -> str:
        """What to report of it."""
        changed = f"{counted(len(self.durations), 'interval')} corrected by the steps of all moving balls"
        return f"frames were picked from {FINER_PICTURES / period:.4g} a second, at uneven times: {changed}"


def seem_uneven(tracks: Sequence[BallTrack], frames: NDArray[np.int64]) -> bool:
    """Whether balls scatter along their ways far more than across them, as frames at uneven times make them.

    In some part of the film: a conversion may change on the way, and many a film ends with slow balls.
    """
    along, across, steps, order = [], [], [], []
    for track in tracks:
        step = np.diff(track.xy, axis=0)
        length = np.linalg.norm(step, axis=1)
        ok = (np.diff(np.searchsorted(frames, track.frame)) == 1) & (length > MIN_STEP_M)
        both = ok[1:] & ok[:-1]
        way = (step[1:] + step[:-1])[both]
        way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)
        change = (step[1:] - step[:-1])[both]
        along.append(np.abs(np.sum(change * way, axis=1)))
        across.append(np.abs(change[:, 0] * way[:, 1] - change[:, 1] * way[:, 0]))
        steps.append((length[1:] + length[:-1])[both] / 2)
        order.append(track.frame[1:-1][both])
    if sum(map(len, order)) < MIN_STEPS:
        return False
    in_time = np.argsort(np.concatenate(order), kind="stable")
    change, lateral, length = (np.concatenate(v)[in_time] for v in (along, across, steps))
    parts = np.array_split(np.arange(len(change)), max(len(change) // PART_STEPS, 1))
    return any(
        float(np.median(change[part])) > MIN_UNEVEN_RATIO * float(np.median(lateral[part]))
        and float(np.median(change[part] / length[part])) > MIN_UNEVEN_CHANGE
        for part in parts
    )


@dataclass(frozen=True)
class Run:
    """Steps in a row of a ball that rolls freely."""

    at: NDArray[np.int64]  # (n,) index of the step, among those between frames
    length: Array  # (n,) [m]
    sd: float  # of a length [m]


def find_picks(
    tracks: Sequence[BallTrack], frames: NDArray[np.int64], times: Array, period: float, sigma: float
) -> Picks | None:
    """The finer sequence that frames (n,) at times (n,) [s] were picked from, if balls show one beyond doubt."""
    runs = free_runs(tracks, frames, sigma)
    stamps = np.diff(times) / period
    durations, determined = _durations(runs, stamps, period)
    uneven = determined & (np.abs(durations - stamps) > 0.5 / FINER_PICTURES)
    if uneven.sum() < max(MIN_UNEVEN, MIN_UNEVEN_FRACTION * determined.sum()):
        return None
    change = np.diff(_late(runs, durations, stamps, period))
    misfit = step_misfit(runs, stamps + change / FINER_PICTURES, determined, period)
    if misfit > MAX_ERROR_RATIO * step_misfit(runs, stamps, determined, period):
        return None
    whole = np.rint(stamps * FINER_PICTURES).astype(int) + change
    return Picks({int(frames[k + 1]): int(whole[k]) for k in np.flatnonzero(change)})


def _late(runs: Sequence[Run], durations: Array, stamps: Array, period: float) -> NDArray[np.int64]:
    """By how many parts each frame (n + 1,) is late, by all steps (n,) at once; at most one less than a period has.

    The least sum of the squared misfits of steps to the speeds around them, by dynamic programming. A step that no
    duration explains shows none.
    """
    parts = FINER_PICTURES
    cost = np.zeros((len(stamps), parts, parts))  # of a frame late by so many parts after one late by so many
    later = np.arange(parts)[None, :] - np.arange(parts)[:, None]
    for run in runs:
        speed = _speeds(run, durations, period, 0.0)
        for at, length, v in zip(run.at, run.length, speed, strict=True):
            if np.isfinite(v):
                lasts = stamps[at] + later / parts
                off = np.where(lasts > 0, np.abs(length - v * lasts), np.inf)
                cost[at] += np.minimum(off, MAX_OFF_PARTS * v / parts) ** 2 / run.sd**2
    total, before = np.zeros(parts), np.zeros((len(stamps), parts), np.int64)
    for k in range(len(stamps)):
        paths = total[:, None] + cost[k] + CHANGE_COST * np.abs(later)
        before[k], total = paths.argmin(axis=0), paths.min(axis=0)
    found = np.empty(len(stamps) + 1, np.int64)
    found[-1] = total.argmin()
    for k in range(len(stamps) - 1, -1, -1):
        found[k] = before[k, found[k + 1]]
    return found


def _durations(runs: Sequence[Run], stamps: Array, period: float) -> tuple[Array, NDArray[np.bool_]]:
    """Durations of steps (n,) in periods, and which of them the balls show (n,).

    None where too few are whole numbers of parts on which the balls agree.
    """
    durations = stamps.copy()
    determined = np.zeros(len(stamps), bool)
    for uneven in ROUND_SDS:
        weight, total = np.zeros(len(stamps)), np.zeros(len(stamps))
        each = [(run, _speeds(run, durations, period, uneven)) for run in runs]
        for run, speed in each:
            known = np.isfinite(speed)
            of = (speed[known] / run.sd) ** 2
            np.add.at(weight, run.at[known], of)
            np.add.at(total, run.at[known], of * run.length[known] / speed[known])
        sure = weight * (MAX_SD_PARTS / FINER_PICTURES) ** 2 > 1
        seen = total / np.maximum(weight, 1e-12)
        whole = np.maximum(np.rint(seen * FINER_PICTURES), 1) / FINER_PICTURES
        agree = np.abs(seen - whole) * FINER_PICTURES < MAX_OFF_PARTS
        for run, speed in each:
            known = np.isfinite(speed)
            k = run.at[known]
            off = np.abs(run.length[known] - speed[known] * whole[k])
            agree[k[off > 2 * MAX_OFF_PARTS * speed[known] / FINER_PICTURES]] = False
        determined = sure & agree
        durations = np.where(determined, whole, np.where(sure, np.maximum(seen, 0.5 / FINER_PICTURES), stamps))
    if determined.sum() < MIN_KNOWN_FRACTION * sure.sum():
        determined[:] = False
    return np.where(determined, durations, stamps), determined


def step_misfit(runs: Sequence[Run], durations: Array, determined: NDArray[np.bool_], period: float) -> float:
    """Mean of what steps whose duration is known differ from the speeds around them [sd]; infinite where none is.

    Args:
        runs: of all balls.
        durations: of all steps (n,) [periods].
        determined: of which they are known (n,).
        period: of the stamps [s].
    """
    off = []
    for run in runs:
        speed = _speeds(run, durations, period, 0.0)
        use = np.isfinite(speed) & determined[run.at]
        off.append((run.length[use] - speed[use] * durations[run.at[use]]) / run.sd)
    values = np.concatenate(off) if off else np.zeros(0)
    return float(np.mean(np.abs(values))) if values.size else np.inf


def free_runs(tracks: Sequence[BallTrack], frames: NDArray[np.int64], sigma: float) -> list[Run]:
    """Steps between frames (m,) of all balls, in rows without an impact."""
    return [run for track in tracks for run in _runs(track, frames, sigma)]


def _runs(track: BallTrack, frames: NDArray[np.int64], sigma: float) -> list[Run]:
    """Steps of a ball in a row without an impact, with the scatter that it has across its way."""
    at = np.searchsorted(frames, track.frame)
    step = np.diff(track.xy, axis=0)
    length = np.linalg.norm(step, axis=1)
    moving = (np.diff(at) == 1) & (length > MIN_STEP_M)
    if not moving.any():
        return []
    turn = np.zeros(len(step))  # between a step and the one before, across the way [m]
    cross = step[:-1, 0] * step[1:, 1] - step[:-1, 1] * step[1:, 0]
    mean = np.maximum((length[:-1] + length[1:]) / 2, 1e-12)
    turn[1:] = cross / mean
    both = moving[1:] & moving[:-1]
    # Of the second difference of places with an error sd each, across the way, the sd is sqrt(6) sd.
    scatter = float(np.median(np.abs(turn[1:][both]))) / 0.6745 / np.sqrt(6) if both.any() else sigma
    sd = max(scatter, MIN_SD_M)
    bends = np.abs(turn) > np.maximum(MAX_TURN_SINE * length, 4 * np.sqrt(6) * sd)
    found, first = [], 0
    moving &= length > MIN_STEP_SD * np.sqrt(2) * sd
    for k in range(len(step) + 1):
        if k == len(step) or not moving[k] or bends[k]:
            # The first step and the last may hold an impact.
            for part in _even_parts(length, first + 1, k - 1):
                found.append(Run(at[part].astype(np.int64), length[part], float(np.sqrt(2) * sd)))
            first = k if k < len(step) and moving[k] else k + 1
    return found


def _even_parts(length: Array, first: int, stop: int) -> list[slice]:
    """Parts of a row of steps (n,) between which the speed changes at once, as in a full impact on the way."""
    if stop - first < MIN_WINDOW:
        return []
    best, at = MAX_SPEED_RATIO, -1
    for k in range(first + IMPACT_STEPS, stop - IMPACT_STEPS + 1):
        before, after = length[k - IMPACT_STEPS : k].mean(), length[k : k + IMPACT_STEPS].mean()
        if (ratio := max(before, after) / min(before, after)) > best:
            best, at = ratio, k
    if at < 0:
        return [slice(first, stop)]
    return [*_even_parts(length, first, at - 1), *_even_parts(length, at + 1, stop)]


def _speeds(run: Run, durations: Array, period: float, uneven: float) -> Array:
    """Speeds (n,) at the steps of a run, from the steps around each and not itself [m a period]; NaN if few.

    Args:
        run: of n steps.
        durations: of all steps [periods].
        period: of the stamps [s].
        uneven: standard deviation of a duration [periods].
    """
    lasts = durations[run.at]
    middle = np.cumsum(lasts) - lasts / 2
    speed = np.full(len(run.at), np.nan)
    error = np.hypot(run.sd, uneven * np.median(run.length))
    prior = np.array([0.0, (error / (ACCELERATION_SD_M_S2 * period**2)) ** 2])
    for k in range(len(run.at)):
        near = slice(max(k - SPEED_STEPS, 0), k + SPEED_STEPS + 1)
        use = np.arange(*near.indices(len(run.at))) != k
        if use.sum() >= MIN_WINDOW:
            d, s, t = lasts[near][use], run.length[near][use], middle[near][use] - middle[k]
            basis = np.column_stack([d, d * t])
            speed[k] = np.linalg.solve(basis.T @ basis + np.diag(prior), basis.T @ s)[0]
    return np.where(speed > 0, speed, np.nan)
