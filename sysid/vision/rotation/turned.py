"""The measured rotation of a ball: its angle about the vertical, its sidespin, and which angles a fit may use.

In: angles, their standard deviations and their drift (spin.py). Out: `Turning`, and `Rate`, the sidespin in an
interval.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from sysid.vision.camera.projection import Array

SIDESPIN_WINDOW_S = 0.25  # from the first known angle, from which the sidespin of a shot is estimated
MIN_SIDESPIN_FRAMES = 8  # in that window


@dataclass(frozen=True)
class Turning:
    """The rotation of a ball. Values are NaN where its marks do not determine them."""

    time: Array  # (n,) [s]
    theta: Array  # (n,) turned angle about the vertical, the integral of omega_z, unwrapped [rad]
    sd: Array  # (n,) of each angle [rad]
    drift: Array  # (n,) standard deviation accumulated since the first known angle [rad]
    spin: Array  # (n, 3) mean angular velocity since the previous frame, table frame [rad/s]
    spin_sd: Array  # (n, 3) [rad/s]
    quaternion: Array  # (n, 4) w, x, y, z: rotation since the first frame with a known orientation
    notes: tuple[str, ...] = ()  # for the user

    @property
    def steady(self) -> Array:
        """The angle where a fit may use it, else NaN: (n,) [rad].

        A fit assumes independent errors; those of a rolling ball accumulate. So angles are used as long as the drift
        does not exceed the standard deviation, and none if these are less than half of all.
        """
        known = np.isfinite(self.theta)
        good = known & (self.drift <= self.sd)
        return np.where(good & (2 * good.sum() >= known.sum()), self.theta, np.nan)

    @property
    def sidespin(self) -> Rate | None:
        """Spin about the vertical in the first SIDESPIN_WINDOW_S of known angles; None where they are too few."""
        known = self.time[np.isfinite(self.theta)]
        if len(known) == 0 or (known <= known[0] + SIDESPIN_WINDOW_S).sum() < MIN_SIDESPIN_FRAMES:
            return None
        return rate(self, float(known[0]), float(known[0]) + SIDESPIN_WINDOW_S)


@dataclass(frozen=True)
class Rate:
    """Spin about the vertical, and its change."""

    start: float  # of the interval [s]
    end: float  # of the interval [s]
    spin: float  # omega_z in its middle [rad/s]
    spin_sd: float
    change: float  # [rad/s^2], below 0 where a positive spin slows down
    change_sd: float
    count: int  # frames

    @property
    def time(self) -> float:
        """The middle [s]."""
        return 0.5 * (self.start + self.end)


def rate(turned: Turning, start: float, end: float) -> Rate:
    """Spin about the vertical between two times [s], fitted with a constant deceleration."""
    use = (turned.time >= start) & (turned.time <= end) & np.isfinite(turned.theta)
    count = int(use.sum())
    if count < 4:
        raise BadInput(
            f"from {start:g} to {end:g} s the rotation angle is known in {count} frames only: choose a longer interval"
        )
    time, theta, sd = turned.time[use], turned.theta[use], turned.sd[use]
    middle = 0.5 * float(time[0] + time[-1])
    basis = np.vander(time - middle, 3, increasing=True) * np.array([1.0, 1.0, 0.5])
    weighted = basis / sd[:, None]
    value, *_ = np.linalg.lstsq(weighted, theta / sd, rcond=None)
    residual = (theta - basis @ value) / sd
    # Autocorrelated errors average out more slowly: first-order autoregressive factor (1 + r) / (1 - r).
    correlation = float(np.clip(residual[1:] @ residual[:-1] / max(residual @ residual, 1e-12), 0.0, 0.9))
    scatter = max(float(residual @ residual) / (count - 3), 1.0) * (1 + correlation) / (1 - correlation)
    inverse = np.linalg.inv(weighted.T @ weighted)
    drifts = inverse @ weighted.T @ (turned.drift[use] / sd)
    spread = np.sqrt(np.diag(inverse) * scatter + drifts**2)
    ends = float(time[0]), float(time[-1])
    return Rate(*ends, float(value[1]), float(spread[1]), float(value[2]), float(spread[2]), count)
