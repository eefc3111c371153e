"""Polynomials in time of a step along a curve, from the rates of change k that a ball has in it.

The embedded pair of order 5 and 4 of Dormand and Prince (1980) with its continuous extension (Hairer, Norsett, Wanner,
Solving Ordinary Differential Equations I, II.6), or its first rates alone.
"""

from __future__ import annotations

import numpy as np

from models.compiled import compiled_in_place
from models.engine import columns as col
from models.engine.motion import STOPS

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
