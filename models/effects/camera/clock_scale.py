"""A camera's clock that runs at another rate than it says, or whose frame rate is not the nominal one.

Time stamps are `factor` times the true times: exposures = stamps / factor. All speeds then look too small by the
factor and all decelerations by its square. Source: arithmetic; frame rates are known to 0.01 to 0.5 %. Constant
friction and sidespin decay are confounded with it exactly, as no film identifies them without a clock. What separates
them: the cue's commanded speeds, effects whose size a speed sets, and, where the frame rate is trusted, the spacing of
the stamps against it. Leaves out jitter and dropped frames.
"""

from __future__ import annotations

from dataclasses import dataclass

from models.effect import Effect, param


@dataclass(frozen=True)
class ClockScale(Effect):
    """Time reported over time passed."""

    factor: float = param(
        1.01, off=1.0, unit="1", bounds=(0.9, 1.1), source="estimate: frame rates are off by 0.01 to 0.5 %"
    )

    def exposures(self, stamp: float) -> float:
        """The true time of a stamp."""
        return stamp / self.factor
