"""What there is to film: balls that move and turn, and the cue that strikes one of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from models.shot import Track

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Cue:
    """A cue that comes on in a straight line at a constant speed, and stops where it has struck."""

    struck: float  # when its tip reaches the ball [s]
    contact: tuple[float, float, float]  # where, table frame [m]
    azimuth: float  # of its direction of travel [rad]
    speed: float  # [m/s]
    elevation: float = 0.0  # of its butt [rad]
    length: float = 1.45  # [m]
    tip: float = 0.0095  # diameter at the tip [m]
    butt: float = 0.029  # and at the butt [m]
    follow: float = 0.06  # way past the contact [m]

    @property
    def direction(self) -> Array:
        """Unit vector of travel: (3,)."""
        c = np.cos(self.elevation)
        return np.array([c * np.cos(self.azimuth), c * np.sin(self.azimuth), -np.sin(self.elevation)])

    def tip_at(self, time: float) -> Array:
        """Where the tip is: (3,) [m]."""
        way = min(self.speed * (time - self.struck), self.follow)
        return np.array(self.contact) + way * self.direction


@dataclass(frozen=True)
class Motion:
    """Balls over time, closely sampled."""

    names: tuple[str, ...]
    times: Array  # (m,) [s], increasing
    position: Array  # (m, n, 2) [m]; NaN once potted
    turned: Array  # (m, n, 4) orientation as a quaternion x, y, z, w that takes the ball's axes to the table's
    cue: Cue | None = None

    def at(self, time: float) -> tuple[Array, Array]:
        """Places (n, 2) [m] and orientations (n, 3, 3) at a time; before the first they are those of the first."""
        time = float(np.clip(time, self.times[0], self.times[-1]))
        k = int(np.clip(np.searchsorted(self.times, time) - 1, 0, len(self.times) - 2))
        part = (time - self.times[k]) / (self.times[k + 1] - self.times[k])
        place = self.position[k] + part * (self.position[k + 1] - self.position[k])
        one, two = self.turned[k], self.turned[k + 1]
        two = np.where(np.sum(one * two, axis=-1, keepdims=True) < 0, -two, two)
        return place, Rotation.from_quat(one + part * (two - one)).as_matrix().reshape(-1, 3, 3)


def motion_of(track: Track, start: Rotation | None = None, cue: Cue | None = None) -> Motion:
    """A track, best sampled every millisecond, with the balls' orientations integrated from their spin.

    Args:
        track: of simulated balls.
        start: orientation of every ball at the first sample; the table's axes if not given.
        cue: that struck.
    """
    n = len(track.names)
    turned = np.empty((len(track.times), n, 4))
    now = start if start is not None else Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)))
    turned[0] = now.as_quat()
    spin = np.nan_to_num(track.spin)
    for k, dt in enumerate(np.diff(track.times)):
        now = Rotation.from_rotvec(0.5 * dt * (spin[k] + spin[k + 1])) * now
        turned[k + 1] = now.as_quat()
    return Motion(track.names, track.times, track.position, turned, cue)
