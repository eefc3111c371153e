"""Accelerations that a model lacks, by linear regression on the residuals of segments.

In: residuals of samples with the number of their phase. Out: `Phases`: averaged residuals, and the regressors that
accelerations leave in them.

A segment is the motion of one ball between two events, a phase the part of it in which it slides, or rolls. An
acceleration f(t) that the model lacks displaces the ball in a phase by its double integral, minus a straight line (the
position and velocity at the beginning of the phase are fitted and carry no information):

    measured - modelled = c S + noise,    S = Q (double integral of f),    c = S.r / S.S,

where Q projects out the line. With f = a direction inside a group of samples and 0 outside, c is the mean acceleration
that is missing there [m/s^2]. Phases are used as a whole: the information on an acceleration grows as T^2 sqrt(n), so
short windows would waste most of it.

Left out: that the spin of a segment is fitted, too, which in a sliding phase turns the friction and absorbs part of an
acceleration across the path. Positions of neighbouring frames are averaged in blocks, which costs no information at
these frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK_SAMPLES = 6  # number of samples averaged in a block
MIN_PHASE_SAMPLES = 12


@dataclass(frozen=True)
class Phases:
    """Residuals of all phases, averaged in blocks, in units of their noise and without a straight line."""

    phase: Index  # (m,) number of a block's phase, from 0, without gaps
    clip: Index  # (m,)
    time: Array  # (m,) [s]
    weight: Array  # (m,) one over the standard deviation of a block's position [1/m]
    residual: Array  # (m, d) weighted, measured minus modelled
    first: Index  # (k,) each phase's first block
    sample: Index  # (n,) samples that are used, in order
    block: Index  # (n,) their blocks

    def mean(self, values: Array) -> Array:
        """Averages of samples' values (N, ...) over each block: (m, ...)."""
        used = values[self.sample]
        flat = used.reshape(len(used), -1)
        count = np.bincount(self.block, minlength=len(self.time))[:, None]
        first = np.searchsorted(self.block, np.arange(len(self.time)))
        total = np.add.reduceat(flat, first, axis=0) if len(flat) else flat
        return np.asarray((total / np.maximum(count, 1)).reshape(len(self.time), *values.shape[1:]))

    def response(self, acceleration: Array) -> Array:
        """Weighted displacements under accelerations (m, k) of the blocks, without a straight line: (m, k)."""
        step = np.diff(self.time, prepend=self.time[:1])[:, None]
        step[self.first] = 0.0
        shape = np.asarray(acceleration, dtype=float)
        for _ in range(2):
            before = np.roll(shape, 1, axis=0)
            total = np.cumsum(0.5 * step * (shape + before), axis=0)
            shape = total - total[self.first][self.phase]
        return _without_line(shape, self.time, self.weight, self.phase, self.first)


def _without_line(values: Array, time: Array, weight: Array, phase: Index, first: Index) -> Array:
    """Weighted values (m, k) without each phase's weighted mean and slope."""
    square = (weight**2)[:, None]
    total = np.add.reduceat(square, first, axis=0)

    def centred(values: Array) -> Array:
        return np.asarray(values - (np.add.reduceat(square * values, first, axis=0) / total)[phase])

    u, value = centred(time[:, None]), centred(values)
    power = np.add.reduceat(square * u**2, first, axis=0)
    slope = np.add.reduceat(square * u * value, first, axis=0) / np.where(power > 0, power, 1.0)
    return np.asarray(weight[:, None] * (value - slope[phase] * u))


def phases_of(label: Index, clip: Index, time: Array, residual: Array, sigma: float) -> Phases | None:
    """Cut samples into phases; None if none is long enough.

    Args:
        label: (n,) number of a sample's phase, -1 of none; samples of a phase are consecutive and in time order.
        clip: (n,)
        time: (n,) [s]
        residual: (n, d) measured minus modelled [m], or [rad].
        sigma: its noise.
    """
    edge = np.flatnonzero(np.diff(label, prepend=np.iinfo(np.int64).min))
    size = np.diff(np.append(edge, len(label)))
    good = (size >= MIN_PHASE_SAMPLES) & (label[edge] >= 0) if len(label) else np.zeros(0, dtype=bool)
    if not good.any():
        return None
    edge, size = edge[good], size[good]
    sample = np.concatenate([np.arange(e, e + s) for e, s in zip(edge, size, strict=True)])
    within = np.concatenate([np.arange(s) for s in size])
    number = np.repeat(np.arange(len(size)), size)
    start = within % BLOCK_SAMPLES == 0
    block = np.cumsum(start) - 1
    head = np.flatnonzero(start)
    count = np.diff(np.append(head, len(sample)))
    mean = np.add.reduceat(np.column_stack([time[sample], residual[sample]]), head, axis=0) / count[:, None]
    phase = number[head]
    first = np.searchsorted(phase, np.arange(len(size)))
    weight = np.sqrt(count) / sigma
    straight = _without_line(mean[:, 1:], mean[:, 0], weight, phase, first)
    return Phases(phase, clip[sample][head], mean[:, 0], weight, straight, first, sample, block)
