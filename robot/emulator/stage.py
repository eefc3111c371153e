"""The emulated stage that places the tip: two axes with drive and backlash, and the duration of moves.

In: targets and times. Out: positions of motors and tip. The tip lags behind the motor after a reversal: with a backlash
b, x_tip = clip(x_tip, x_motor, x_motor + b), without lag after an approach from below. Grades as in mechanism.py.
"""

from __future__ import annotations

import math

STEP_UM = 10  # 200 steps a turn, 2 mm of lead, C
RANGE_UM = 25_000  # each way: 2 in of travel (AEROTECH ATS302, from memory), C
SPEED, ACCELERATION = 0.010, 0.050  # [m/s], [m/s^2]; C
BACKLASH_UM = (150.0, 250.0)  # of x and y; screws of that class 0.1 to 0.3 mm, C

Place = tuple[float, float]  # [micrometre]


class EmulatedStage:
    """The stage's position and target [micrometre]."""

    def __init__(self, backlash: Place = BACKLASH_UM) -> None:
        """Start at home, approached from below."""
        self._backlash = backlash
        self.motor: Place = (0.0, 0.0)
        self.tip: Place = (0.0, 0.0)
        self._journey: tuple[float, Place, Place, float] = (0.0, self.motor, self.motor, 0.0)  # start, from, to, time

    def travel(self, target: Place, start: float) -> float:
        """Start a move of both axes together; returns its duration [s]."""
        distance = 1e-6 * max(abs(t - m) for t, m in zip(target, self.motor, strict=True))
        full = SPEED**2 / ACCELERATION
        needs = distance / SPEED + SPEED / ACCELERATION
        needs = needs if distance > full else 2 * math.sqrt(distance / ACCELERATION)
        self._journey = (start, self.motor, target, needs)
        return needs

    def under_way(self, now: float) -> Place:
        """Positions of the motors during the move, approximated by constant speed."""
        start, _, _, needs = self._journey
        return self._along(min(max((now - start) / needs, 0.0), 1.0) if needs > 0 else 1.0)

    def halt(self, now: float) -> None:
        """Stop at the current position."""
        self._put(self.under_way(now))

    def stall(self, part: float) -> None:
        """Stop after a part of the move."""
        self._put(self._along(part))

    def arrive(self, *, home: bool) -> None:
        """Stop at the target; homing ends with an upward move off the switches."""
        self._put(self._journey[2])
        if home:
            self.tip = (0.0, 0.0)

    def _along(self, part: float) -> Place:
        _, origin, target, _ = self._journey
        x, y = (m + part * (t - m) for m, t in zip(origin, target, strict=True))
        return x, y

    def _put(self, motor: Place) -> None:
        self.motor = motor
        x, y = (min(max(t, m), m + b) for t, m, b in zip(self.tip, motor, self._backlash, strict=True))
        self.tip = x, y
