"""What an impact is about to be: approach and slip of the bodies that meet, for the effects to say how it goes."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from models.analytic.events import in_mouth
from models.analytic.pocket import NONE, OWNERS, outward
from models.effect import Impact
from models.shot import NOSE_COSINE, NOSE_SINE, Array, Ball


def describe(
    kind: str, ball: Ball, p: Array, v: Array, w: Array, i: NDArray[np.int64], j: NDArray[np.int64], order: Array,
    jaws: Array = NONE,
) -> Impact:  # fmt: skip
    """Impacts of one kind, a row each: p, v, w (n, nball, 3); ball i with ball j, or rail j (+x, -x, +y, -y).

    `order` (n,): places of the shots in their session. Jaw j - 4 of `jaws` counts as the rail that it ends.
    """
    approach, slip = _describe(kind == "cushion", ball.radius, p, v, w, i, j, jaws)
    if kind == "cushion":
        j = np.array([*range(4), *OWNERS])[j]
    row = np.arange(len(i))
    at, going = p[row, i, :2], v[row, i, :2]
    e, mu, gain, decay = np.zeros((4, len(i)))
    return Impact(kind, ball, approach, slip, at, going, i, j, e, mu, gain, decay, np.ones((len(i), 2)), order)


@njit(cache=True)
def _describe(
    cushion: bool, r: float, p: Array, v: Array, w: Array, first: NDArray[np.int64], second: NDArray[np.int64],
    jaws: Array,
) -> tuple[Array, Array]:  # fmt: skip
    approach, slip = np.empty(first.size), np.empty(first.size)
    for n in range(first.size):
        i, j = first[n], second[n]
        if cushion:
            nx, ny = outward(j, p[n, i, 0], p[n, i, 1], jaws)
            c, s = NOSE_COSINE, NOSE_SINE
            ux, uy = v[n, i, 0], v[n, i, 1]
            wx, wy, wz = w[n, i, 0], w[n, i, 1], w[n, i, 2]
        else:
            nx, ny = p[n, j, 0] - p[n, i, 0], p[n, j, 1] - p[n, i, 1]
            d = math.sqrt(nx * nx + ny * ny)
            nx, ny = nx / d, ny / d
            c, s = 1.0, 0.0
            ux, uy = v[n, i, 0] - v[n, j, 0], v[n, i, 1] - v[n, j, 1]
            wx, wy, wz = w[n, i, 0] + w[n, j, 0], w[n, i, 1] + w[n, j, 1], w[n, i, 2] + w[n, j, 2]
        approach[n] = ux * nx + uy * ny
        # Slip along the horizontal tangent (-ny, nx), and up the face.
        along = -ux * ny + uy * nx + r * (wz * c - s * (wx * nx + wy * ny))
        up = -approach[n] * s + r * (wx * ny - wy * nx)
        slip[n] = math.sqrt(along * along + up * up)
    return approach, slip


@njit(cache=True)
def crowded(
    cushion: bool, hit: NDArray[np.int64], p: Array, alive: NDArray[np.bool_], near: Array, radius: float,
    reach: Array, half: Array, mouths: Array,
) -> NDArray[np.bool_]:  # fmt: skip
    """Impacts (rows of `hit`: kind, ball, other ball or rail) with a third body within `near` (n,) [m] of theirs."""
    found = np.zeros(hit.shape[0], np.bool_)
    for n in range(hit.shape[0]):
        one = hit[n, 1]
        two = one if cushion else hit[n, 2]
        for i in (one, two):
            for k in range(alive.shape[1]):
                if alive[n, k] and k != one and k != two:
                    x, y = p[n, k, 0] - p[n, i, 0], p[n, k, 1] - p[n, i, 1]
                    d = 2.0 * radius + near[n]
                    found[n] = found[n] or x * x + y * y < d * d
            for rail in range(4):
                k = rail // 2
                gap = reach[k] - (1.0 - 2.0 * (rail % 2)) * p[n, i, k]
                other = not (cushion and rail == hit[n, 2])
                found[n] = found[n] or (gap < near[n] and other and not in_mouth(p[n, i, 1 - k], rail, half, mouths))
    return found


@njit(cache=True)
def part(cushion: bool, hit: NDArray[np.int64], p: Array, radius: float, reach: Array, jaws: Array) -> None:
    """Put bodies that overlap, each row of `hit`, back to where they touch."""
    for n in range(hit.shape[0]):
        i, j = hit[n, 1], hit[n, 2]
        if cushion and j >= 4:
            nx, ny = outward(j, p[n, i, 0], p[n, i, 1], jaws)
            x, y = jaws[j - 4, 0] - p[n, i, 0], jaws[j - 4, 1] - p[n, i, 1]
            more = max(jaws[j - 4, 2] - math.sqrt(x * x + y * y), 0.0)
            p[n, i, 0] -= more * nx
            p[n, i, 1] -= more * ny
            continue
        if cushion:
            k, sign = j // 2, 1.0 - 2.0 * (j % 2)
            p[n, i, k] = sign * min(sign * p[n, i, k], reach[k])
            continue
        x, y = p[n, j, 0] - p[n, i, 0], p[n, j, 1] - p[n, i, 1]
        d = math.sqrt(x * x + y * y)
        more = 0.5 * max(2.0 * radius - d, 0.0) / d
        p[n, i, 0] -= more * x
        p[n, i, 1] -= more * y
        p[n, j, 0] += more * x
        p[n, j, 1] += more * y
