"""Where balls are predicted to be in the next frame: a Kalman filter of constant velocity, and impacts on the way.

In: the states of all balls at one time. Out: their states at a later time, with covariances. Impacts are between balls
of equal mass without friction, and with cushions. The cloth's forces are process noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from sysid.vision.camera.projection import Array

ACCELERATION_SD_M_S2 = 3.0  # process noise: acceleration that the cloth may cause [m/s^2]
IMPACT_VELOCITY_ERROR = 0.4  # standard deviation of a velocity after an impact, relative to the speed of the impact
PREDICTED_RESTITUTION = {"ball": 0.95, "cushion": 0.8}
MAX_IMPACTS = 6  # between two frames
MAX_POSITION_COST = 12.0  # of a detection compatible with a prediction: five standard deviations
MIN_MOVING_SPEED_M_S = 0.02  # slower balls are predicted at rest
TOUCH_RADII = 2.2  # between balls that may touch: two radii, and what is uncertain about them


class State(NamedTuple):
    """Position [m] and velocity [m/s] of a ball at a time [s], with their covariance, the same along both axes."""

    time: float
    x: float
    y: float
    u: float
    v: float
    pp: float  # variance of the position [m^2]
    pv: float  # covariance of position and velocity [m^2/s]
    vv: float  # variance of the velocity [m^2/s^2]

    @property
    def speed(self) -> float:
        """Speed [m/s]."""
        return math.hypot(self.u, self.v)

    @property
    def backwards(self) -> State:
        """The state in a time that runs backwards."""
        return self._replace(time=-self.time, u=-self.u, v=-self.v, pv=-self.pv)

    def predicted(self, time: float, time_sd: float = 0.0) -> State:
        """The state at a later time, without impacts (prediction step of the Kalman filter).

        The acceleration is white noise: were it constant over a frame, exact detections would make the velocity of an
        evenly moving ball swing about the true one for ever. `time_sd` is the standard deviation of the time [s].
        """
        dt = time - self.time
        noise = (ACCELERATION_SD_M_S2 * dt) ** 2
        pp = self.pp + 2 * dt * self.pv + dt * dt * (self.vv + noise / 3)
        pp += time_sd**2 * (self.u * self.u + self.v * self.v)
        pv = self.pv + dt * (self.vv + noise / 2)
        return State(time, self.x + self.u * dt, self.y + self.v * dt, self.u, self.v, pp, pv, self.vv + noise)

    def updated(self, x: float, y: float, variance: float) -> State:
        """The state after a detection (update step of the Kalman filter)."""
        gain, velocity_gain = self.pp / (self.pp + variance), self.pv / (self.pp + variance)
        dx, dy = x - self.x, y - self.y
        return State(
            self.time, self.x + gain * dx, self.y + gain * dy, self.u + velocity_gain * dx, self.v + velocity_gain * dy,
            (1 - gain) * self.pp, (1 - gain) * self.pv, self.vv - velocity_gain * self.pv,
        )  # fmt: skip

    def cost(self, x: float, y: float, variance: float) -> float:
        """Negative log likelihood of a detection, relative to an exact prediction; infinite where incompatible."""
        total = self.pp + variance
        position_cost = ((x - self.x) ** 2 + (y - self.y) ** 2) / (2 * total)
        return position_cost + math.log(total / variance) if position_cost < MAX_POSITION_COST else math.inf


def predict_impacts(states: Sequence[State], until: float, limits: Array, diameter: float) -> list[State | None]:
    """States at a time [s] of the balls that have an impact before it; None for the others.

    `states` are those of all balls at one time; their centres stay within |x|, |y| <= `limits` (2,) [m].
    """
    n, remaining = len(states), until - (states[0].time if states else 0.0)
    position = [[s.x, s.y] for s in states]
    velocities = [[s.u, s.v] if s.speed > MIN_MOVING_SPEED_M_S else [0.0, 0.0] for s in states]
    impact_speed, after_first = [0.0] * n, [0.0] * n  # of a ball's hardest impact; time left after its first
    for _ in range(MAX_IMPACTS):
        delay, bodies = _next_impact(position, velocities, remaining, limits, diameter)
        for place, velocity in zip(position, velocities, strict=True):
            place[0] += velocity[0] * delay
            place[1] += velocity[1] * delay
        remaining -= delay
        if bodies is None:
            break
        i, j, axis = bodies
        if j < 0:
            speed = abs(velocities[i][axis])
            velocities[i][axis] *= -PREDICTED_RESTITUTION["cushion"]
        else:
            nx, ny = position[j][0] - position[i][0], position[j][1] - position[i][1]
            size, u, v = math.hypot(nx, ny), velocities[i][0] - velocities[j][0], velocities[i][1] - velocities[j][1]
            nx, ny, speed = nx / size, ny / size, math.hypot(u, v)
            push = 0.5 * (1 + PREDICTED_RESTITUTION["ball"]) * (u * nx + v * ny)
            velocities[i] = [velocities[i][0] - push * nx, velocities[i][1] - push * ny]
            velocities[j] = [velocities[j][0] + push * nx, velocities[j][1] + push * ny]
        for k in (i, j):
            if k >= 0:
                after_first[k], impact_speed[k] = max(after_first[k], remaining), max(impact_speed[k], speed)
    _through_contacts(states, impact_speed, after_first, diameter)
    found: list[State | None] = [None] * n
    for k, state in enumerate(states):
        if impact_speed[k]:
            free, velocity_error = state.predicted(until), IMPACT_VELOCITY_ERROR * impact_speed[k]
            pp = free.pp + (velocity_error * (after_first[k] + 0.1 * (until - state.time))) ** 2
            (x, y), (u, v) = position[k], velocities[k]
            found[k] = State(until, x, y, u, v, pp, 0.0, free.vv + velocity_error**2)
    return found


def _through_contacts(
    states: Sequence[State], impact_speed: list[float], after_first: list[float], diameter: float
) -> None:  # fmt: skip
    """Impacts go on through balls that touch at the beginning, as in a rack: how hard, in what order is not known."""
    hit = [k for k, speed in enumerate(impact_speed) if speed]
    for i in hit:  # grows meanwhile
        for j, other in enumerate(states):
            apart = math.hypot(states[i].x - other.x, states[i].y - other.y)
            if j not in hit and apart < TOUCH_RADII * diameter / 2:
                impact_speed[j], after_first[j] = impact_speed[i], after_first[i]
                hit.append(j)


def _next_impact(
    position: list[list[float]], velocities: list[list[float]], limit: float, limits: Array, diameter: float
) -> tuple[float, tuple[int, int, int] | None]:
    """Time to the next impact, at most `limit` [s], and its balls (i, j, 0), or a ball and its axis (i, -1, axis)."""
    delay, bodies = limit, None
    for i, (place, velocity) in enumerate(zip(position, velocities, strict=True)):
        moving = velocity[0] != 0.0 or velocity[1] != 0.0
        for axis in (0, 1) if moving else ():
            if velocity[axis]:
                gap = float(limits[axis]) - math.copysign(place[axis], place[axis] * velocity[axis])
                time = max(gap, 0.0) / abs(velocity[axis])
                if time < delay:
                    delay, bodies = time, (i, -1, axis)
        for j in range(i + 1, len(position)):
            u, v = velocities[j][0] - velocity[0], velocities[j][1] - velocity[1]
            speed = u * u + v * v
            if speed == 0.0:
                continue
            x, y = position[j][0] - place[0], position[j][1] - place[1]
            closing = x * u + y * v
            gap = x * x + y * y - diameter * diameter
            inside = closing * closing - speed * gap
            if closing < 0 and inside > 0:
                time = max((-closing - math.sqrt(inside)) / speed, 0.0)
                if time < delay:
                    delay, bodies = time, (i, j, 0)
    return delay, bodies
