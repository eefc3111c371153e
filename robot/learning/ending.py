"""When a series has learnt what it can: the miss is down to the scatter of the launcher, or falls no more."""

from __future__ import annotations

import math

from robot.learning.history import History

MISS_LIMIT_RATIO = 1.3  # miss over the launcher's scatter below which no model reduces the miss much
MISS_FALL_RATIO = 0.9  # miss over that of the previous block below which the miss has fallen
MIN_BLOCKS = 3  # fewest blocks for the decision that nothing improves


def why_ended(history: History, every: int) -> str:
    """The reason why a series needs no more shots after a refit; "" if it does."""
    n, refits = len(history.shots), history.refits
    if n < MIN_BLOCKS * every or len(refits) < MIN_BLOCKS or refits[-1].verdict != refits[-2].verdict:
        return ""
    misses = [history.median_miss(n - (k + 1) * every + 1, n - k * every) for k in range(MIN_BLOCKS)]
    predicted = history.median_spread(n - every + 1, n)
    figures = f"the cue ball's miss is {1e3 * misses[0]:.0f} mm (median of {every}), predicted {1e3 * predicted:.0f} mm"
    scatter = history.floor(n - every + 1, n)  # the floor for any model; if it was not measured, the plans' prediction
    figures += f", and the launcher alone scatters {1e3 * scatter:.0f} mm" if math.isfinite(scatter) else ""
    least = scatter if math.isfinite(scatter) else predicted
    if misses[0] <= MISS_LIMIT_RATIO * least and misses[0] >= MISS_FALL_RATIO * misses[1]:
        return f"{figures}: nothing is left to learn"
    if misses[0] >= MISS_FALL_RATIO * misses[1] and misses[1] >= MISS_FALL_RATIO * misses[2]:
        return f"{figures}; it has not fallen in two refits"
    return ""
