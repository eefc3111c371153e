"""What is known of how a ball turned: the angle about the vertical, its rate, and which angles are fit for a fit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from sysid.vision.camera.projection import Array

FIRST, LEAST = 0.25, 8  # stretch from which a shot's sidespin is told [s], and its frames at least


@dataclass(frozen=True)
class Turning:
    """How a ball turned. Values are NaN where its marks did not tell."""

    time: Array  # (n,) [s]
    theta: Array  # (n,) turned angle about the vertical, the integral of omega_z, unwrapped [rad]
    sd: Array  # (n,) of each angle [rad]
    drift: Array  # (n,) how far the angle may have gone astray since the first that is told: one sd [rad]
    spin: Array  # (n, 3) mean angular velocity since the frame before, table frame [rad/s]
    spin_sd: Array  # (n, 3) [rad/s]
    quaternion: Array  # (n, 4) w, x, y, z: turned since the first frame that is told
    told: tuple[str, ...] = ()  # what a user should know

    @property
    def steady(self) -> Array:
        """The angle where a fit may have it, else NaN: (n,) [rad].

        A fit takes the errors of angles for independent; those of a rolling ball add up, all one way. So it has them
        for as long as what adds up is no more than noise, and none if that is less than half of them.
        """
        known = np.isfinite(self.theta)
        good = known & (self.drift <= self.sd)
        return np.where(good & (2 * good.sum() >= known.sum()), self.theta, np.nan)

    @property
    def sidespin(self) -> Rate | None:
        """About the vertical, over the first FIRST seconds in which the angle is known; None where they are too few."""
        known = self.time[np.isfinite(self.theta)]
        if len(known) == 0 or (known <= known[0] + FIRST).sum() < LEAST:
            return None
        return rate(self, float(known[0]), float(known[0]) + FIRST)


@dataclass(frozen=True)
class Rate:
    """A spin about the vertical, and how it changes."""

    start: float  # of the frames it comes from [s]
    end: float  # and their end [s]
    spin: float  # omega_z in the middle [rad/s]
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
        raise BadInput(f"from {start:g} to {end:g} s the turned angle is known in {count} frames: choose a longer time")
    time, theta, sd = turned.time[use], turned.theta[use], turned.sd[use]
    middle = 0.5 * float(time[0] + time[-1])
    basis = np.vander(time - middle, 3, increasing=True) * np.array([1.0, 1.0, 0.5])
    weighted = basis / sd[:, None]
    value, *_ = np.linalg.lstsq(weighted, theta / sd, rcond=None)
    rest = (theta - basis @ value) / sd
    # Errors that hang together from frame to frame average out more slowly.
    alike = float(np.clip(rest[1:] @ rest[:-1] / max(rest @ rest, 1e-12), 0.0, 0.9))
    scatter = max(float(rest @ rest) / (count - 3), 1.0) * (1 + alike) / (1 - alike)
    inverse = np.linalg.inv(weighted.T @ weighted)
    strays = inverse @ weighted.T @ (turned.drift[use] / sd)
    spread = np.sqrt(np.diag(inverse) * scatter + strays**2)
    ends = float(time[0]), float(time[-1])
    return Rate(*ends, float(value[1]), float(spread[1]), float(value[2]), float(spread[2]), count)
