"""The phases of a ball's path, at rest or moving freely, as the most probable reading of its track.

In: a track, and the variance of its detections. Out: `Phase`s in order of time, and which detections are none of the
ball. Coulomb friction makes every phase of a ball on cloth, sliding or rolling, one of constant acceleration: a path is
a row of parabolas and points, with a knot wherever the ball is struck, hits something, begins to roll or stops. The
most probable row is found over the whole track (Viterbi), each of its phases judged by its marginal likelihood, which
a Kalman filter of the static state (place, velocity, acceleration) gives detection by detection. A detection that is
none of the ball costs what a place anywhere on the table does, and a jump, as in a cut film, likewise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled

if TYPE_CHECKING:
    from sysid.vision.camera.projection import Array
    from sysid.vision.tracks.following.follow import BallTrack

# Standard deviations of a phase before it is seen: players strike at up to 8 m/s, and sliding friction is 0.2 g.
SPEED_SD_M_S = 3.0
ACCELERATION_SD_M_S2 = 1.5
# Priors enter by their logarithms: how often things happen to a ball in a second matters in its order of magnitude.
STARTS_PER_S, KNOTS_PER_S, STOPS_PER_S, JUMPS_PER_S, SHIFTS_PER_S = 0.2, 2.0, 0.5, 1e-3, 1.0
SHIFT_RADII = (
    0.05  # by which a ball at rest is seen elsewhere, as in other light or another picture of a compressed film
)
# Seen to drift, a ball rests: one that rolls is slowed by 0.05 m/s^2 and more, and is no slower for longer.
DRIFT_M_S, DRIFT_S = 0.005, 0.1
STRAY_SHARE = 0.01  # of detections that are none of the ball
KEPT = 64  # readings of the track so far that are carried along, of each kind


@dataclass(frozen=True)
class Phase:
    """A part of a ball's path with one acceleration, or at rest."""

    first: int  # detection
    stop: int  # detection after the last
    rest: bool
    jumped: bool  # it begins elsewhere than the phase before it ends
    start: float  # time to which the state belongs [s]
    end: float  # time of its last detection [s]
    state: Array  # (3, 2) place [m], velocity [m/s] and half the acceleration [m/s^2]
    covariance: Array  # (3, 3) of the state, alike for both axes

    @property
    def still(self) -> bool:
        """Whether the ball rests, though light or a camera that moves may let it seem to drift."""
        speeds = [float(np.linalg.norm(self.velocity(t))) for t in (self.start, self.end)]
        return self.rest or (self.end - self.start >= DRIFT_S and max(speeds) < DRIFT_M_S)

    def place(self, time: float) -> Array:
        """Place at a time [s], extrapolated: (2,) [m]."""
        dt = time - self.start
        return np.asarray(self.state[0] + dt * (self.state[1] + dt * self.state[2]))

    def place_sd(self, time: float) -> float:
        """Standard deviation of the place at a time [s], per axis [m]."""
        dt = time - self.start
        way = np.array([1.0, dt, dt * dt])
        return math.sqrt(max(float(way @ self.covariance @ way), 0.0))

    def velocity(self, time: float) -> Array:
        """Velocity at a time [s]: (2,) [m/s]."""
        return np.asarray(self.state[1] + 2 * (time - self.start) * self.state[2])

    def velocity_sd(self, time: float) -> float:
        """Standard deviation of the velocity at a time [s], per axis [m/s]."""
        way = np.array([0.0, 1.0, 2 * (time - self.start)])
        return math.sqrt(max(float(way @ self.covariance @ way), 0.0))


def phases(track: BallTrack, sigma: float, radius: float, extent: float) -> tuple[tuple[Phase, ...], NDArray[np.bool_]]:
    """Phases of a track, and which of its detections (n,) are none of the ball.

    Args:
        track: of n detections.
        sigma: standard deviation of a detection, per axis [m].
        radius: of the ball [m].
        extent: of the table, root of its area [m].
    """
    n = len(track.time)
    stray = np.zeros(n, bool)
    if n == 0:
        return (), stray
    # A ball that is swept far is blurred: the detector says so.
    variance = sigma**2 + (radius * track.sd / np.maximum(track.radius, 1.0)) ** 2
    rates = np.array([STARTS_PER_S, KNOTS_PER_S, STOPS_PER_S, JUMPS_PER_S, SHIFTS_PER_S])
    time, xy = np.ascontiguousarray(track.time), np.ascontiguousarray(track.xy)
    sds = (SHIFT_RADII * radius, SPEED_SD_M_S, ACCELERATION_SD_M_S2)
    chain = _read(time, xy, variance, extent, rates, sds, STRAY_SHARE, KEPT)
    found = []
    for first, stop, rest, jumped, px, py, var in chain:
        state, covariance, off = _fitted(
            time[first:stop], xy[first:stop], variance[first:stop], rest, np.array([px, py]), var, extent,
            SPEED_SD_M_S, ACCELERATION_SD_M_S2, STRAY_SHARE,
        )  # fmt: skip
        stray[first:stop] = off
        found.append(Phase(first, stop, rest, jumped, float(time[first]), float(time[stop - 1]), state, covariance))
    return tuple(found), stray


@compiled
def _begun(kind, place, place_var, speed_var, acceleration_var):  # type: ignore[no-untyped-def]
    """State (3, 2) and covariance (3, 3) of a phase before it is seen."""
    state, covariance = np.zeros((3, 2)), np.zeros((3, 3))
    state[0] = place
    covariance[0, 0] = place_var
    if kind == 1:
        covariance[1, 1] = speed_var
        covariance[2, 2] = acceleration_var / 4
    return state, covariance


@compiled
def _seen(state, covariance, dt, x, y, variance, stray_cost):  # type: ignore[no-untyped-def]
    """Take a detection into the state, dt [s] after its time; its cost, and whether it is none of the ball."""
    g0 = covariance[0, 0] + dt * covariance[0, 1] + dt * dt * covariance[0, 2]
    g1 = covariance[1, 0] + dt * covariance[1, 1] + dt * dt * covariance[1, 2]
    g2 = covariance[2, 0] + dt * covariance[2, 1] + dt * dt * covariance[2, 2]
    total = variance + g0 + dt * g1 + dt * dt * g2
    ex = x - state[0, 0] - dt * (state[1, 0] + dt * state[2, 0])
    ey = y - state[0, 1] - dt * (state[1, 1] + dt * state[2, 1])
    cost = 0.5 * (ex * ex + ey * ey) / total + math.log(total / variance)
    if cost > stray_cost:
        return stray_cost, True
    g = (g0, g1, g2)
    for a in range(3):
        state[a, 0] += g[a] / total * ex
        state[a, 1] += g[a] / total * ey
        for b in range(3):
            covariance[a, b] -= g[a] * g[b] / total
    return cost, False


@compiled
def _fitted(time, xy, variance, rest, place, place_var, extent, speed_sd, acceleration_sd, stray_share):  # type: ignore[no-untyped-def]
    """State and covariance of one phase, and which of its detections are none of the ball."""
    state, covariance = _begun(0 if rest else 1, place, place_var, speed_sd**2, acceleration_sd**2)
    off = np.zeros(len(time), np.bool_)
    for k in range(len(time)):
        stray = math.log(extent**2 / (2 * math.pi * variance[k])) - math.log(stray_share)
        _, off[k] = _seen(state, covariance, time[k] - time[0], xy[k, 0], xy[k, 1], variance[k], stray)
    return state, covariance, off


class Readings(NamedTuple):
    """Readings of a track so far, each as the phase that it has come to."""

    since: NDArray[np.int64]  # detection that began it
    kind: NDArray[np.int64]  # 0 at rest, 1 moving
    jump: NDArray[np.bool_]
    cost: Array
    state: Array  # (..., 3, 2)
    covariance: Array  # (..., 3, 3)


@compiled
def _thin_out(readings, count, last, k, kept):  # type: ignore[no-untyped-def]
    """Keep the most probable readings of each kind, and those that have hardly been seen at detection k.

    Returns how many of the first `count` go on, and where the best one is then, which was number `last`.
    """
    since, kind, jump, cost, state, covariance = readings
    limit = np.full(2, np.inf)
    for which in range(2):
        costs = np.sort(cost[:count][kind[:count] == which])
        if len(costs) > kept:
            limit[which] = costs[kept - 1]
    to = 0
    for c in range(count):
        if cost[c] <= limit[kind[c]] or since[c] > k - 4:
            if to != c:
                since[to], kind[to], jump[to], cost[to] = since[c], kind[c], jump[c], cost[c]
                state[to], covariance[to] = state[c], covariance[c]
            if c == last:
                last = to
            to += 1
    return to, last


@compiled
def _traced_back(since, kind, jump, prior):  # type: ignore[no-untyped-def]
    """The phases that end with the last detection, of those that are best at each."""
    found = [(0, 0, False, False, 0.0, 0.0, 0.0)]
    found.pop()
    stop = len(since)
    while stop > 0:
        first, which, jumped = since[stop - 1], kind[stop - 1], jump[stop - 1]
        p = prior[first, which, 1 if jumped else 0]
        found.append((first, stop, which == 0, jumped and first > 0, p[0], p[1], p[2]))
        stop = first
    return found[::-1]


@compiled
def _read(time, xy, variance, extent, rates, sds, stray_share, kept):  # type: ignore[no-untyped-def]
    """The most probable phases: (first, stop, at rest, jumped, prior place x, y, its variance) of each."""
    n, most = len(time), 4 * kept + 8
    shift_sd, speed_sd, acceleration_sd = sds
    since, kind = np.zeros(most, np.int64), np.zeros(most, np.int64)
    jump, cost = np.zeros(most, np.bool_), np.zeros(most)
    state, covariance = np.zeros((most, 3, 2)), np.zeros((most, 3, 3))
    readings = Readings(since, kind, jump, cost, state, covariance)
    best_since, best_kind = np.zeros(n, np.int64), np.zeros(n, np.int64)
    best_jump = np.zeros(n, np.bool_)
    prior = np.zeros((n, 2, 2, 3))  # by detection, kind and jump: place and variance that a phase begins with
    count, total, last = 0, 0.0, -1  # readings carried along; cost of the best one so far, and which it is
    for k in range(n):
        dt = time[k] - time[k - 1] if k else 1.0
        # Phases that begin with this detection.
        for new_kind in range(2):
            for jumps in range(2):
                if k == 0 and jumps == 0:
                    continue
                before = kind[last] if k else 0
                speed, px, py = 0.0, 0.0, 0.0
                if k:
                    one = state[last]
                    ago = time[k] - time[since[last]]
                    px = one[0, 0] + ago * (one[1, 0] + ago * one[2, 0])
                    py = one[0, 1] + ago * (one[1, 1] + ago * one[2, 1])
                    speed = math.hypot(one[1, 0] + 2 * ago * one[2, 0], one[1, 1] + 2 * ago * one[2, 1])
                if jumps:
                    place_var, rate = extent**2 / 12, rates[3]
                    px, py = 0.0, 0.0
                elif new_kind == 1:
                    place_var, rate = (speed_sd * dt) ** 2 + variance[k], rates[1] if before else rates[0]
                elif before == 1:
                    place_var, rate = (speed * dt) ** 2 + variance[k], rates[2]
                else:
                    place_var, rate = shift_sd**2 + variance[k], rates[4]
                c = count
                count += 1
                since[c], kind[c], jump[c] = k, new_kind, jumps == 1
                cost[c] = total - (math.log(min(rate * dt, 0.5)) if k else 0.0)
                state[c], covariance[c] = _begun(
                    new_kind, np.array([px, py]), place_var, speed_sd**2, acceleration_sd**2
                )
                prior[k, new_kind, jumps] = np.array([px, py, place_var])
        stray = math.log(extent**2 / (2 * math.pi * variance[k])) - math.log(stray_share)
        last = 0
        for c in range(count):
            more, _ = _seen(state[c], covariance[c], time[k] - time[since[c]], xy[k, 0], xy[k, 1], variance[k], stray)
            cost[c] += more
            if cost[c] < cost[last]:
                last = c
        total = cost[last]
        best_since[k], best_kind[k], best_jump[k] = since[last], kind[last], jump[last]
        if count > 2 * kept:
            count, last = _thin_out(readings, count, last, k, kept)
    return _traced_back(best_since, best_kind, best_jump, prior)
