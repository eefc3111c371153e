"""Between frames of reference, and between steps and the times wanted: compiled loops over simulations."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from models.compiled import compiled
from models.shot import Array


@compiled
def spin_to_world(quat: Array, w: Array, inverse: bool) -> Array:
    """Rotate (nsim, nball, 3) vectors from ball to table frame by (nsim, nball, 4) quaternions, or back."""
    out = np.empty_like(w)
    sign = -1.0 if inverse else 1.0
    for s in range(w.shape[0]):
        for i in range(w.shape[1]):
            q0, x, y, z = quat[s, i, 0], sign * quat[s, i, 1], sign * quat[s, i, 2], sign * quat[s, i, 3]
            a, b, c = w[s, i]
            tx, ty, tz = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
            out[s, i, 0] = a + q0 * tx + y * tz - z * ty
            out[s, i, 1] = b + q0 * ty + z * tx - x * tz
            out[s, i, 2] = c + q0 * tz + x * ty - y * tx
    return out


@compiled
def record(
    rows: NDArray[np.int64], t0: Array, h: Array, times: Array, count: NDArray[np.int64], next_: NDArray[np.int64],
    p0: Array, v0: Array, w0: Array, v1: Array, w1: Array, p1: Array, theta: Array, alive: NDArray[np.bool_],
    out: Array,
) -> None:  # fmt: skip
    """Sample the step that just ended: positions by its parabola, velocity and spin linearly."""
    for k in range(rows.size):
        s = rows[k]
        while next_[s] < count[s] and times[s, next_[s]] <= t0[k] + h[k]:
            f = (times[s, next_[s]] - t0[k]) / h[k] if h[k] > 0.0 else 1.0
            for i in range(p0.shape[1]):
                o = out[s, next_[s], i]
                if not alive[s, i]:
                    o[:] = np.nan
                    continue
                for x in range(2):
                    a = f * h[k] * (v0[k, i, x] + 0.5 * f * (v1[k, i, x] - v0[k, i, x]))
                    # What is not in the parabola (native contacts) is spread over the step.
                    b = p1[k, i, x] - p0[k, i, x] - 0.5 * h[k] * (v0[k, i, x] + v1[k, i, x])
                    o[x] = p0[k, i, x] + a + f * b
                    o[2 + x] = v0[k, i, x] + f * (v1[k, i, x] - v0[k, i, x])
                for x in range(3):
                    o[4 + x] = w0[k, i, x] + f * (w1[k, i, x] - w0[k, i, x])
                o[7] = theta[s, i] + f * h[k] * (w0[k, i, 2] + 0.5 * f * (w1[k, i, 2] - w0[k, i, 2]))
            next_[s] += 1


@compiled
def record_curve(
    rows: NDArray[np.int64], t0: Array, h: Array, times: Array, count: NDArray[np.int64], next_: NDArray[np.int64],
    p0: Array, v0: Array, w0: Array, push: Array, turn: Array, v1: Array, w1: Array, p1: Array, theta: Array,
    alive: NDArray[np.bool_], out: Array,
) -> None:  # fmt: skip
    """Sample the step that just ended where accelerations varied: push, turn (3, n, nball, 3), a0 + a1 t + a2 t^2."""
    for k in range(rows.size):
        s = rows[k]
        while next_[s] < count[s] and times[s, next_[s]] <= t0[k] + h[k]:
            t = times[s, next_[s]] - t0[k] if h[k] > 0.0 else 0.0
            f = t / h[k] if h[k] > 0.0 else 1.0
            for i in range(p0.shape[1]):
                o = out[s, next_[s], i]
                if not alive[s, i]:
                    o[:] = np.nan
                    continue
                for x in range(2):
                    a, b, c = push[0, k, i, x], push[1, k, i, x], push[2, k, i, x]
                    o[x] = p0[k, i, x] + t * (v0[k, i, x] + t * (a / 2 + t * (b / 6 + t * c / 12)))
                    o[2 + x] = v0[k, i, x] + t * (a + t * (b / 2 + t * c / 3))
                    # What is not in the curve (native contacts, a stop) is spread over the step.
                    q = h[k]
                    o[x] += f * (p1[k, i, x] - p0[k, i, x] - q * (v0[k, i, x] + q * (a / 2 + q * (b / 6 + q * c / 12))))
                    o[2 + x] += f * (v1[k, i, x] - v0[k, i, x] - q * (a + q * (b / 2 + q * c / 3)))
                for x in range(3):
                    a, b, c = turn[0, k, i, x], turn[1, k, i, x], turn[2, k, i, x]
                    o[4 + x] = w0[k, i, x] + t * (a + t * (b / 2 + t * c / 3))
                    q = h[k]
                    o[4 + x] += f * (w1[k, i, x] - w0[k, i, x] - q * (a + q * (b / 2 + q * c / 3)))
                a, b, c = turn[0, k, i, 2], turn[1, k, i, 2], turn[2, k, i, 2]
                o[7] = theta[s, i] + t * (w0[k, i, 2] + t * (a / 2 + t * (b / 6 + t * c / 12)))
            next_[s] += 1
