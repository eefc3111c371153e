"""The motion of the cue in a stroke: raised-cosine run-up, constant speed, braking.

In: start time and commanded speed v. Out: distance and speed at a time, and the time at a distance. With the run-up
time T the speed is v (1 - cos(pi t / T)) / 2, T = min(2 RUN_UP_M / v, v / MIN_ACCELERATION).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.mjcf.stroke import MIN_ACCELERATION, RUN_UP_M
from robot.device.protocol import FIRST_STRING, LAST_STRING

BALL_DISTANCE_M = 0.190  # from the retracted tip to the ball [m]; inside the level stroke, C
LEVEL_END_M = RUN_UP_M + 0.070  # where braking begins [m]; C


def paper_law(string: int) -> float:
    """Cue speed of a string [m/s]: the line through '001p' 2.75 and '200p' 0.30 (Robotic Billiards 2015)."""
    return 2.75 - (2.75 - 0.30) / (LAST_STRING - FIRST_STRING) * (string - FIRST_STRING)


@dataclass(frozen=True)
class StrokeMotion:
    """A stroke in progress."""

    start: float  # [s]
    speed: float  # commanded [m/s]
    string: int

    @property
    def ramp(self) -> float:
        """Duration of the run-up [s]."""
        return min(2 * RUN_UP_M / self.speed, self.speed / MIN_ACCELERATION)

    def at(self, distance: float) -> float:
        """Clock time [s] at which the tip has covered a distance [m] beyond the run-up."""
        return self.start + self.ramp + (distance - 0.5 * self.speed * self.ramp) / self.speed

    def state(self, now: float) -> tuple[float, float]:
        """Distance [m] and speed [m/s] before braking."""
        t, ramp, v = now - self.start, self.ramp, self.speed
        if t >= ramp:
            return v * (t - 0.5 * ramp), v
        turn = math.pi * t / ramp
        return 0.5 * v * (t - ramp / math.pi * math.sin(turn)), v * (0.5 - 0.5 * math.cos(turn))
