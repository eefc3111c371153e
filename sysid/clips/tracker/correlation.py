"""Integrated autocorrelation time: how many correlated samples count as one independent sample.

In: the autocorrelation by lag. Out: samples.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray


def integrated_time(correlation: NDArray[np.float64], least: float) -> float:
    """Integrated autocorrelation time, 1 + 2 sum of the autocorrelation [samples]; at least 1.

    Args:
        correlation: (n,) of lags 0, 1, ..., 1 at lag 0.
        least: correlation at which the sum stops; that of later lags is chance.
    """
    below = np.flatnonzero(correlation < least)
    stop = int(below[0]) if below.size else len(correlation)
    return float(max(1.0, 1.0 + 2.0 * correlation[1:stop].sum()))
