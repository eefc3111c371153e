"""A step along a curve: its polynomials in time and its error, from the rates of change k that a ball has in it.

The embedded pair of order 5 and 4 of Dormand and Prince (1980) with its continuous extension (Hairer, Norsett, Wanner,
Solving Ordinary Differential Equations I, II.6), or its first rates alone. The error of
a step is what it makes of the ball's place in the end: an error of velocity goes on for as long as the ball rolls, one
of slip along the slip ends the slide too soon or too late, one across it turns the slide for what is left of it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from models.analytic.cloth import ROLLING
from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.motion import STOPS
from models.shot import GRAVITY

# Weights of stages, the last of them the fifth order's, nodes, the error, the continuous extension.
STAGE_WEIGHTS = np.array([
    [1 / 5, 0, 0, 0, 0, 0],
    [3 / 40, 9 / 40, 0, 0, 0, 0],
    [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
    [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
    [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
    [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
])  # fmt: skip
STAGE_NODES = np.array([1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
ERROR_WEIGHTS = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])
DENSE_WEIGHTS = np.array([
    [1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
    [0, 0, 0, 0],
    [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
    [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
    [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
    [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
    [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
])  # fmt: skip
STEP_TOLERANCE_M = 3e-7  # error of a step, as an error of position at the end of the roll [m]
MIN_DECELERATION = 0.1  # deceleration of a roll, less on a faster cloth, which limits how long an error lasts [m/s^2]
LEAST_DECELERATION = 1e-3  # the same on the fastest cloth [m/s^2]
SPIN_ERROR_S = 0.1  # time for which an error of sidespin counts [s]
SPEED_ERROR = 0.02  # error of a step of a slow roll, over its speed: a larger one would restore a decayed speed
TURN_ERROR = 4e-4  # error of a step of half of what is left of a motion, over how much a push across it turns it
SAFETY_FACTOR = 0.9  # of a step whose error is to be the tolerance


@compiled_in_place
def straight_on(b, m, h, k):  # type: ignore[no-untyped-def]
    """Polynomials of a step at the accelerations k[0].

    A roll that stops after h does so straight, but for the h^2 / 4 times the push across it by which it drifts: to
    first order in the push a, v(t) = a (h - t) log(h / (h - t)) across.
    """
    m[:] = 0.0
    ax, ay, px, py = k[0, col.VX], k[0, col.VY], 0.0, 0.0
    if b[col.LAST] == STOPS:
        px, py = ax + b[col.VX] / h, ay + b[col.VY] / h
        ax, ay = ax - px, ay - py
    for x in range(col.STATE_SIZE):
        m[x, 0] = b[x]
    m[col.VX, 1], m[col.VX, 2] = (ax + 1.5 * px) * h, -1.5 * px * h
    m[col.VY, 1], m[col.VY, 2] = (ay + 1.5 * py) * h, -1.5 * py * h
    _integral(m, col.X, col.VX, b[col.X], h)
    _integral(m, col.Y, col.VY, b[col.Y], h)
    m[col.WX, 1], m[col.WY, 1], m[col.WZ, 1] = k[0, col.WX] * h, k[0, col.WY] * h, k[0, col.WZ] * h
    m[col.TURN, 1], m[col.TURN, 2] = b[col.WZ] * h, 0.5 * k[0, col.WZ] * h * h
    m[col.ROLLED, 1] = k[0, col.ROLLED] * h
    if b[col.LAST] == STOPS:
        m[col.ROLLED, 2] = -0.5 * m[col.ROLLED, 1]


@compiled_in_place
def smooth(b, m, h, k):  # type: ignore[no-untyped-def]
    """Polynomials m (STATE_SIZE, TERM_COUNT) of a step h of a ball b, of order 4, from k (7, STATE_SIZE)."""
    for x in range(col.STATE_SIZE):
        m[x, 0], m[x, 5] = b[x], 0.0
        for n in range(4):
            total = 0.0
            for stage in range(7):
                total += DENSE_WEIGHTS[stage, n] * k[stage, x]
            m[x, n + 1] = h * total
    # Places and angles are the integrals of what carries them, so that both agree on the whole step.
    _integral(m, col.X, col.VX, b[col.X], h)
    _integral(m, col.Y, col.VY, b[col.Y], h)
    _integral(m, col.TURN, col.WZ, b[col.TURN], h)


@compiled_in_place
def _integral(m, to, of, start, h):  # type: ignore[no-untyped-def]
    m[to, 0] = start
    for n in range(5):
        m[to, n + 1] = h * m[of, n] / (n + 1)


class ErrorWeights(NamedTuple):
    """How far errors of a step carry."""

    lasts: float  # time for which an error of the roll counts [s]
    early: float  # by how much an error of slip along the slip ends the slide too soon or too late, over it [s]
    turns: float  # time for which one across it turns the slide [s]


@compiled_in_place
def error_weights(b, radius, roll, until, k):  # type: ignore[no-untyped-def]
    """The `ErrorWeights` of a ball on a cloth of that rolling resistance, up to the time until [s]."""
    v = math.sqrt(b[col.VX] * b[col.VX] + b[col.VY] * b[col.VY])
    slows = min(max(roll * GRAVITY, LEAST_DECELERATION), MIN_DECELERATION)
    lasts = min(until, v / slows)
    # An error of slip along the slip ends the slide too soon or too late; one across turns it for what is left of it.
    slip_rate = math.sqrt((k[0, col.VX] - radius * k[0, col.WY]) ** 2 + (k[0, col.VY] + radius * k[0, col.WX]) ** 2)
    early = slows * lasts / max(slip_rate, MIN_DECELERATION)
    slip = math.sqrt((b[col.VX] - radius * b[col.WY]) ** 2 + (b[col.VY] + radius * b[col.WX]) ** 2)
    turns = 2 / 7 * min(until, slip / max(slip_rate, MIN_DECELERATION))
    return ErrorWeights(lasts, early, turns)


@compiled_in_place
def first_share(way, left, radius, weights, k):  # type: ignore[no-untyped-def]
    """The first step of a slide or roll of which `left` [s] remains, over what is then left of it; 0 for any."""
    if way.mode == ROLLING:
        across, far = abs(way.x * k[0, col.VY] - way.y * k[0, col.VX]), weights.lasts
    else:
        slip_rate_x, slip_rate_y = k[0, col.VX] - radius * k[0, col.WY], k[0, col.VY] + radius * k[0, col.WX]
        across, far = abs(way.slip_x * slip_rate_y - way.slip_y * slip_rate_x), weights.turns
    turned = TURN_ERROR * across * left * far
    return SAFETY_FACTOR * math.sqrt(math.sqrt(STEP_TOLERANCE_M / turned)) if turned > 0.0 else 0.0


@compiled_in_place
def step_error(h, way, fastest, radius, weights, k):  # type: ignore[no-untyped-def]
    """The error of a step h of a ball that is at most so fast [m/s], as an error of its place in the end [m]."""
    ex = ey = wx = wy = wz = 0.0
    for n in range(7):
        e = h * ERROR_WEIGHTS[n]
        ex, ey = ex + e * k[n, col.VX], ey + e * k[n, col.VY]
        wx, wy, wz = wx + e * k[n, col.WX], wy + e * k[n, col.WY], wz + e * k[n, col.WZ]
    sx, sy = ex - radius * wy, ey + radius * wx
    if way.mode == ROLLING:
        sx = sy = 0.0
    ex, ey = ex - 2 / 7 * sx, ey - 2 / 7 * sy
    off = math.sqrt(ex * ex + ey * ey)
    error = off * weights.lasts
    along, across = abs(sx * way.slip_x + sy * way.slip_y), abs(sx * way.slip_y - sy * way.slip_x)
    error += weights.early * along + weights.turns * across
    error += SPIN_ERROR_S * radius * abs(wz)
    if way.mode == ROLLING:
        error = max(error, STEP_TOLERANCE_M * off / (SPEED_ERROR * fastest))
    return error
