"""What acts on a ball beyond the model, locally: residual accelerations of free stretches, by linear regression.

A stretch is one ball between two events, a run the part of it in which it slides, or rolls. An acceleration f(t) that
the model leaves out bends a run by its double integral, less a straight line (where the run began, and how fast, is
fitted and tells nothing):

    measured - modelled = c S + noise,    S = Q (double integral of f),    c = S.r / S.S,

Q taking out the line. With f = a direction inside a group of samples and 0 outside, c is the mean acceleration missing
there [m/s^2]. Every run enters whole: an acceleration is told by T^2 sqrt(n), so short windows would throw most of it
away.

Left out: that a stretch's spin is fitted too, which in a sliding run turns the friction to and fro and takes up part
of what acts across. Positions of neighbouring frames are averaged in sixes, which costs nothing at these frequencies.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

BLOCK = 6  # samples averaged
LEAST = 12  # samples of a run


@dataclass(frozen=True)
class Runs:
    """Residuals of all runs, averaged in blocks, in units of their noise and without a straight line."""

    run: Index  # (m,) number of a block's run, from 0, without gaps
    clip: Index  # (m,)
    time: Array  # (m,) [s]
    weight: Array  # (m,) one over the standard deviation of a block's position [1/m]
    residual: Array  # (m, d) weighted, measured minus modelled
    first: Index  # (k,) each run's first block
    sample: Index  # (n,) samples that are used, in order
    block: Index  # (n,) their blocks

    def mean(self, values: Array) -> Array:
        """Samples' values (N, ...) averaged in each block: (m, ...)."""
        own = values[self.sample]
        flat = own.reshape(len(own), -1)
        count = np.bincount(self.block, minlength=len(self.time))[:, None]
        first = np.searchsorted(self.block, np.arange(len(self.time)))
        total = np.add.reduceat(flat, first, axis=0) if len(flat) else flat
        return np.asarray((total / np.maximum(count, 1)).reshape(len(self.time), *values.shape[1:]))

    def bent(self, push: Array) -> Array:
        """Weighted shape of the runs under accelerations (m, k) of the blocks, without a straight line: (m, k)."""
        step = np.diff(self.time, prepend=self.time[:1])[:, None]
        step[self.first] = 0.0
        shape = np.asarray(push, dtype=float)
        for _ in range(2):
            before = np.roll(shape, 1, axis=0)
            total = np.cumsum(0.5 * step * (shape + before), axis=0)
            shape = total - total[self.first][self.run]
        return self._straightened(shape)

    def _straightened(self, shape: Array) -> Array:
        """Weighted values without each run's weighted mean and slope."""
        return _without_line(shape, self.time, self.weight, self.run, self.first)


def _without_line(shape: Array, time: Array, weight: Array, run: Index, first: Index) -> Array:
    square = (weight**2)[:, None]
    total = np.add.reduceat(square, first, axis=0)

    def centred(values: Array) -> Array:
        return np.asarray(values - (np.add.reduceat(square * values, first, axis=0) / total)[run])

    u, value = centred(time[:, None]), centred(shape)
    power = np.add.reduceat(square * u**2, first, axis=0)
    tilt = np.add.reduceat(square * u * value, first, axis=0) / np.where(power > 0, power, 1.0)
    return np.asarray(weight[:, None] * (value - tilt[run] * u))


def runs_of(label: Index, clip: Index, time: Array, residual: Array, sigma: float) -> Runs | None:
    """Cut samples into runs: `label` (n,) is a run's, -1 for samples of none; `residual` (n, d) [m]; None without any.

    Samples of a run are consecutive and in time order.
    """
    edge = np.flatnonzero(np.diff(label, prepend=np.iinfo(np.int64).min))
    size = np.diff(np.append(edge, len(label)))
    good = (size >= LEAST) & (label[edge] >= 0) if len(label) else np.zeros(0, dtype=bool)
    if not good.any():
        return None
    edge, size = edge[good], size[good]
    sample = np.concatenate([np.arange(e, e + s) for e, s in zip(edge, size, strict=True)])
    within = np.concatenate([np.arange(s) for s in size])
    number = np.repeat(np.arange(len(size)), size)
    start = within % BLOCK == 0
    block = np.cumsum(start) - 1
    head = np.flatnonzero(start)
    count = np.diff(np.append(head, len(sample)))
    mean = np.add.reduceat(np.column_stack([time[sample], residual[sample]]), head, axis=0) / count[:, None]
    run = number[head]
    first = np.searchsorted(run, np.arange(len(size)))
    weight = np.sqrt(count) / sigma
    straight = _without_line(mean[:, 1:], mean[:, 0], weight, run, first)
    return Runs(run, clip[sample][head], mean[:, 0], weight, straight, first, sample, block)
