"""What real cameras and real users do to clips, all of it at once where a set is soiled.

Noise hangs together: beside the white noise a first-order process of standard deviation s, whose correlation falls
as exp(-dt / tau). A tracker loses a ball for a while, throws some samples elsewhere, and takes two balls for each other
for some frames where they are nearest. The clock begins anywhere; table and ball were measured a little wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tests.truth.cloth import Array


@dataclass(frozen=True)
class Soil:
    """How dirty; nothing by default."""

    hanging: float = 0.0  # noise that hangs together, one standard deviation per axis [m]
    memory: float = 0.0163  # its correlation time: 0.6 from sample to sample at 120 a second [s]
    gaps: float = 0.0  # of a ball's track, per second of film
    longest_gap: float = 0.2  # [s]
    swaps: float = 0.0  # fraction of the clips in which two balls are exchanged for some frames
    origin: tuple[float, float] = (0.0, 0.0)  # between which the clock begins [s]
    table: float = 0.0  # size told over size, less 1; of either sign
    ball: float = 0.0  # the same of the diameter


SOILED = Soil(hanging=0.0003, gaps=0.15, swaps=0.2, origin=(-10.0, 1000.0), table=0.003, ball=0.005)


def hanging(times: Array, shape: tuple[int, ...], soil: Soil, rng: np.random.Generator) -> Array:
    """Noise that hangs together, at these times, for an array that begins with their axis [m]."""
    noise = rng.normal(size=shape)
    for k in range(1, len(times)):
        kept = float(np.exp(-(times[k] - times[k - 1]) / soil.memory))
        noise[k] = kept * noise[k - 1] + np.sqrt(1.0 - kept * kept) * noise[k]
    return np.asarray(soil.hanging * noise)


def gaps(times: Array, balls: int, soil: Soil, rng: np.random.Generator) -> Array:
    """Which samples a tracker had: (n, nball), bool. The first of each is always there."""
    seen = np.ones((len(times), balls), bool)
    for b in range(balls):
        for _ in range(rng.poisson(soil.gaps * (times[-1] - times[0]))):
            start = rng.uniform(times[0], times[-1])
            seen[(times > start) & (times < start + rng.uniform(0.02, soil.longest_gap)), b] = False
    seen[0] = True
    return seen


def swapped(xy: Array, soil: Soil, rng: np.random.Generator) -> Array:
    """The positions with two balls exchanged for two to four frames where they are nearest: (n, nball, 2) [m]."""
    n, balls, _ = xy.shape
    if balls < 2 or rng.random() >= soil.swaps:
        return xy
    one, two = rng.choice(balls, 2, replace=False)
    gap = np.hypot(*(xy[:, one] - xy[:, two]).T)
    if not np.isfinite(gap[1:]).any():
        return xy
    at = 1 + int(np.nanargmin(gap[1:]))
    frames = slice(at, min(n, at + int(rng.integers(2, 5))))
    out = xy.copy()
    out[frames, one], out[frames, two] = xy[frames, two], xy[frames, one]
    return out


def measured_wrong(size: float, by: float, rng: np.random.Generator) -> float:
    """A length as it is told [m], to a tenth of a millimetre."""
    return round(size * (1.0 + by * float(rng.choice([-1.0, 1.0]))), 4)
