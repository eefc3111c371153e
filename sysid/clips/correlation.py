"""Integrated autocorrelation time: how many correlated samples count as one independent sample.

In: the autocorrelation by lag. Out: samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def integrated_time(correlation: NDArray[np.float64], least: float) -> float:
    """1 + 2 sum of the autocorrelation [samples], and 1 where that is negative.

    Args:
        correlation: (n,) of lags 0, 1, ..., 1 at lag 0.
        least: the sum ends before the first lag that correlates less: the later ones are chance.
    """
    below = np.flatnonzero(correlation < least)
    stop = int(below[0]) if below.size else len(correlation)
    return float(max(1.0, 1.0 + 2.0 * correlation[1:stop].sum()))
